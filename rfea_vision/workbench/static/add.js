// Add and watch: ticks say which effects the model should have. A model with these is shown at once; else it is fitted, and its rung appears.
import {area, axisX, axisY, extent, Figure, manifest, on, padded, plots, scale, show, state, ticks} from "../report/report.js";
import {every, figure, h, one} from "./dom.js";
import {ask} from "./server.js";
import {begin, campaign, guarded, onJob, pickRung} from "./main.js";

let wanted = null; // ids of the effects that are ticked
let picked = null; // model of the rung that they were taken from
let atBegin = null; // the ticks when the job began that is under way
const same = (a, b) => a.length === b.length && a.every(id => b.includes(id));
const rungs = () => manifest.rungs.filter(r => !r.live);
const rungWith = effects => rungs().find(r => same(r.effects, effects));
// The candidates come from the richest model below the wanted one that has been asked what it lacks.
const judge = () => rungs().filter(r => r.diagnosis && r.effects.every(id => wanted.includes(id))).sort((a, b) => b.effects.length - a.effects.length)[0];

export const segments = () => (judge() ?? rungs()[0])?.segments;

export function build() {
  one('[data-panel="add"]').append(
    h("h2", {}, "Add and watch"),
    h("p", {class: "lead", id: "verdict"}),
    h("div", {class: "adding"},
      h("div", {},
        h("div", {class: "scroll"}, h("table", {id: "candidates", class: "candidates"}, h("caption", {class: "sr"}, "Effects that may be missing, best first"))),
        h("p", {class: "muted", id: "columns"}, "Probability: that the tube has the effect. Share: how much of the error above the noise floor goes with it. Predicted: the held-out error expected before anything is fitted; held out: what it was once fitted. The noise floor is what the measurement alone leaves."),
        h("details", {id: "others"}, h("summary", {}, "Effects that were screened and promise little"), h("div", {id: "screened"})),
        h("div", {class: "buttons"}, h("button", {type: "button", id: "fit-ticked", onclick: fitTicked}, "Fit with these"), h("button", {type: "button", id: "ask-missing", onclick: askMissing}, "Ask what is missing"), h("button", {type: "button", id: "climb", onclick: () => begin("improve", {}, "Climb the ladder")}, "Do it all, up to a verdict"))),
      h("div", {}, figure("rungs", "The error falls", "Training and held-out error of every model, on a logarithmic scale", 300),
        h("p", {class: "legend"}, h("i", {class: "validate"}), " held-out ", h("i", {class: "train"}), " training ", h("i", {class: "floor"}), " noise floor"))),
    h("div", {id: "ties"}),
    h("section", {id: "next-run", hidden: true},
      h("h3", {}, "The experiment to run next"), h("p", {id: "next-run-say"}),
      figure("curve", "Pressure to command", "Pressure over time of the next experiment. Drag its points, or choose one with left and right and move it with up and down", 240),
      h("p", {class: "muted", id: "limits"}),
      h("div", {class: "buttons"}, h("button", {type: "button", id: "save-curve", onclick: saveCurve}, "Save as a pressure file"), h("button", {type: "button", id: "reset-curve", onclick: () => { curve.of = null; takeCurve(); Figure.redraw(); }}, "As proposed"), h("span", {id: "saved", class: "muted", role: "status"}))));
  editCurve(one('[data-figure="curve"] .canvas'));
  onJob(event => { // what was fitted is shown, unless other effects have been ticked meanwhile
    const fitted = event.do === "fit" && event.result ? manifest.rungs.findIndex(r => r.model === event.result.model) : -1;
    if (fitted >= 0 && atBegin === wanted) pickRung(fitted);
  });
  on("rung", () => { // another one has been picked; the same one read anew leaves the ticks as they are
    const r = manifest.rungs[state.rung];
    if (!r || r.live || r.model === picked) return;
    picked = r.model;
    want(r.effects);
  });
}

export function reload() {
  const last = rungs().at(-1);
  wanted ??= last ? [...last.effects] : [];
  showAll();
}
export function hear(event, mine) { if (mine && event.event === "begun") atBegin = wanted; }
export function want(effects) { wanted = [...effects]; showAll(); }

