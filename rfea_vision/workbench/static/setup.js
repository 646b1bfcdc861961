// Set up by pointing: frames of every film, hints on top of them, the track while it is made, and why frames were refused.
import {show} from "../report/report.js";
import {every, h, one} from "./dom.js";
import {ask, get} from "./server.js";
import * as scale from "./scale.js";
import * as closer from "./closer.js";
import {begin, campaign, complain, guarded, onJob, order, reload as reloadAll} from "./main.js";

const seen = {run: 0, frame: 0, film: null, picture: null, line: null, reason: "", tool: "look", points: [], cursor: null, tried: new Map(), photo: -1};
const tools = {
  look: {label: "Look", say: "Is the tube not found, or something else? Choose what to point at; the slider moves through the film."},
  scale: {...scale.tool, count: 2},
  clamp: {label: "Clamp", count: 2, say: "First frame: click both edges of the first cross-section that is seen."},
  tip: {label: "Tip", count: 1, say: "First frame: click the middle of the tube's free end."},
  centre_line: {label: "Centre line", count: 5, say: "First frame: click five points along the middle of the tube, from the clamp to the free end."},
  corrections: {label: "Point again", count: 5, later: true, say: "In a later frame, where the line is missing or wrong: click five points along the middle of the tube, from the clamp on, the last one at the free end."},
  region: {label: "Region", box: true, say: "Drag a box around wherever the tube goes."},
  exclude: {label: "Leave out", box: true, many: true, say: "Drag a box over a hose, a hand or a label that is not the tube."},
};
const filmed = () => campaign.state.experiments.filter(e => e.pictures);
const run = () => filmed()[seen.run];
const numberOf = e => campaign.state.experiments.indexOf(e);

export function build() {
  one('[data-panel="setup"]').append(
    h("h2", {}, "Set up by pointing"),
    h("div", {class: "tabs", role: "tablist", id: "films", aria: {label: "Film"}}),
    h("div", {class: "pointing", id: "pointing"},
      h("div", {},
        h("div", {class: "pointers", role: "radiogroup", id: "tools", aria: {label: "What to point at"}}),
        h("p", {class: "muted", id: "tool-say", role: "status"}, tools.look.say),
        scale.form(keepScale),
        closer.view(h("canvas", {id: "frame", tabIndex: 0, role: "application", aria: {label: "Picture of the film. With the arrow keys the cross moves, with Enter it points."}})),
        closer.buttons(() => paint()),
        h("div", {class: "transport"}, h("input", {type: "range", id: "frame-slider", min: "0", max: "0", value: "0", aria: {label: "Frame"}}), h("output", {id: "frame-clock"})),
        h("p", {id: "frame-reason", class: "muted"})),
      h("aside", {class: "beside"},
        h("h3", {}, "Pointed at"), h("ul", {class: "plainlist", id: "hints"}),
        h("label", {class: "muted"}, h("input", {type: "checkbox", id: "for-all"}), "for all films (campaign.yaml)"),
        h("div", {class: "buttons"}, h("button", {type: "button", id: "try", onclick: tryOut}, "Try the first 2 s"), h("button", {type: "button", id: "measure", onclick: () => begin(run().logged ? "sync" : "track", {names: [run().name]}, `Measure ${run().name}`)}, "Measure this film")),
        h("h3", {}, "Refused frames"), h("ul", {class: "plainlist", id: "refused"}),
        h("h3", {}, "Photos of the board"), h("ul", {class: "plainlist", id: "photos"}))),
    h("p", {class: "absent", id: "no-films", hidden: true}, ""));
  one("#frame-slider").addEventListener("input", event => goTo(Number(event.target.value)));
  pointing(one("#frame"));
  closer.draggable(() => seen.tool === "look");
  new ResizeObserver(paint).observe(one("#pointing"));
  onJob(event => { if (["track", "sync"].includes(event.do) && event.event === "finished") { seen.tried.clear(); paint(); } });
  onJob(event => { if (event.do === "try" && event.event === "finished" && event.result) one("#tool-say").textContent = `${event.result.good} of the first ${event.result.frames} frames were tracked.`; });
}

