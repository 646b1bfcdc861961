// Everything over time: five linked curves and the cursor they share.
const timeBox = pen => area(pen, {right: 14, top: 6, bottom: pen.height < 125 && !Figure.saving ? 8 : 32}); // low ones are stacked above one that has the labels
const timeScale = box => scale(...state.window, box.left, box.right);

function cursorAt(pen, box, dots = []) {
  const x = timeScale(box)(state.time);
  if (x < box.left - 1 || x > box.right + 1) return;
  pen.line([x, x], [box.top, box.bottom], pen.colours.ink, 1);
  for (const [y, colour] of dots) if (y === y) pen.dot(x, y, 3.5, colour, pen.colours.paper);
}

function shadeGaps(pen, box, x) {
  for (const gap of experiment().gaps) pen.rect(x(gap.from) - 0.5, box.top, Math.max(1.5, x(gap.to) - x(gap.from)), box.bottom - box.top, pen.colours.bad, 0.16);
}

// Curves over time: `measured`, `modelled` and `band`, half of its 95 % interval, are functions that give a series or undefined.
function timePlot({times, measured, modelled, band, unit, digits = 3, limits, extra, label = false}) {
  const unitNow = () => typeof unit === "function" ? unit() : unit;
  const span = box => {
    const all = [measured?.(), ...manifest.rungs.map(r => modelled?.(prediction(r)))];
    return scale(...(limits?.() ?? padded(extent(...all))), box.bottom, box.top);
  };
  const value = array => array?.[nearest(times(), state.time)];
  return {
    unitNow,
    draw(pen) {
      const box = timeBox(pen), x = timeScale(box), y = span(box), xs = x.all(times()), c = pen.colours;
      axisY(pen, box, y, unitNow()); if (label || Figure.saving) axisX(pen, box, x, "time in s"); else pen.line([box.left, box.right], [box.bottom, box.bottom], c.hair, 1);
      pen.clip(box.left, box.top - 4, box.right - box.left, box.bottom - box.top + 8, () => {
        shadeGaps(pen, box, x);
        extra?.(pen, box, x, y);
        const before = modelled?.(predictionBefore()), model = modelled?.(prediction()), real = measured?.();
        const half = model && band?.(prediction());
        if (half) { const at = [...model.keys()].filter(i => model[i] === model[i] && half[i] === half[i]); pen.area(at.map(i => xs[i]), at.map(i => y(model[i] - half[i])), at.map(i => y(model[i] + half[i])), c.modelled, 0.22); }
        if (before) pen.line(xs, y.all(before), c.earlier, 1.2, [4, 3]);
        if (real) pen.line(xs, y.all(real), c.measured, 2.2);
        if (model) pen.line(xs, y.all(model), c.modelled, 1.5);
      });
    },
    cursor(pen) {
      const box = timeBox(pen), y = span(box), c = pen.colours;
      cursorAt(pen, box, [[y(value(measured?.()) ?? NaN), c.measured], [y(value(modelled?.(prediction())) ?? NaN), c.modelled]]);
    },
    readout() {
      const real = value(measured?.()), model = value(modelled?.(prediction()));
      return [real !== undefined && `<b class="m">${show(real, digits)}</b>`, model !== undefined && `<b class="f">${show(model, digits)}</b>`].filter(Boolean).join(" · ") + ` ${unitNow()}`;
    },
    drag(px, py, figure) { setTime(timeScale(timeBox(figure.size())).back(px)); },
  };
}

const noExperiment = () => experiment() ? undefined : "No experiment has been tracked yet.";
const needs = (...checks) => () => { for (const check of [noExperiment, ...checks]) { const why = check(); if (why) return why; } return undefined; };
const measuredNeeds = (key, about = key) => () => experiment()[key] ? undefined : experiment().why[about] ?? experiment().why.recording ?? `The recording of ${experiment().name} does not carry this.`;
const modelNeeds = key => () => {
  if (!rung()) return "No model has been fitted yet: run rfea fit or rfea improve.";
  const p = prediction();
  return p?.[key] ? undefined : p?.why[key] ?? p?.why.prediction ?? `${rung().model} has no prediction for ${experiment().name}.`;
};