function showAll() {
  if (!wanted) return;
  const from = judge(), there = rungWith(wanted), d = from?.diagnosis;
  one("#verdict").textContent = !rungs().length ? "No model has been fitted yet." : there?.diagnosis?.sentence || d?.sentence || "Nobody has asked yet what this model lacks.";
  showCandidates(d);
  const fit = one("#fit-ticked");
  fit.disabled = Boolean(there) || !rungs().length; fit.textContent = there ? "Fitted already" : `Fit with ${wanted.length ? wanted.join(" + ") : "no effect"}`;
  fit.classList.toggle("primary", !fit.disabled);
  one("#ask-missing").hidden = !there || Boolean(there.diagnosis);
  showTies(there?.diagnosis ?? d);
  takeCurve();
  Figure.redraw();
}

// -- candidates ----------------------------------------------------------------------------------------------------------
const percent = value => value === null || value === undefined ? "–" : `${Math.round(100 * value)} %`.replace("-", "−");
function showCandidates(d) {
  const unit = rungs()[0]?.unit ?? "mm", candidates = d?.candidates ?? [], known = new Map(candidates.map(c => [c.effect, c]));
  const ticked = wanted.filter(id => !known.has(id)).map(candidateOf);
  const tried = [...ticked, ...candidates.filter(c => c.effect !== "segments" && (c.refitted || wanted.includes(c.effect) || (c.probability ?? 0) >= 0.05))], rest = candidates.filter(c => c.effect !== "segments" && !tried.includes(c));
  const of = (c, kind) => c[`${kind}_rmse_${unit}`];
  const row = c => h("tr", {class: d?.named?.includes(c.effect) ? "named" : ""},
    h("td", {}, h("input", {type: "checkbox", value: c.effect, checked: wanted.includes(c.effect), aria: {label: `Add ${c.title}`}, onchange: event => tick(c.effect, event.target.checked)})),
    h("th", {scope: "row"}, c.title, c.at ? h("small", {class: "muted"}, ` at ${c.at}`) : null, c.form ? h("small", {class: "muted"}, ` ${c.form}`) : null),
    h("td", {class: "n"}, bar(c.probability)), h("td", {class: "n wide"}, c.share < -1 ? "worse" : percent(c.share)), h("td", {class: "n muted wide"}, show(of(c, "predicted"), 3)), h("td", {class: "n strong"}, show(of(c, "validate"), 3)),
    h("td", {}, h("button", {type: "button", class: "plain", aria: {label: `Play ${c.title}`}, onclick: () => campaign.play.addEffects([...new Set([...wanted, c.effect])])}, "play")));
  const head = h("thead", {}, h("tr", {}, h("td", {}, h("span", {class: "sr"}, "Add")), ...[["Effect", ""], ["Probability", "n"], ["Share", "n wide"], [`Predicted, ${unit}`, "n wide"], [`Held out, ${unit}`, "n"], ["", ""]].map(([text, kind]) => h("th", {scope: "col", class: kind}, text))));
  one("#candidates").replaceChildren(h("caption", {class: "sr"}, "Effects that may be missing, best first"), head, h("tbody", {}, ...tried.map(row)));
  one("#candidates").hidden = one("#columns").hidden = !tried.length;
  one("#others").hidden = !rest.length;
  one("#screened").replaceChildren(...rest.map(c => h("label", {class: "screened"}, h("input", {type: "checkbox", checked: wanted.includes(c.effect), onchange: event => tick(c.effect, event.target.checked)}), c.title)));
}
// What is added already is no candidate any more: what was said of it on the last rung that lacked it.
const candidateOf = id => rungs().toReversed().flatMap(r => r.diagnosis?.candidates ?? []).find(c => c.effect === id) ?? {effect: id, title: id.replaceAll("_", " ")};
const titleOf = id => candidateOf(id).title;
const bar = value => value === null || value === undefined ? "–" : h("span", {class: "probability"}, h("span", {class: "share", aria: {hidden: "true"}}, h("i", {style: {width: `${100 * value}%`}})), percent(value));

function tick(id, on_) {
  wanted = on_ ? [...wanted, id] : wanted.filter(other => other !== id);
  const there = rungWith(wanted);
  if (there) pickRung(manifest.rungs.indexOf(there)); // untick, and it is back
  showAll();
  every("#candidates input").find(box => box.value === id)?.focus();
}
function fitTicked() { begin("fit", {add: wanted, segments: segments()}, `Fit with ${wanted.join(" + ") || "no effect"}`); }
function askMissing() { begin("diagnose", {model: rungWith(wanted).model}, "Ask what is missing"); }