export function reload() {
  const films = filmed();
  one("#no-films").hidden = films.length > 0; one("#pointing").hidden = !films.length;
  one("#no-films").textContent = campaign.state.problems.length ? "No film can be shown yet: mend first what is said above." : "No run of this campaign has pictures: the tracks came from another tool.";
  seen.run = Math.min(seen.run, Math.max(0, films.length - 1));
  one("#films").replaceChildren(...films.map((e, i) => h("button", {type: "button", role: "tab", aria: {selected: String(i === seen.run)}, data: {film: e.name}, onclick: () => choose(i)}, e.name, " ", h("small", {}, e.tracked ? `${Math.round(100 * e.tracked.good / e.tracked.frames)} %` : "new"))));
  if (!films.length) return;
  one("#tools").replaceChildren(...Object.entries(tools).filter(([key]) => key === "look" || run().pointable.includes(key)).map(([key, tool]) => h("button", {type: "button", role: "radio", aria: {checked: String(key === seen.tool)}, data: {tool: key}, onclick: () => take(key)}, tool.label)));
  for (const button of every("#try, #measure")) button.disabled = !run().pointable.includes("clamp"); // without a scale nothing is measured
  showHints(); showRefused(); showPhotos();
  if (campaign.panel === "setup") shown();
}
export function shown() { if (filmed().length) guarded(() => openFilm()); }
function choose(i) { playing++; Object.assign(seen, {run: i, frame: 0, film: null, photo: -1, points: []}); take("look"); reload(); }

export function pointAt(name, tool) {
  const film = filmed().findIndex(e => e.name === name);
  if (film >= 0 && film !== seen.run) choose(film);
  take(tool);
}

async function openFilm() {
  const e = run();
  if (seen.film?.name !== e.name) {
    one("#frame-reason").textContent = `Opening the film of ${e.name}…`;
    const film = {name: e.name, ...await get(`film/${numberOf(e)}`)};
    if (run()?.name !== e.name) return; // another one has been chosen since
    seen.film = film;
    one("#frame-slider").max = seen.film.frames - 1;
  }
  await (seen.photo < 0 ? showFrame(seen.frame) : showPicture());
}

// Whoever goes to a frame ends what plays by itself: a trial that runs through its pictures must not take them away again.
let playing = 0;
function goTo(frame) { playing++; if (frame !== seen.frame) seen.points = []; return showFrame(frame); }

// Pictures are asked for one at a time; of those that wait only the last counts.
let busy = false;
const wanted = () => seen.photo < 0 ? `${numberOf(run())}?frame=${seen.frame}` : `photo/${seen.photo}`;
function showFrame(frame) {
  seen.frame = frame; seen.photo = -1;
  one("#frame-slider").value = frame;
  one("#frame-clock").textContent = `${(seen.film?.times[frame] ?? 0).toFixed(3)} s`;
  return showPicture();
}
function showPhoto(index) { playing++; take("look"); seen.photo = index; return showPicture(); } // hints are pixels of the film
async function showPicture() {
  if (busy) return;
  busy = true;
  for (let got = null; got !== wanted();) {
    got = wanted();
    const picture = new Image(), photo = seen.photo;
    picture.src = photo < 0 ? `picture/${got}` : got;
    try {
      const [outline] = await Promise.all([photo < 0 ? get(`outline/${got}`) : {line: null, words: ""}, picture.decode()]);
      if (got !== wanted()) continue;
      Object.assign(seen, {picture, line: outline.line, reason: outline.words});
      one("#frame-reason").textContent = photo >= 0 ? campaign.state.photos[photo].note : seen.reason ? `Refused: ${seen.reason}.` : "";
    } catch (error) { if (got === wanted()) { complain(photo < 0 ? error.message : "this photo cannot be read"); break; } }
    paint();
  }
  busy = false;
}

