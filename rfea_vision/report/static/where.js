// Where it fails: carpet, bars, residual torque, loops and the path of the tip.
const phaseColours = c => ({rest: c.hair, hold: c.c6, rise: c.c2, fall: c.c1, reversal: c.c4, ringing: c.c3});
const carpetBox = pen => area(pen, {top: 16, right: 74});

// A carpet over time; `data` gives the (time, place) array, `limit` the end of the colour scale.
function carpet({data, limit, unit, yLabel, places, paint, strip = false, times = () => series(experiment().tc)}) {
  let cache = {};
  return {
    draw(pen) {
      const array = data(), box = carpetBox(pen), x = timeScale(box), [low, high] = limit(), colour = paint(pen.colours);
      if (cache.array !== array || cache.high !== high || cache.paper !== pen.colours.paper) cache = {array, high, paper: pen.colours.paper, sheet: cells(array, (v, k) => colour((v - low) / (high - low || 1), k, v))};
      const t = times(), last = t.length - 1, half = (t[last] - t[0]) / (2 * last || 1);
      pen.clip(box.left, box.top, box.right - box.left, box.bottom - box.top, () => {
        const from = x(t[0] - half), to = x(t[last] + half);
        pen.image(cache.sheet, from, box.top, to - from, box.bottom - box.top);
      });
      if (strip) drawPhases(pen, box, x);
      axisX(pen, box, x, "time in s");
      const range = places(array), y = scale(...range, box.top, box.bottom);
      for (const v of ticks(...range, 4)) pen.text(tickText(v), box.left - 7, y(v), {align: "right"});
      pen.text(yLabel, 11, (box.top + box.bottom) / 2, {align: "center", turn: -90});
      colourBar(pen, box.right + 14, box.top, Math.min(120, box.bottom - box.top), s => colour(s, -1, low + s * (high - low)), low, high, unit);
    },
    cursor(pen) { cursorAt(pen, carpetBox(pen)); },
    drag(px, py, figure) { setTime(timeScale(carpetBox(figure.size())).back(px)); },
  };
}

function drawPhases(pen, box, x) {
  const paint = phaseColours(pen.colours);
  let free = -1;
  pen.clip(box.left, 0, box.right - box.left, box.top, () => {
    for (const [name, from, to] of prediction()?.phase ?? []) {
      const a = Math.max(box.left, x(from)), b = Math.min(box.right, x(to));
      if (b <= a) continue;
      pen.rect(a, box.top - 4, b - a, 3, paint[name] ?? pen.colours.hair);
      if (b - a > 6.2 * name.length && a >= free) { pen.text(name, a + 1, box.top - 5, {base: "bottom", size: 10}); free = a + 6.2 * name.length; }
    }
  });
}

function widest(key) {
  const of = state.same ? manifest.rungs.map(r => prediction(r)) : [prediction()];
  const end = colourEnd(...of.map(p => series(p?.[key])));
  return [-end, end];
}
plots.carpet = carpet({data: () => series(prediction().carpet), limit: () => widest("carpet"), unit: "mm", yLabel: "clamp 0 … tip 1", places: () => [0, 1], paint: c => divergingRamp(c), strip: true});
plots.carpet.need = needs(modelNeeds("carpet"));
plots.carpet.pick = (px, py, figure) => setTime(timeScale(carpetBox(figure.size())).back(px));

plots.torque = carpet({
  data: () => series(prediction().torque), limit: () => widest("torque"), unit: "mN m", yLabel: "segment", places: array => [0.5, array.shape[1] + 0.5],
  paint: c => {
    const colour = divergingRamp(c), sigma = series(prediction().torque_sigma), grey = rgb(c.hair);
    return (s, k, v) => sigma && k >= 0 && Math.abs(v) < sigma[k] ? grey : colour(s);
  },
});
plots.torque.need = needs(modelNeeds("torque"));

