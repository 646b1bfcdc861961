// Play the model: sliders move, the modelled tube follows. One request at a time; of those that wait only the last counts.
import {chooseExperiment, chooseRung, experiment, Figure, manifest, on, paintStage, show, state} from "../report/report.js";
import {every, h, one} from "./dom.js";
import {ask, get, packetOf, post, unpack} from "./server.js";
import {begin, campaign, complain, go, guarded, onJob, refreshRungs} from "./main.js";

// model: name of the fit it starts from; effects: ids; values: what the sliders say, in SI; sliders: as the server describes them
const chosen = {model: null, effects: [], values: {}, sliders: [], ready: false};
const past = []; // for undo: {model, effects, values} before every change
const live = {model: "live", name: "What you play", live: true, unit: "mm", train: null, validate: null, floor: null, phases: [], pressures: [], segments: [], worst: [], profiles: [], why: {}, experiments: {}, runs: {}};
const fitted = () => manifest.rungs.find(r => r.model === chosen.model);

// -- sliders: position 0..1000 to value and back --------------------------------------------------------------------
const ends = s => s.course === "log" ? [Math.log(s.low), Math.log(s.high)] : s.course === "cubic" ? [-Math.cbrt(s.zero - s.low), Math.cbrt(s.high - s.zero)] : [s.low, s.high];
function valueAt(s, place) {
  const [a, b] = ends(s), v = a + (b - a) * place / 1000;
  return s.course === "log" ? Math.exp(v) : s.course === "cubic" ? s.zero + v ** 3 : v;
}
function placeOf(s, value) {
  const [a, b] = ends(s), v = s.course === "log" ? Math.log(value) : s.course === "cubic" ? Math.cbrt(value - s.zero) : value;
  return Math.min(1000, Math.max(0, 1000 * (v - a) / (b - a || 1)));
}

// What follows within this time on the same slider is one move, and is undone as one.
const ONE_MOVE_MS = 1500;
let moved = {name: "", at: 0};

function sliderRow(s) {
  const value = chosen.values[s.name] ?? s.value;
  const input = h("input", {type: "range", min: "0", max: "1000", step: "1", id: `slider-${s.name}`, data: {name: s.name}, aria: {label: s.text ? `${s.name}: ${s.text}` : s.name}});
  input.value = placeOf(s, value);
  const output = h("output", {class: "value"});
  const tell = v => { output.textContent = `${show(v, 4)} ${s.unit === "1" ? "" : s.unit.replaceAll("*", " ").replaceAll("^2", "²").replaceAll("^3", "³")}`; input.setAttribute("aria-valuetext", output.textContent); };
  tell(value);
  input.addEventListener("input", () => {
    const now = performance.now();
    if (moved.name !== s.name || now - moved.at > ONE_MOVE_MS) remember();
    moved = {name: s.name, at: now};
    chosen.values[s.name] = valueAt(s, Number(input.value));
    tell(chosen.values[s.name]); look();
  });
  const band = s.interval ? h("i", {class: "band", style: {left: `${placeOf(s, Math.max(s.low, s.interval[0])) / 10}%`, width: `${(placeOf(s, Math.min(s.high, s.interval[1])) - placeOf(s, Math.max(s.low, s.interval[0]))) / 10}%`}}) : null;
  return h("div", {class: "slider"}, h("label", {htmlFor: input.id}, h("code", {}, s.name)), output, s.text ? h("small", {}, s.text) : null, h("span", {class: "track"}, band, input));
}

const titleOf = effect => { const words = effect.replaceAll("_", " "); return words[0].toUpperCase() + words.slice(1); };
function showSliders() {
  const groups = new Map([[null, []]]);
  for (const s of chosen.sliders) { if (!groups.has(s.effect)) groups.set(s.effect, []); groups.get(s.effect).push(sliderRow(s)); }
  one("#sliders").replaceChildren(...[...groups].flatMap(([effect, rows]) => [h("h3", {}, effect ? titleOf(effect) : "The paper's model"), ...rows]));
  for (const box of every("#effects input")) box.checked = chosen.effects.includes(box.value);
  one("#undo").disabled = !past.length;
}

function remember() {
  past.push({model: chosen.model, effects: [...chosen.effects], values: {...chosen.values}});
  if (past.length > 100) past.shift();
  one("#undo").disabled = false;
}
export async function undo() {
  const earlier = past.pop();
  if (!earlier) return;
  moved = {name: "", at: 0};
  await open(earlier.model, earlier.effects, earlier.values);
}