// -- drawing ---------------------------------------------------------------------------------------------------------------
const MOST_DRAWN = 4096; // px of the canvas from side to side; of what is closer than that the browser draws every pixel larger
const fitTo = () => { const wide = one("#frame-view").parentElement.clientWidth, p = seen.picture; return p ? Math.min(wide / p.naturalWidth, 640 / p.naturalHeight) : 1; };
export const closerLook = way => closer.look(way, paint);
export function paint() {
  const canvas = one("#frame"), p = seen.picture, view = one("#frame-view");
  if (!p || !seen.film || !view.parentElement.clientWidth) return;
  const whole = fitTo(), k = whole * closer.closeness(), w = p.naturalWidth * k, tall = p.naturalHeight * k, dense = Math.min(3, devicePixelRatio || 1, MOST_DRAWN / w);
  Object.assign(view.style, {maxWidth: `${p.naturalWidth * whole}px`, maxHeight: `${p.naturalHeight * whole}px`});
  canvas.style.width = `${w}px`; canvas.style.height = `${tall}px`;
  canvas.width = Math.round(w * dense); canvas.height = Math.round(tall * dense);
  const c = canvas.getContext("2d");
  c.setTransform(dense, 0, 0, dense, 0, 0);
  c.drawImage(p, 0, 0, w, tall);
  if (seen.photo >= 0) return;
  // pixel (0, 0) is the middle of the first pixel
  const s = k * p.naturalWidth / seen.film.width, at = ([x, y]) => [(x + 0.5) * s, (y + 0.5) * s];
  const stroke = (points, colour, width, dash = []) => { c.beginPath(); points.map(at).forEach(([x, y], i) => i ? c.lineTo(x, y) : c.moveTo(x, y)); c.setLineDash(dash); c.strokeStyle = "rgb(0 0 0 / .55)"; c.lineWidth = width + 2; c.stroke(); c.strokeStyle = colour; c.lineWidth = width; c.stroke(); c.setLineDash([]); };
  const dot = (point, colour) => { const [x, y] = at(point); c.beginPath(); c.arc(x, y, 4.5, 0, 7); c.fillStyle = colour; c.fill(); c.strokeStyle = "#fff"; c.lineWidth = 1.5; c.stroke(); };
  const box = ([x, y, w0, h0], colour, fill) => { const [a, b] = at([x, y]); if (fill) { c.fillStyle = fill; c.fillRect(a, b, w0 * s, h0 * s); } c.strokeStyle = colour; c.lineWidth = 2; c.setLineDash([6, 4]); c.strokeRect(a, b, w0 * s, h0 * s); c.setLineDash([]); };
  const hints = run().hints;
  if (run().scale) scale.paint(c, run().scale, at);
  if (hints.region) box(hints.region, "#2ec4a0");
  for (const one_ of hints.exclude ?? []) box(one_, "#ff7b6b", "rgb(255 123 107 / .25)");
  if (run().sync.box) box(run().sync.box, "#f0e442");
  const tried = seen.tried.get(run().name)?.[seen.frame], line = tried ? tried.line : seen.line;
  if (line) stroke(line, tried ? "#2ec4a0" : "#56b4e9", 2.5);
  if (hints.clamp) { stroke(hints.clamp, "#f0932b", 2); hints.clamp.forEach(point => dot(point, "#f0932b")); }
  if (seen.frame === 0) { // where the tube was then; it has moved on since
    (hints.centre_line ?? []).forEach(point => dot(point, "#56b4e9"));
    if (hints.tip) dot(hints.tip, "#dd9dc2");
  }
  for (const {points} of (hints.corrections ?? []).filter(later => later.frame === seen.frame)) points.forEach((point, i) => dot(point, i + 1 < points.length ? "#56b4e9" : "#dd9dc2"));
  if (seen.tool === "scale" && seen.points.length === 2) stroke(seen.points, "#f0e442", 2);
  seen.points.forEach(point => dot(point, "#f0e442"));
  if (seen.drag) box(boxOf(seen.drag), "#f0e442");
  if (seen.cursor) { const [x, y] = at(seen.cursor); c.strokeStyle = "#fff"; c.lineWidth = 1; c.beginPath(); c.moveTo(x - 12, y); c.lineTo(x + 12, y); c.moveTo(x, y - 12); c.lineTo(x, y + 12); c.stroke(); }
}
const boxOf = ([[x0, y0], [x1, y1]]) => [Math.min(x0, x1), Math.min(y0, y1), Math.abs(x1 - x0), Math.abs(y1 - y0)].map(v => Math.round(v));

