// The page: which step is shown, what is next, what is under way. The steps themselves are modules of their own.
import {Figure, chooseExperiment, chooseRung, experiment, jumpToPeak, manifest, on, paintStage, play as playFilm, seek, setTheme, setTime, setWindow, show, showTime, state, step, takeBlock, tell, toggleTheme, zoom, pose, poseTime, showMarks, forgetView, stage, toggleScale} from "../report/report.js";
import {every, h, one} from "./dom.js";
import {ask, get, getPacket, here, listenTo} from "./server.js";
import * as add from "./add.js";
import * as batch from "./batch.js";
import * as clock from "./clock.js";
import * as law from "./law.js";
import * as play from "./play.js";
import * as setup from "./setup.js";

const steps = {setup, clock, play, add, law, batch};
export const campaign = {state: null, panel: "", add, play}; // modules that others call are here, so that none imports in a circle
const listen = (selector, event, action) => every(selector).forEach(element => element.addEventListener(event, () => action(element)));

// What stands in the files: state first, then the series that the figures draw. One reading ends before the next begins, so
// that what is older never comes last; zoom and instant stay.
let reading = Promise.resolve();
export function reload() { return reading = reading.catch(() => undefined).then(read); }
async function read() {
  campaign.state = await standing("state");
  one("#title").textContent = campaign.state.name;
  document.title = `${campaign.state.name} · rfea workbench`;
  const {header, block} = await getPacket("evidence");
  const chosen = manifest.rungs[state.rung]?.model, run = experiment()?.name, span = experiment()?.span, [from, to] = state.window;
  takeBlock(block);
  Object.assign(manifest, header);
  forgetView(); stage.films.clear();
  play.keepLive();
  const now = manifest.rungs.findIndex(r => r.model === chosen);
  state.rung = now >= 0 ? now : Math.max(0, manifest.rungs.findLastIndex(r => !r.live));
  showRungs(); showNext(); showLog();
  for (const part of Object.values(steps)) part.reload?.(campaign.state);
  chooseExperiment(Math.max(0, manifest.experiments.findIndex(e => e.name === run)));
  const moved = experiment()?.name === run && span && experiment().span; // another offset of the clocks moves the whole run along
  if (moved) setWindow(from + moved[0] - span[0], to + moved[0] - span[0]);
  tell("rung");
}

// The ladder of the rail: every model with its errors; the one that is played stands last.
function showRungs() {
  const rungs = manifest.rungs, values = rungs.flatMap(r => [r.train, r.validate, r.floor]).filter(v => v > 0).map(Math.log10);
  const low = Math.min(...values) - 0.15, high = Math.max(...values) + 0.15, at = v => `${100 * (Math.log10(v) - low) / (high - low || 1)}%`;
  one("#rungs").replaceChildren(...rungs.map((r, i) => h("button", {type: "button", role: "radio", class: "rung", data: {rung: r.model}, aria: {checked: String(i === state.rung)}, tabIndex: i === state.rung ? 0 : -1, onclick: () => { pickRung(i); one("[role=radio][aria-checked=true]")?.focus(); }},
    h("span", {class: "key"}, r.live ? "◆" : String(i + 1)), h("span", {class: "name"}, r.name),
    h("span", {class: "dots", aria: {hidden: "true"}}, ...["floor", "train", "validate"].filter(kind => r[kind] > 0).map(kind => h("i", {class: kind, style: {left: at(r[kind])}}))),
    h("span", {class: "error"}, h("span", {class: "sr"}, "Error: "), `${show(r.validate ?? r.train, 3)} ${r.unit}`))));
  one("#rungs-legend").hidden = !rungs.length;
  toMiddle(one("#rungs"), one('#rungs [aria-checked="true"]'));
}
// In a narrow window steps and rungs are one line each.
function toMiddle(line, chosen) { if (chosen) line.scrollLeft = chosen.offsetLeft - line.offsetLeft - (line.clientWidth - chosen.offsetWidth) / 2; }
export function refreshRungs() { showRungs(); }
export function pickRung(index) { chooseRung(index); showRungs(); play.startFrom(manifest.rungs[index]); }