// -- which model -----------------------------------------------------------------------------------------------------
async function open(model, effects, values = {}) {
  if (model !== chosen.model) live.seen = false;
  Object.assign(chosen, {model, effects, values: {...values}});
  if (!chosen.sliders.length) one("#look").textContent = "The model is being loaded: its sliders come in a moment.";
  const said = await guarded(() => ask("model", {model, effects}));
  if (!said || chosen.effects !== effects) return; // the list itself: another one has been asked for since
  chosen.sliders = said.sliders; chosen.ready = said.ready;
  showSliders();
  one("#look").textContent = said.ready ? "" : "Compiling the law of this combination: the first look takes some seconds.";
  live.before = fitted(); live.floor = fitted()?.floor; live.unit = fitted()?.unit ?? "mm";
  live.effects = effects;
  look();
}
// A model that was fitted anew under its name has other sliders; the same ones stay, for one of them may be held.
async function refresh() {
  const {model, effects} = chosen, said = await guarded(() => ask("model", {model, effects}));
  if (!said || effects !== chosen.effects) return;
  if (JSON.stringify(said.sliders) !== JSON.stringify(chosen.sliders)) { chosen.sliders = said.sliders; showSliders(); }
  look();
}
export function startFrom(rung) {
  if (!rung || rung.live) return;
  picked++; clearTimeout(rest);
  if (rung.model === chosen.model) return;
  past.length = 0;
  open(rung.model, [...rung.effects]);
  keepLive(); refreshRungs();
}
export const effects = () => chosen.effects;
export function forgetEffects() { one("#effects").replaceChildren(); if (one("#more-effects").open) showEffects(); }
export async function addEffects(effects) { remember(); await open(chosen.model, effects, chosen.values); go("play"); }

// -- looking: coalesced ------------------------------------------------------------------------------------------------
// While sliders move, looks take long steps; when they have come to rest, one more is taken in the steps of a fit.
let busy = false, again = false, rest = 0, picked = 0; // picked: how often a rung was chosen to be seen as it was fitted
const RESTING_MS = 350;
export function look() {
  if (campaign.panel !== "play") return;
  again = true; clearTimeout(rest);
  document.documentElement.dataset.look = "asked";
  if (!busy) next();
}
export function shown() { look(); }
async function next(exact = false) {
  busy = true;
  for (; again; exact = false) { // what moved meanwhile is looked at quickly again
    again = false;
    const run = experiment()?.name, begun = performance.now();
    if (!chosen.model || !run || !(run in (fitted()?.experiments ?? {})) || !["train", "validate"].includes(experiment().role)) break;
    const {model, effects, values} = chosen, before = picked, asFitted = untouched() && fitted().experiments[run]?.unit;
    if (asFitted) { showLook(fitted(), fitted().experiments, true); prepare(run); continue; }
    try {
      const {header, block} = await packetOf(await post("play", {model, effects, values, experiment: run, exact}));
      chosen.ready = true;
      if (campaign.panel !== "play" || effects !== chosen.effects || run !== experiment()?.name || before !== picked) continue; // something else was asked for since
      showLook(header, {[run]: unpack(header.run, block)}, exact);
      await new Promise(requestAnimationFrame);
      if (exact) continue;
      document.documentElement.dataset.lookMs = String(performance.now() - begun);
      one("#look").textContent = `${Math.round(performance.now() - begun)} ms from slider to picture`;
      rest = setTimeout(settle, RESTING_MS);
    } catch (error) { complain(error.message); break; }
  }
  busy = false;
}
// The law of what stands as it was fitted is made ready beside, so that neither figures nor the next look wait for it.
let prepared = null;
function prepare(run) {
  const {model, effects, values} = chosen;
  if (chosen.ready || prepared === effects) return;
  prepared = effects;
  post("play", {model, effects, values, experiment: run}).then(() => { if (effects === chosen.effects) { chosen.ready = true; one("#look").textContent = ""; } }).catch(error => complain(error.message));
}
// A slider that is held may move on at any moment, and must not wait for an exact look.
function settle() {
  if (campaign.panel !== "play") return;
  if (document.querySelector("#sliders :active")) { rest = setTimeout(settle, RESTING_MS); return; }
  again = true;
  if (!busy) next(true);
}
// With nothing touched what is played is the fit itself: its own figures, at once; the law is compiled meanwhile.
const untouched = () => !Object.keys(chosen.values).length && chosen.effects.join() === fitted().effects.join();
function showLook({train, validate, unit, runs}, experiments, exact) {
  Object.assign(live, {seen: true, train, validate, unit, runs, experiments});
  keepLive();
  const index = manifest.rungs.indexOf(live);
  if (state.rung !== index) chooseRung(index); else { Figure.redraw("pressure"); paintStage(); }
  refreshRungs(); showScores(exact);
  document.documentElement.dataset.look = exact ? "exact" : "quick";
}