// Horizontal bars from a table of the comparison; the ring is the rung before.
function bars({rows, name, value, none = "No frame of this run was compared."}) {
  return {
    draw(pen) {
      const now = rows(rung()), earlier = rows(rungBefore()) ?? [], c = pen.colours, names = now.map(name);
      const left = Math.min(110, 14 + 6.3 * Math.max(...names.map(n => n.length))), box = area(pen, {left, right: 58, top: 4, bottom: 38});
      const all = state.same ? manifest.rungs.flatMap(r => rows(r) ?? []) : now;
      const x = scale(0, Math.max(...all.map(value), floorNow()) * 1.05 || 1, box.left, box.right), pitch = Math.min(30, (box.bottom - box.top) / now.length);
      now.forEach((row, i) => {
        const y = box.top + (i + 0.5) * pitch, before = earlier.find(other => name(other) === names[i]);
        pen.text(names[i], box.left - 8, y, {align: "right", colour: c.ink});
        pen.rect(box.left, y - pitch * 0.28, x(value(row)) - box.left, pitch * 0.56, c.modelled, 0.85);
        if (before) pen.dot(x(value(before)), y, 4, null, c.muted);
        pen.text(show(value(row), 2), pen.width - 6, y, {align: "right", colour: c.ink});
      });
      const bottom = box.top + now.length * pitch;
      if (floorNow()) pen.line([x(floorNow()), x(floorNow())], [box.top, bottom], c.good, 1.5, [4, 3]);
      axisX(pen, {...box, bottom: bottom + 2}, x, "", {about: 3});
      pen.text(`root mean square in ${errorUnit()}`, box.right, bottom + 22, {align: "right", base: "top"});
    },
    need() {
      if (!rung()) return "No model has been fitted yet.";
      return rows(rung())?.length ? undefined : rung().why.comparison ?? none;
    },
  };
}
const rowError = row => row.rmse_mm ?? row.rmse_deg ?? 0;
const here = row => row.experiment === undefined || row.experiment === experiment().name;
const phaseOrder = ["rest", "rise", "hold", "fall", "reversal", "ringing"]; // the same on every rung
plots.phases = bars({rows: r => r?.phases.filter(here).sort((a, b) => phaseOrder.indexOf(a.phase) - phaseOrder.indexOf(b.phase)), name: row => row.phase, value: rowError});
plots.pressures = bars({rows: r => r?.pressures.filter(here), name: row => `${Math.round(row.from_kPa)}–${Math.round(row.to_kPa)} kPa`, value: rowError});
plots.segments = bars({rows: r => r?.segments.filter(here), name: row => `${show(row.from_sigma, 2)}–${show(row.to_sigma, 2)}`, value: rowError, none: "These runs were measured without a centre line, so their error along the tube is unknown."});

// One quantity against another.
function crossPlot({x, y, xLabel, yLabel, equal = false, dots = false, need}) {
  const frame = pen => {
    const box = area(pen, {top: 10, bottom: 38}), rx = padded(extent(x.measured?.(), ...manifest.rungs.map(r => x.modelled?.(prediction(r)))));
    const ry = padded(extent(y.measured?.(), ...manifest.rungs.map(r => y.modelled?.(prediction(r)))));
    if (equal) {
      const perPixel = Math.max((rx[1] - rx[0]) / (box.right - box.left), (ry[1] - ry[0]) / (box.bottom - box.top));
      const grow = (range, pixels) => { const extra = (perPixel * pixels - (range[1] - range[0])) / 2; range[0] -= extra; range[1] += extra; };
      grow(rx, box.right - box.left); grow(ry, box.bottom - box.top);
    }
    return [box, scale(...rx, box.left, box.right), scale(...ry, box.bottom, box.top)];
  };
  return {
    need,
    draw(pen) {
      const [box, sx, sy] = frame(pen), c = pen.colours, p = prediction(), before = predictionBefore();
      axisY(pen, box, sy, yLabel(c)); axisX(pen, box, sx, xLabel(), {grid: true, about: 4});
      const pair = (xs, ys, ...how) => { if (xs && ys) pen.line(sx.all(xs), sy.all(ys), ...how); };
      if (dots) { const xs = x.modelled(p), ys = y.modelled(p); for (let i = 0; i < xs.length; i++) if (xs[i] === xs[i] && ys[i] === ys[i]) pen.dot(sx(xs[i]), sy(ys[i]), 1.8, c.modelled, null, 0.45); return; }
      pair((x.modelled ?? x.measured)(before), before && y.modelled(before), c.earlier, 1, [4, 3]);
      pair(x.measured(), y.measured(), c.measured, 2.4);
      pair((x.modelled ?? x.measured)(p), p && y.modelled(p), c.modelled, 1.4);
    },
    cursor(pen) {
      const [, sx, sy] = frame(pen), c = pen.colours, p = prediction(), times = dots ? series(experiment().tc) : frameTimes(), i = nearest(times, state.time);
      const spot = (xs, ys, colour) => { if (xs && ys && xs[i] === xs[i] && ys[i] === ys[i]) pen.dot(sx(xs[i]), sy(ys[i]), 4.5, colour, c.paper); };
      if (!dots) spot(x.measured(), y.measured(), c.measured);
      spot((x.modelled ?? x.measured)(p), y.modelled(p), c.modelled);
    },
    pick(px, py, figure) {
      const [, sx, sy] = frame(figure.size()), p = prediction(), xs = dots ? x.modelled(p) : x.measured(), ys = dots ? y.modelled(p) : y.measured(), times = dots ? series(experiment().tc) : frameTimes();
      let best = 0, least = Infinity;
      for (let i = 0; i < xs.length; i++) { const d = (sx(xs[i]) - px) ** 2 + (sy(ys[i]) - py) ** 2; if (d < least) { least = d; best = i; } }
      setTime(times[best]);
    },
  };
}
const pressureNow = () => series(experiment().p);
plots["loop-angle"] = crossPlot({
  x: {measured: pressureNow}, y: {measured: () => series(experiment().angle), modelled: p => series(p?.angle)},
  xLabel: () => "pressure in kPa", yLabel: () => "bend angle in deg", need: needs(measuredNeeds("p", "pressure"), measuredNeeds("angle")),
});
plots["loop-tip"] = crossPlot({
  x: {measured: pressureNow}, y: {measured: () => column(series(experiment().tip), 1), modelled: p => column(series(p?.tip), 1)},
  xLabel: () => "pressure in kPa", yLabel: () => "tip y in mm", need: needs(measuredNeeds("p", "pressure"), measuredNeeds("tip")),
});
plots.path = crossPlot({
  x: {measured: () => column(series(experiment().tip), 0), modelled: p => column(series(p?.tip), 0)}, y: {measured: () => column(series(experiment().tip), 1), modelled: p => column(series(p?.tip), 1)},
  xLabel: () => "x in mm", yLabel: () => "y in mm", equal: true, need: needs(measuredNeeds("tip")),
});