function showTies(d) {
  const ties = (d?.tied ?? []).map(tie => h("p", {class: "tie"}, h("b", {}, tie.effects.map(titleOf).join(" and ")), ` cannot be told apart by these data. What would split them: ${tie.split_by || "another experiment"}.`));
  const sets = (d?.sets ?? []).slice(0, 4).filter(set => set.effects.length > 1).map(set => h("li", {}, h("button", {type: "button", class: "plain", onclick: () => { want(set.effects); }}, set.effects.map(titleOf).join(" + ")), ` ${percent(set.probability)} probable, ${percent(set.share)} of the error above the floor`));
  const left = d?.remainder?.sentence ? h("p", {class: "muted"}, d.remainder.sentence) : null;
  one("#ties").replaceChildren(...ties, ...(sets.length ? [h("h3", {}, "Together"), h("ul", {}, ...sets)] : []), ...(left ? [left] : []));
}

// Per model the place of the one that it was made from: the largest before it whose effects it has all; a fit beside the ladder
// hangs from its own, and is no step to the next.
export const standsOn = effects => effects.map((own, i) => effects.slice(0, i).reduce((best, other, j) => other.length < own.length && other.every(e => own.includes(e)) && (best < 0 || other.length >= effects[best].length) ? j : best, -1));

// -- the error falls ---------------------------------------------------------------------------------------------------------
plots.rungs = {
  need: () => rungs().length ? undefined : "No model has been fitted yet.",
  draw(pen) {
    const all = rungs(), chosen = all.indexOf(rungWith(wanted)), c = pen.colours, box = area(pen, {left: 58, top: 12, bottom: 46}), values = all.flatMap(r => [r.train, r.validate, r.floor]).filter(v => v > 0).map(Math.log10);
    const [low, high] = padded(extent(values), 0.12), y = scale(low, high, box.bottom, box.top), x = i => box.left + (i + 0.5) * (box.right - box.left) / all.length;
    for (const power of ticks(low, high, 4)) { pen.line([box.left, box.right], [y(power), y(power)], c.grid, 1); pen.text(show(10 ** power, 2), box.left - 7, y(power), {align: "right"}); }
    pen.text(all[0].unit, 11, (box.top + box.bottom) / 2, {align: "center", turn: -90});
    const below_ = standsOn(all.map(r => r.effects)), floor = all.at(-1).floor;
    if (floor > 0) pen.line([box.left, box.right], [y(Math.log10(floor)), y(Math.log10(floor))], c.good, 1.5, [5, 4]);
    for (const key of ["train", "validate"]) {
      const known = all.map((r, i) => [i, r[key]]).filter(([, v]) => v > 0);
      for (const [i, v] of known) { const below = known.findLast(([j]) => j === below_[i]); if (below) pen.line([x(below[0]), x(i)], [y(Math.log10(below[1])), y(Math.log10(v))], c.hair, 1.5); }
      for (const [i, v] of known) pen.dot(x(i), y(Math.log10(v)), i === chosen ? 6.5 : 4.5, key === "validate" ? (i === chosen ? c.accent : c.ink) : c.paper, key === "train" ? c.ink : c.paper);
    }
    all.forEach((r, i) => pen.text(r.effects.length ? `+ ${r.effects.at(-1)}` : "base", x(i), box.bottom + 10, {align: "center", base: "top", colour: i === chosen ? c.ink : c.muted, bold: i === chosen}));
  },
  pick(px, py, figure_) { const all = rungs(), box = area(figure_.size(), {left: 58}); const i = Math.floor((px - box.left) / (box.right - box.left) * all.length); if (all[i]) { want(all[i].effects); pickRung(i); } },
};