// One thing to do next, highlighted; it is the same sentence that the command line would end with.
function showNext() {
  const next = campaign.state.next, button = one("#next-do");
  one("#next-say").textContent = next.say;
  button.hidden = !next.label; button.textContent = next.label ?? "";
  one("#next-otherwise").hidden = !next.otherwise; one("#next-otherwise").textContent = next.otherwise?.label ?? "";
  one("#next-command").textContent = next.command ?? "";
  one("#next-report").hidden = !campaign.state.report; one("#next-report").classList.toggle("primary", !next.label); // nothing else is left to do
  for (const link of every(".places a")) link.classList.toggle("wanted", link.hash === `#/${next.panel}`);
}
export async function doNext(next = campaign.state?.next) {
  if (!next?.label) return;
  go(next.panel);
  if (next.experiment) {
    chooseExperiment(Math.max(0, manifest.experiments.findIndex(e => e.name === next.experiment)));
    if (next.panel === "setup") setup.pointAt(next.experiment, next.tool ?? "look");
  }
  if (next.do === "fit") add.want(next.options.add);
  if (next.do) await begin(next.do, next.options, next.label); else await guarded(reload);
  if (next.panel === "clock" && !next.do) one("#offset").focus();
}

// Begin a command on this campaign; what goes wrong is said on the page. From the click until what came of it is shown the
// page is busy.
export const begin = (what, options, label) => order("job", {do: what, options, label});
export async function order(address, body) {
  busy(true);
  if (!await guarded(() => ask(address, body))) busy(!one("#job").hidden);
}
export function busy(on_) { if (on_) document.documentElement.dataset.busy = "yes"; else delete document.documentElement.dataset.busy; }
export async function guarded(action) {
  try { one("#fault").hidden = true; return await action(); } catch (error) { complain(error.message); return undefined; }
}
export function complain(sentence) { const fault = one("#fault"); fault.textContent = sentence; fault.hidden = false; }

// The job that is under way, or none; the bar of one that is shown already goes on.
function showJob(job) {
  const box = one("#job");
  if (job) {
    one("#job-label").textContent = job.label || job.do; one("#job-command").textContent = job.command ?? "";
    if (box.hidden) { one("#job-say").textContent = ""; one("#job-bar").removeAttribute("value"); }
  }
  box.hidden = !job;
}
// An answer of the server with the job that is under way; that counts unless something was heard of one since it was asked.
let heard = 0;
export async function standing(path) {
  const before = heard, said = await get(path);
  if (before === heard && (said.job || !one("#job").hidden)) { showJob(said.job); busy(Boolean(said.job)); }
  return said;
}

const settled = new Set();
export function onJob(action) { settled.add(action); }
function hear(event) {
  const mine = event.index === here;
  if (event.event === "begun") { heard++; showJob(null); showJob(event); busy(true); }
  if (event.event === "stage") one("#job-say").textContent = `${event.stage} ${event.subject}`;
  if (event.event === "progress") { const bar = one("#job-bar"); bar.max = event.total || 1; if (event.total) bar.value = event.done; one("#job-say").textContent = `${event.stage} ${event.subject}: ${event.done} of ${event.total}`; }
  if (event.event === "note" || (event.event === "ended" && event.sentence)) one("#said").textContent = event.sentence;
  if (event.event === "note" && mine) guarded(reload);
  if (["finished", "failed", "stopped"].includes(event.event)) {
    heard++; showJob(null);
    const done = () => { if (event.event === "failed") complain(event.error); busy(!one("#job").hidden); }; // said last: what follows clears it
    if (mine) guarded(reload).then(() => settled.forEach(action => action(event))).then(done); else done();
  }
  for (const part of Object.values(steps)) part.hear?.(event, mine);
}

function showLog() { one("#log").textContent = campaign.state.log.map(line => line.command).join("\n") || "Nothing yet: each action adds its command here."; }

export function go(name) { location.hash = `#/${name}`; }
function route() {
  const wanted = location.hash.slice(2), name = wanted in steps ? wanted : here < 0 ? "batch" : steps[campaign.state?.next?.panel] ? campaign.state.next.panel : "play";
  campaign.panel = name;
  for (const panel of every("[data-panel]")) panel.hidden = panel.dataset.panel !== name;
  for (const link of every(".places a")) {
    if (link.hash !== `#/${name}`) { link.removeAttribute("aria-current"); continue; }
    link.setAttribute("aria-current", "step");
    toMiddle(one(".places"), link);
  }
  steps[name]?.shown?.();
  Figure.redraw(); paintStage();
}

