// One clock: pressure and motion over one another. Drag the motion along; let the offset be found; or show where the lamp is.
import {chooseExperiment, experiment, Figure, manifest, on, plots, show, state, timeBox, timeScale, toError} from "../report/report.js";
import {figure, h, one} from "./dom.js";
import {ask, get} from "./server.js";
import {begin, busy, campaign, complain, guarded, reload as reloadAll} from "./main.js";
import {pixelOf} from "./setup.js";

const lamp = {run: null, film: null, picture: null, drag: null}; // of this run, and where the drag began
const spec = () => campaign.state.experiments.find(e => e.name === experiment()?.name);
const numberOf = e => campaign.state.experiments.indexOf(e);
const methods = {motion: "found from the motion", led: "seen by the lamp", trigger: "told by the trigger", offset: "given by hand", common_clock: "one clock for both"};
delete plots.sync.drag; // here one drags the motion, not the time

export function build() {
  one('[data-panel="clock"]').append(
    h("h2", {}, "One clock"),
    h("div", {class: "tabs", role: "tablist", id: "clock-runs", aria: {label: "Experiment"}}),
    h("p", {class: "lead", id: "clock-say", role: "status"}),
    figure("sync", "Pressure and motion", "Pressure and bend angle over time on one clock; drag the motion sideways", 280),
    h("p", {class: "muted"}, "Grey: the pressure log. Blue: the motion that was measured. Drag the blue curve sideways, or use the field; zoom in where the pressure steps."),
    h("div", {class: "switches"},
      h("label", {}, "Log clock minus camera clock ", h("input", {type: "number", id: "offset", step: "0.1", aria: {label: "Log clock minus camera clock in ms"}}), " ms"),
      h("button", {type: "button", id: "keep-offset", onclick: keepOffset}, "Keep this offset"),
      h("button", {type: "button", id: "find-offset", onclick: () => method("motion")}, "Let it be found"),
      h("button", {type: "button", data: {zoom: "in"}}, "Zoom in"), h("button", {type: "button", data: {zoom: "out"}}, "Zoom out"), h("button", {type: "button", data: {zoom: "all"}}, "Whole run")),
    figure("offsets", "How well each offset fits", "Share of the motion that each offset explains; the peak is the offset that was found", 170),
    h("details", {id: "lamp-box"}, h("summary", {}, "There is a lamp in the picture that follows the log"),
      h("p", {class: "muted"}, "Drag a box around the lamp, or type it, and name the column of the log that holds the lamp's signal. ", h("span", {id: "log-has"})),
      h("div", {class: "switches"},
        h("label", {}, "Column of the log ", h("input", {type: "text", id: "channel", size: 12, list: "columns"}), h("datalist", {id: "columns"})),
        h("label", {}, "Left, top, width, height in px ", h("input", {type: "text", id: "lamp-place", size: 18, oninput: () => placeLamp()})),
        h("button", {type: "button", id: "by-lamp", onclick: byLamp}, "Go by this lamp")),
      h("canvas", {id: "lamp-frame", aria: {label: "First frame of the film; drag a box around the lamp"}})));
  const holder = one('[data-figure="sync"] .canvas');
  let from = null;
  const at = event => timeScale(timeBox({width: holder.clientWidth, height: holder.clientHeight})).back(event.clientX - holder.getBoundingClientRect().left);
  holder.classList.add("pick");
  holder.addEventListener("pointerdown", event => { from = at(event) - state.shift; holder.setPointerCapture(event.pointerId); });
  holder.addEventListener("pointermove", event => { if (from !== null) shift(at(event) - from); });
  for (const end of ["pointerup", "pointercancel"]) holder.addEventListener(end, () => { from = null; });
  one("#offset").addEventListener("input", event => { const clock = spec()?.recorded; if (clock && event.target.value !== "") shift((Number(event.target.value) - clock.offset_ms) / 1000, true); });
  one("#lamp-box").addEventListener("toggle", event => { if (event.target.open) guarded(openLamp); });
  dragLamp(one("#lamp-frame"));
  on("experiment", () => { // another one has been chosen; the same one read anew leaves what was dragged or typed
    if (experiment()?.name === lamp.run) return;
    lamp.run = experiment()?.name; lamp.film = lamp.picture = null;
    one("#offset").value = "";
    one("#channel").value = spec()?.sync.channel ?? ""; placeLamp(spec()?.sync.box ?? []);
    shift(0); showClock();
    if (one("#lamp-box").open) guarded(openLamp);
  });
}

function shift(seconds, typed = false) {
  state.shift = seconds;
  const clock = spec()?.recorded;
  if (clock && !typed) one("#offset").value = (clock.offset_ms + 1000 * seconds).toFixed(2);
  one("#keep-offset").classList.toggle("primary", Math.abs(seconds) > 1e-6);
  Figure.redraw();
}