const frameTimes = () => series(experiment().t);
plots.pressure = timePlot({times: () => series(experiment().lt), measured: () => series(experiment().lp), unit: "kPa"});
plots.pressure.need = needs(measuredNeeds("lp", "pressure"));
plots["tip-x"] = timePlot({times: frameTimes, measured: () => column(series(experiment().tip), 0), modelled: p => column(series(p?.tip), 0), band: p => column(series(p?.tip_band), 0), unit: "mm", digits: 4});
plots["tip-y"] = timePlot({times: frameTimes, measured: () => column(series(experiment().tip), 1), modelled: p => column(series(p?.tip), 1), band: p => column(series(p?.tip_band), 1), unit: "mm", digits: 4});
plots["tip-x"].need = plots["tip-y"].need = needs(measuredNeeds("tip"));
plots.angle = timePlot({times: frameTimes, measured: () => series(experiment().angle), modelled: p => series(p?.angle), band: p => series(p?.angle_band), unit: "deg", digits: 4});
plots.angle.need = needs(measuredNeeds("angle"));

// Tip error. Its peak near a click is where to jump.
const errorOf = p => series(p?.error), errorUnit = () => prediction()?.unit ?? "mm";
const floorNow = () => rung()?.unit === errorUnit() ? rung().floor ?? 0 : 0;
function errorLimits() {
  const arrays = state.same ? manifest.rungs.map(r => errorOf(prediction(r))) : [errorOf(prediction())];
  return [0, Math.max(extent(...arrays)[1] || 1, floorNow()) * 1.05];
}
plots.error = timePlot({
  times: frameTimes, modelled: errorOf, unit: errorUnit, limits: errorLimits, label: true,
  extra(pen, box, x, y) {
    for (const place of rung().worst) if (place.experiment === experiment().name) pen.rect(x(place.from_s), box.top, x(place.to_s) - x(place.from_s), box.bottom - box.top, pen.colours.modelled, 0.09);
    if (floorNow()) pen.line([box.left, box.right], [y(floorNow()), y(floorNow())], pen.colours.good, 1.5, [5, 4]);
  },
});
plots.error.need = needs(modelNeeds("error"));
plots.error.pick = (px, py, figure) => {
  const x = timeScale(timeBox(figure.size()));
  jumpToPeak(x.back(px - 14), x.back(px + 14));
};

function jumpToPeak(from, to) {
  const times = frameTimes(), error = errorOf(prediction());
  if (!error) return setTime((from + to) / 2);
  let best = nearest(times, (from + to) / 2);
  for (let i = nearest(times, from); i <= nearest(times, to); i++) if (!(error[i] <= error[best])) best = error[i] === error[i] ? i : best;
  setTime(times[best]);
}

// Run and time of the largest error of the first rung, on runs that choose where there are any.
function worstMoment() {
  const chosen = manifest.experiments.filter(e => e.role !== "test");
  let at = [0, null], most = -Infinity;
  for (const e of chosen.length ? chosen : manifest.experiments) {
    const error = errorOf(manifest.rungs[0]?.experiments[e.name]), times = series(e.t);
    if (error && times) error.forEach((value, i) => { if (value > most) { most = value; at = [manifest.experiments.indexOf(e), times[i]]; } });
  }
  return at;
}

function setTime(time) {
  const [low, high] = experiment()?.span ?? [0, 1];
  state.time = Math.min(high, Math.max(low, time));
  const [a, b] = state.window;
  if (state.time < a || state.time > b) { const half = (b - a) / 2; setWindow(state.time - half, state.time + half); }
  tell("time");
}

function setWindow(from, to) {
  const [low, high] = experiment()?.span ?? [0, 1], width = Math.min(high - low, Math.max(0.05, to - from));
  const start = Math.min(high - width, Math.max(low, (from + to - width) / 2));
  state.window = [start, start + width];
  tell("window");
}

function zoom(how) {
  const [a, b] = state.window, factor = {in: 0.5, out: 2, all: 1e9}[how], half = (b - a) * factor / 2;
  setWindow(state.time - half, state.time + half);
}