// -- the next experiment: a curve of few points within what the rig has done so far ---------------------------------------------
const curve = {points: null, chosen: 0, limits: {low: 0, high: 300, slope: 1000}, of: null};
function takeCurve() {
  const r = rungWith(wanted) ?? judge(), next = r?.next ?? judge()?.next, said = (r?.diagnosis ?? judge()?.diagnosis)?.next_experiment;
  one("#next-run").hidden = !next;
  const of = next ? JSON.stringify(next) : null;
  if (of !== null && of === curve.of) return; // the same one read anew leaves what was edited
  curve.of = of;
  if (!next) { curve.points = null; return; }
  curve.chosen = 0;
  curve.points = simplified(next[0].map((t, i) => [t, next[1][i]]));
  curve.model = (r?.next ? r : judge()).model;
  curve.limits = manifest.limits ?? curve.limits;
  one("#next-run-say").textContent = said?.sentence ?? "";
  one("#limits").textContent = `Within what this rig has done: ${Math.round(curve.limits.low)} to ${Math.round(curve.limits.high)} kPa, at most ${Math.round(curve.limits.slope)} kPa/s.`;
  one("#saved").textContent = "";
}
// Douglas and Peucker 1973: the fewest points from which the curve is nowhere farther than a hundredth of its range.
function simplified(points) {
  const [low, high] = extent(points.map(p => p[1])), far = (high - low || 1) / 100;
  const keep = (from, to) => {
    let worst = 0, at = -1;
    for (let i = from + 1; i < to; i++) { const f = (points[i][0] - points[from][0]) / (points[to][0] - points[from][0]), gap = Math.abs(points[i][1] - points[from][1] - f * (points[to][1] - points[from][1])); if (gap > worst) [worst, at] = [gap, i]; }
    return worst > far ? [...keep(from, at), ...keep(at, to).slice(1)] : [points[from], points[to]];
  };
  return keep(0, points.length - 1).map(p => [...p]);
}
const curveBox = size => area(size, {top: 10, bottom: 34});
function curveScales(box) { const time = curve.points.map(p => p[0]); return [scale(time[0], time.at(-1), box.left, box.right), scale(...padded([curve.limits.low, curve.limits.high]), box.bottom, box.top)]; }
plots.curve = {
  need: () => curve.points ? undefined : "No further experiment is asked for.",
  draw(pen) {
    const box = curveBox(pen), [x, y] = curveScales(box), c = pen.colours;
    axisY(pen, box, y, "pressure in kPa"); axisX(pen, box, x, "time in s");
    pen.line([box.left, box.right], [y(curve.limits.high), y(curve.limits.high)], c.bad, 1, [5, 4]);
    pen.line(curve.points.map(p => x(p[0])), curve.points.map(p => y(p[1])), c.accent, 2);
    curve.points.forEach(([t, p], i) => pen.dot(x(t), y(p), i === curve.chosen ? 6 : 4, i === curve.chosen ? c.accent : c.paper, c.accent));
  },
};
// A point moves only as far as the limits of pressure and of its slope to both neighbours allow.
function moveTo(i, pressure) {
  const {low, high, slope} = curve.limits, p = curve.points;
  let from = low, to = high;
  for (const j of [i - 1, i + 1]) if (p[j]) { const reach = slope * Math.abs(p[j][0] - p[i][0]); from = Math.max(from, p[j][1] - reach); to = Math.min(to, p[j][1] + reach); }
  if (from <= to) p[i][1] = Math.min(to, Math.max(from, pressure));
  one("#saved").textContent = "";
  Figure.redraw();
}
function editCurve(holder) {
  let held = -1;
  holder.tabIndex = 0; holder.classList.add("pick");
  const size = () => ({width: holder.clientWidth, height: holder.clientHeight});
  holder.addEventListener("pointerdown", event => {
    const r = holder.getBoundingClientRect(), [x, y] = curveScales(curveBox(size())), at = [event.clientX - r.left, event.clientY - r.top];
    const distance = curve.points.map(p => Math.hypot(x(p[0]) - at[0], y(p[1]) - at[1]));
    held = distance.indexOf(Math.min(...distance)); curve.chosen = held; holder.setPointerCapture(event.pointerId); Figure.redraw();
  });
  holder.addEventListener("pointermove", event => { if (held >= 0) moveTo(held, curveScales(curveBox(size()))[1].back(event.clientY - holder.getBoundingClientRect().top)); });
  for (const end of ["pointerup", "pointercancel"]) holder.addEventListener(end, () => { held = -1; });
  holder.addEventListener("keydown", event => {
    const along = {ArrowLeft: -1, ArrowRight: 1}[event.key], up = {ArrowUp: 1, ArrowDown: -1}[event.key];
    if (!along && !up) return;
    event.preventDefault(); event.stopPropagation();
    if (along) { curve.chosen = Math.min(curve.points.length - 1, Math.max(0, curve.chosen + along)); Figure.redraw(); } else moveTo(curve.chosen, curve.points[curve.chosen][1] + up * (event.shiftKey ? 10 : 1));
  });
}
async function saveCurve() {
  const said = await guarded(() => ask("curve", {model: curve.model, points: curve.points}));
  if (said) one("#saved").textContent = `${said.file} written. ${said.command}`;
}