const thinned = array => { // rows of the curves that the carpets keep
  if (!array) return undefined;
  const from = frameTimes(), to = series(experiment().tc);
  return Float64Array.from(to, t => array[nearest(from, t)]);
};
plots["torque-cloud"] = crossPlot({
  x: {modelled: () => ({angle: () => thinned(series(experiment().angle)), p: () => thinned(pressureNow()), t: () => series(experiment().tc)})[state.against]()},
  y: {modelled: p => column(series(p?.torque), Math.min(state.segment, (p?.torque?.shape[1] ?? 1) - 1))},
  xLabel: () => ({angle: "bend angle in deg", p: "pressure in kPa", t: "time in s"})[state.against], yLabel: () => "torque in mN m", dots: true,
  need: needs(modelNeeds("torque"), () => state.against === "t" ? undefined : measuredNeeds(state.against, state.against === "p" ? "pressure" : "angle")()),
});

// The paper's figures: the tip's path at the pressures that were fitted, and beside it at those that were not.
const rolesShown = () => [["train", "training"], ["validate", "held out"]].map(([role, title]) => [title, manifest.experiments.filter(e => e.role === role && e.tip)]).filter(([, runs]) => runs.length);
const peakOf = runs => { const logs = runs.map(e => series(e.lp)).filter(Boolean); return logs.length ? `, to ${Math.round(extent(...logs)[1])} kPa` : ""; };
plots.paths = {
  need: () => rolesShown().length ? undefined : "No run has a tip: only the bend angle was measured.",
  draw(pen) {
    const roles = rolesShown(), c = pen.colours, gap = 30, stacked = pen.width < 560, now = rung(); // one below the other on a phone
    const wide = stacked ? pen.width : (pen.width - gap * (roles.length - 1)) / roles.length, tall = stacked ? pen.height / roles.length : pen.height;
    const tips = roles.flatMap(([, runs]) => runs.flatMap(e => [series(e.tip), series(now?.experiments[e.name]?.tip)]).filter(Boolean));
    const [rx, ry] = [0, 1].map(k => padded(extent(...tips.map(tip => column(tip, k)))));
    roles.forEach(([title, runs], i) => {
      const left = stacked ? 0 : i * (wide + gap), above = stacked ? i * tall : 0, box = {left: left + 54, right: left + wide - 8, top: above + 24, bottom: above + tall - 38};
      const perPixel = Math.max((rx[1] - rx[0]) / (box.right - box.left), (ry[1] - ry[0]) / (box.bottom - box.top)), grow = (r, pixels) => { const extra = (perPixel * pixels - (r[1] - r[0])) / 2; return [r[0] - extra, r[1] + extra]; };
      const x = scale(...grow(rx, box.right - box.left), box.left, box.right), y = scale(...grow(ry, box.bottom - box.top), box.bottom, box.top);
      axisY(pen, box, y, ""); axisX(pen, box, x, "", {grid: true, about: Math.max(2, wide / 110)});
      pen.text(`${title}: ${runs.length === 1 ? runs[0].name : `${runs.length} runs`}${peakOf(runs)}`, box.left, above + 10, {colour: c.ink, bold: true});
      pen.text("x and y in mm", box.right, above + tall - 1, {align: "right", base: "bottom"});
      for (const e of runs) {
        const real = series(e.tip), model = series(now?.experiments[e.name]?.tip);
        pen.line(x.all(column(real, 0)), y.all(column(real, 1)), c.measured, 2.4);
        if (model) pen.line(x.all(column(model, 0)), y.all(column(model, 1)), c.modelled, 1.3);
      }
    });
  },
};