// Keys; none of them while one types.
let going = false;
const nearer = way => campaign.panel === "setup" ? setup.closerLook(way) : zoom(way);
const keys = {
  ArrowLeft: event => step(event.shiftKey ? -10 : -1), ArrowRight: event => step(event.shiftKey ? 10 : 1), " ": () => playFilm(),
  "[": () => chooseExperiment(state.experiment - 1), "]": () => chooseExperiment(state.experiment + 1),
  "+": () => nearer("in"), "=": () => nearer("in"), "-": () => nearer("out"), 0: () => nearer("all"), t: toggleTheme, n: () => doNext(), "?": () => one("#help").showModal(),
};
function listenKeys() {
  addEventListener("keydown", event => {
    const at = event.target instanceof Element ? event.target : document.body;
    if (one("#help").open || at.matches("textarea, select, input:not([type=range]):not([type=checkbox])")) return;
    if ((event.ctrlKey || event.metaKey) && event.key === "z") { event.preventDefault(); return play.undo(); }
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (at.matches("button, summary, a, input[type=checkbox]") && event.key === " ") return;
    if (at.matches("input[type=range]") && event.key.startsWith("Arrow")) return;
    if (going && /^[1-6]$/.test(event.key)) { location.hash = every(".places a")[Number(event.key) - 1].hash; going = false; return; }
    going = event.key === "g";
    const ladder = at.closest(".ladder");
    if (ladder && (event.key === "ArrowUp" || event.key === "ArrowDown")) { event.preventDefault(); return pickRung(Math.min(manifest.rungs.length - 1, Math.max(0, state.rung + (event.key === "ArrowDown" ? 1 : -1)))); }
    const action = keys[event.key] ?? keys[event.key.toLowerCase()];
    if (action) { event.preventDefault(); action(event); }
  });
}

function wire() {
  listen("#theme", "click", toggleTheme);
  listen("#keys", "click", () => one("#help").showModal());
  listen("#next-do", "click", () => doNext());
  listen("#next-otherwise", "click", () => doNext(campaign.state.next.otherwise));
  listen("#job-stop", "click", () => guarded(() => ask("../../stop", {})));
  listen("[data-zoom]", "click", element => zoom(element.dataset.zoom));
  listen("#scrub", "input", element => setTime(poseTime(Number(element.value))));
  listen("#play", "click", () => playFilm());
  listen("#lens, #outline", "change", paintStage);
  listen(".same-scale", "change", element => toggleScale(element.checked));
  listenKeys();
  on("rung experiment", showMarks);
  on("rung", () => { Figure.redraw(); paintStage(); });
  on("experiment", () => { const e = experiment(); if (e?.tp) one("#scrub").max = e.tp.shape[0] - 1; Figure.redraw(); paintStage(); });
  on("window", () => Figure.redraw());
  on("time", () => { showTime(); Figure.move(); seek(); paintStage(); });
  new ResizeObserver(() => paintStage()).observe(stage.canvas.parentElement);
  addEventListener("hashchange", route);
  let lines = 0;
  listenTo(hear, () => { if (lines++ || !one("#job").hidden) guarded(here < 0 ? batch.shown : reload); });
}

// Like the report, begin where the first rung fails most: a tube at rest shows nothing.
function beginAtWorst() {
  const worst = manifest.rungs[0]?.worst[0], index = manifest.experiments.findIndex(e => e.name === worst?.experiment);
  if (index < 0) return;
  chooseExperiment(index);
  jumpToPeak(worst.from_s, worst.to_s);
}

async function start() {
  setTheme(document.documentElement.dataset.theme);
  state.same = false;
  for (const element of every("[data-figure][data-height]")) element.style.setProperty("--height", `${element.dataset.height}px`);
  for (const part of Object.values(steps)) part.build?.();
  Figure.all = every("[data-figure]").map(element => new Figure(element));
  wire();
  if (here >= 0) { await guarded(reload); beginAtWorst(); } else document.body.classList.add("folder");
  delete document.documentElement.dataset.reading;
  route();
  document.documentElement.dataset.ready = "yes";
}
start();