// -- pointing: with mouse, finger or keys -----------------------------------------------------------------------------------
export const pixelOf = (canvas, event, film) => { const r = canvas.getBoundingClientRect(), s = film.width / r.width; return [(event.clientX - r.left) * s - 0.5, (event.clientY - r.top) * s - 0.5].map(v => Math.round(10 * v) / 10); };
function pointing(canvas) {
  canvas.addEventListener("pointerdown", event => {
    const tool = tools[seen.tool];
    if (seen.tool === "look" || !seen.film) return;
    const at = pixelOf(canvas, event, seen.film);
    if (tool.box) { seen.drag = [at, at]; canvas.setPointerCapture(event.pointerId); } else point(at);
    paint();
  });
  canvas.addEventListener("pointermove", event => { if (seen.drag) { seen.drag[1] = pixelOf(canvas, event, seen.film); paint(); } });
  canvas.addEventListener("pointerup", () => { const drag = seen.drag; seen.drag = null; if (drag) finishBox(boxOf(drag)); });
  canvas.addEventListener("keydown", event => {
    const by = {ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1]}[event.key], far = event.shiftKey ? 25 : 5;
    if (seen.tool === "look" || !seen.film || !(by || event.key === "Enter")) return;
    event.preventDefault(); event.stopPropagation();
    seen.cursor ??= [seen.film.width / 2, seen.film.height / 2];
    if (by) { seen.cursor = [seen.cursor[0] + far * by[0], seen.cursor[1] + far * by[1]]; one("#tool-say").textContent = `Column ${seen.cursor[0]}, row ${seen.cursor[1]}.`; paint(); return; }
    if (!tools[seen.tool].box) return point([...seen.cursor]);
    seen.points.push([...seen.cursor]);
    if (seen.points.length === 2) { const corners = seen.points; seen.points = []; finishBox(boxOf(corners)); }
    paint();
  });
}
function take(key) {
  seen.tool = key; seen.points = []; seen.cursor = null;
  for (const button of every("#tools button")) button.setAttribute("aria-checked", String(button.dataset.tool === key));
  one("#tool-say").textContent = tools[key].say;
  one("#scale-form").hidden = key !== "scale"; one("#for-all").parentElement.hidden = key === "scale"; // which is of all films unless it is said
  scale.ready([]); // put away, its button is not the next thing to do
  if (key === "scale") scale.fill(run().scale);
  if (key !== "look" && !tools[key].later && seen.film) goTo(0); // hints are pixels of the first frame
  if (key === "scale" && run().scale?.distance) { seen.points = run().scale.points.map(at => [...at]); scale.ready(seen.points); } // another distance may be typed
  if (key !== "look") one("#frame").focus({preventScroll: true});
}
function point(at) {
  const tool = tools[seen.tool];
  if (tool.later && seen.frame === 0) { one("#tool-say").textContent = "Go to a later frame first: in this one the clamp, the tip and the centre line are pointed at."; return; }
  if (seen.points.length === tool.count) seen.points = []; // a scale is clicked anew
  seen.points.push(at);
  if (seen.tool === "scale") scale.ready(seen.points);
  if (seen.tool === "scale" && seen.points.length === 2) { one("#tool-say").textContent = "Type what lies between the two points."; setTimeout(() => one("#scale-distance").focus({preventScroll: true})); return paint(); } // after the click has given its focus to the picture
  if (seen.points.length < tool.count) { one("#tool-say").textContent = `${tool.say} ${seen.points.length} of ${tool.count}.`; return paint(); }
  const points = seen.points;
  seen.points = [];
  if (tool.later) {
    const others = (run().hints.corrections ?? []).filter(later => later.frame !== seen.frame);
    return keep(seen.tool, [...others, {frame: seen.frame, points}].sort((one_, other) => one_.frame - other.frame));
  }
  keep(seen.tool, tool.count === 1 ? points[0] : points);
}
function finishBox(box) {
  if (box[2] < 3 || box[3] < 3) return paint();
  keep(seen.tool, tools[seen.tool].many ? [...(run().hints[seen.tool] ?? []), box] : box);
}