export function reload() { showClock(); }
function showClock() {
  const e = spec(), clock = e?.recorded;
  one("#clock-runs").replaceChildren(...manifest.experiments.map((run, i) => h("button", {type: "button", role: "tab", aria: {selected: String(i === state.experiment)}, onclick: () => chooseExperiment(i)}, run.name)));
  one("#clock-say").textContent = !e ? "No run has been measured yet." : !clock ? `${e.name} has not been synchronised yet.` : `The log's clock is ${toError(Math.abs(clock.offset_ms), clock.stderr_ms)} ms ${clock.offset_ms < 0 ? "behind" : "ahead of"} the camera's${clock.stderr_ms ? `, with a standard error of ${show(clock.stderr_ms, 2)} ms` : ""}: ${methods[clock.method] ?? clock.method}.`;
  for (const id of ["#offset", "#keep-offset", "#find-offset"]) one(id).disabled = !e; // by hand also where it was not found
  if (clock && document.activeElement !== one("#offset")) one("#offset").value = (clock.offset_ms + 1000 * state.shift).toFixed(2);
  one("#lamp-box").hidden = !e?.pictures; placeLamp();
}

async function method(name, more = {}) {
  const e = spec();
  busy(true);
  if (!await guarded(() => ask(`sync/${numberOf(e)}`, {method: name, ...more}))) { busy(false); return; }
  state.shift = 0;
  await guarded(reloadAll);
  await begin("sync", {names: [e.name]}, `Bring ${e.name} on one clock`);
}
function keepOffset() {
  const value = one("#offset").valueAsNumber;
  if (Number.isNaN(value)) complain("type an offset in ms, or drag the blue curve"); else method("offset", {value_ms: value});
}

// -- the lamp ----------------------------------------------------------------------------------------------------------------
async function openLamp() {
  const e = spec(), number = numberOf(e), picture = new Image();
  if (!e?.pictures) return;
  picture.src = `picture/${number}?frame=0`;
  const [film] = await Promise.all([get(`film/${number}`), picture.decode()]);
  if (spec()?.name !== e.name) return;
  Object.assign(lamp, {film, picture});
  paintLamp();
  const {columns} = await get(`columns/${number}`).catch(() => ({columns: []})); // what is wrong with a log is said where it is needed
  if (spec()?.name !== e.name) return;
  one("#columns").replaceChildren(...columns.map(name => h("option", {value: name})));
  one("#log-has").textContent = columns.length ? `The log has ${columns.join(", ")}.` : "";
}
function paintLamp() {
  const canvas = one("#lamp-frame"), p = lamp.picture, box = typedBox();
  if (!p) return;
  const k = Math.min(1, canvas.parentElement.clientWidth / p.naturalWidth, 560 / p.naturalHeight);
  canvas.width = p.naturalWidth * k; canvas.height = p.naturalHeight * k;
  const c = canvas.getContext("2d"), s = canvas.width / lamp.film.width;
  c.drawImage(p, 0, 0, canvas.width, canvas.height);
  if (box) { c.strokeStyle = "#f0e442"; c.lineWidth = 2; c.strokeRect((box[0] + 0.5) * s, (box[1] + 0.5) * s, box[2] * s, box[3] * s); }
}
// The box stands in its field, from where it is drawn and taken: drawn by hand or typed is the same.
function typedBox() { const box = one("#lamp-place").value.split(/[\s,;]+/).filter(Boolean).map(Number); return box.length === 4 && box.every(Number.isFinite) && box[2] > 2 && box[3] > 2 ? box : null; }
function placeLamp(box) {
  if (box) one("#lamp-place").value = box.join(", ");
  const typed = typedBox();
  one("#by-lamp").classList.toggle("primary", Boolean(typed) && typed.join() !== spec()?.sync.box?.join());
  paintLamp();
}
function byLamp() {
  const box = typedBox();
  if (box) method("led", {box, channel: one("#channel").value}); else complain("drag a box around the lamp, or type its left, top, width and height in pixels");
}
const boxOf = ([[x0, y0], [x1, y1]]) => [Math.min(x0, x1), Math.min(y0, y1), Math.abs(x1 - x0), Math.abs(y1 - y0)].map(Math.round);
function dragLamp(canvas) {
  canvas.addEventListener("pointerdown", event => { if (!lamp.film) return; lamp.drag = pixelOf(canvas, event, lamp.film); canvas.setPointerCapture(event.pointerId); });
  canvas.addEventListener("pointermove", event => { if (lamp.drag) placeLamp(boxOf([lamp.drag, pixelOf(canvas, event, lamp.film)])); });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { lamp.drag = null; });
}