// The model that is played is the last rung, once it has been looked at and as long as there is one.
export function keepLive() {
  const without = manifest.rungs.filter(r => !r.live);
  if (live.experiments === live.before?.experiments) live.experiments = fitted()?.experiments ?? {}; // read anew
  manifest.rungs = live.seen && without.some(r => r.model === chosen.model) ? [...without, live] : without;
  live.before = fitted();
}

function showScores(exact) {
  const unit = live.unit, of = r => r === null || r === undefined ? "–" : `${show(r, 3)} ${unit}`;
  one("#now-validate").textContent = of(live.validate); one("#now-train").textContent = of(live.train);
  const before = fitted();
  for (const [id, key] of [["#now-validate", "validate"], ["#now-train", "train"]]) {
    const better = live[key] < before?.[key] - 5e-4, worse = live[key] > before?.[key] + 5e-4;
    if (exact) one(id).className = better ? "better" : worse ? "worse" : "";
  }
  const role = {train: "training", validate: "held out"};
  one("#scores").replaceChildren(...manifest.experiments.filter(e => e.role in role && e.name in live.runs).map(e => h("tr", {class: e.name === experiment()?.name ? "on" : ""},
    h("th", {scope: "row"}, e.name, " ", h("small", {class: "muted"}, role[e.role])), h("td", {class: "n strong"}, of(live.runs[e.name])), h("td", {class: "n muted"}, of(before?.runs?.[e.name])))));
}

function showRuns() {
  one("#play-runs").replaceChildren(...manifest.experiments.map((e, i) => ["train", "validate"].includes(e.role) ? h("button", {type: "button", role: "tab", data: {run: e.name}, aria: {selected: String(i === state.experiment)}, onclick: () => chooseExperiment(i)}, e.name, " ", h("small", {}, e.role)) : null).filter(Boolean));
}

async function showEffects() {
  const listed = await guarded(() => get("effects"));
  const kinds = {tube: "The tube", load: "Loads", pressure: "Pressure", measurement: "Measurement"}, groups = Object.groupBy(listed ?? [], effect => effect.own ? "own" : effect.kind);
  one("#effects").replaceChildren(...Object.entries(groups).map(([kind, effects]) => h("fieldset", {}, h("legend", {}, kind === "own" ? "Laws of your own" : kinds[kind] ?? kind),
    ...effects.map(effect => h("label", {title: effect.shows}, h("input", {type: "checkbox", value: effect.id, checked: chosen.effects.includes(effect.id), onchange: event => toggle(effect.id, event.target.checked)}), effect.title)))));
}
function toggle(id, wanted) {
  remember();
  open(chosen.model, wanted ? [...chosen.effects, id] : chosen.effects.filter(effect => effect !== id), chosen.values);
}

// The fit begins where the sliders stand, and nowhere else; when it is there they go to what it found, and "undo" leads back.
const FROM_HERE = "Fit from here";
let fromHere = null; // the effects that it is made with
function fitHere() {
  fromHere = chosen.effects;
  const start = Object.fromEntries(chosen.sliders.map(s => [s.name, `${(chosen.values[s.name] ?? s.value).toPrecision(8)} ${s.unit === "1" ? "" : s.unit}`.trim()]));
  begin("fit", {add: chosen.effects, segments: fitted().segments, start}, FROM_HERE);
}

export function build() {
  one("#undo").addEventListener("click", undo);
  one("#as-fitted").addEventListener("click", () => { remember(); open(chosen.model, [...(fitted()?.effects ?? [])]); });
  one("#fit-here").addEventListener("click", fitHere);
  one("#more-effects").addEventListener("toggle", event => { if (event.target.open && !one("#effects").children.length) showEffects(); });
  on("experiment", () => { showRuns(); look(); });
  onJob(event => { // another combination that was opened meanwhile stays
    if (event.label === FROM_HERE && event.result && fromHere === chosen.effects) { remember(); open(event.result.model, [...fromHere]); }
  });
}
export function reload() {
  one("#no-model").hidden = manifest.rungs.some(r => !r.live);
  showRuns();
  const rungs = manifest.rungs.filter(r => !r.live);
  if (!rungs.some(r => r.model === chosen.model)) { const last = rungs.at(-1); if (last) open(last.model, [...last.effects]); } else refresh();
}