// A scale that is refused stays as it was clicked and typed, to be mended.
async function keepScale() {
  const e = run();
  if (seen.points.length !== 2) return;
  const said = await (written = written.then(() => guarded(() => ask(`hint/${numberOf(e)}`, {key: "scale", value: scale.asked(seen.points), all: !scale.alone()}))));
  if (!said) return;
  seen.tried.delete(e.name);
  take("look");
  one("#tool-say").textContent = `${said.file}: camera.scale written.`;
  await guarded(reloadAll);
}
// A hint goes into the files at once, one after the other; taken away, its key is set to null.
let written = Promise.resolve();
async function keep(key, value) {
  const e = run(), all = one("#for-all").checked;
  e.hints[key] = value; // what is drawn next begins from here, not from what the files said before
  take("look");
  const said = await (written = written.then(() => guarded(() => ask(`hint/${numberOf(e)}`, {key, value, all}))));
  if (!said) return reloadAll().catch(() => undefined); // why is said already
  seen.tried.delete(e.name);
  if (seen.tool === "look") one("#tool-say").textContent = `${said.file}: camera.${key} ${value === null ? "taken away" : "written"}.`;
  await guarded(reloadAll);
}
const away = (key, say = "take away") => h("button", {type: "button", class: "plain", aria: {label: `Take ${tools[key].label} away`}, onclick: () => keep(key, null)}, say);
function showHints() {
  const hints = run().hints, words = {clamp: v => `${v[0].join(", ")} to ${v[1].join(", ")} px`, tip: v => `${v.join(", ")} px`, centre_line: v => `${v.length} points`, corrections: v => `in ${v.length === 1 ? "frame" : "frames"} ${v.map(later => later.frame).join(", ")}`, region: v => `${v[2]} × ${v[3]} px at ${v[0]}, ${v[1]}`, exclude: v => v.length === 1 ? "one box" : `${v.length} boxes`};
  const there = Object.keys(words).filter(key => hints[key] && (!Array.isArray(hints[key]) || hints[key].length));
  const scaled = run().scale && h("li", {}, h("b", {}, tools.scale.label), " ", h("span", {class: "muted"}, scale.words(run().scale)), " ", h("button", {type: "button", class: "plain", onclick: () => take("scale")}, "change"), " ", away("scale", run().scale.own || filmed().length === 1 ? "take away" : "take away from all films"));
  one("#hints").replaceChildren(...(scaled ? [scaled] : []), ...there.map(key => h("li", {}, h("b", {}, tools[key].label), " ", h("span", {class: "muted"}, words[key](hints[key])), " ", away(key))),
    ...(there.length ? [] : [h("li", {class: "muted"}, run().pointable.includes("clamp") ? "No hint: the tube is looked for in the whole picture." : "Nothing: the scale comes first.")]));
}

function showRefused() {
  const found = run().tracked?.reasons ?? [], count = run().tracked;
  one("#refused").replaceChildren(...(count ? [h("li", {class: "muted"}, `${count.frames - count.good} of ${count.frames} frames${run().changed ? "; the hints have changed since" : ""}.`)] : [h("li", {class: "muted"}, "Not measured yet.")]),
    ...found.map(({reason, words, frames, tool, button}) =>
      h("li", {}, h("b", {}, String(frames)), ` ${words} `, h("button", {type: "button", class: "plain", onclick: () => nextRefused(reason)}, "show"), run().pointable.includes(tool) ? h("button", {type: "button", class: "plain remedy", onclick: () => take(tool)}, button) : null)));
}
async function nextRefused(reason) {
  const {frames} = await get(`refused/${numberOf(run())}?reason=${encodeURIComponent(reason)}`);
  const next = frames.find(frame => frame > seen.frame) ?? frames[0];
  if (next !== undefined) goTo(next);
}
function showPhotos() {
  one("#photos").replaceChildren(...campaign.state.photos.map((photo, i) => h("li", {}, h("button", {type: "button", class: "plain", onclick: () => showPhoto(i)}, photo.name), " ", h("span", {class: "muted"}, photo.note))),
    ...(campaign.state.photos.length ? [] : [h("li", {class: "muted"}, run().pointable.includes("clamp") ? "None: the scale comes from elsewhere." : "None.")]));
}

// -- the track of the first seconds, over the film while it is made ---------------------------------------------------------
async function tryOut() {
  const name = run().name;
  seen.tried.set(name, []);
  take("look");
  await order(`try/${numberOf(run())}`, {seconds: 2});
}
export function hear(event, mine) {
  if (!mine || event.event !== "tried") return;
  const had = seen.tried.get(event.name)?.length ?? 0;
  seen.tried.set(event.name, event.frames);
  const refused = event.frames.filter(frame => frame.reason).length;
  one("#tool-say").textContent = `${event.frames.length - refused} of the first ${event.frames.length} frames tracked${refused ? `; the others: ${event.frames.find(frame => frame.reason).reason}` : ""}.`;
  if (event.name === run()?.name) follow(had, event.frames.length);
}
async function follow(from, to) { // run through what is new, a frame in so many that it takes about a second
  const mine = ++playing, step = Math.max(1, Math.round((to - from) / 12));
  for (let frame = from; frame < to && mine === playing; frame += step) { await showFrame(frame); await new Promise(done => setTimeout(done, 60)); }
  if (mine === playing) showFrame(to - 1);
}
