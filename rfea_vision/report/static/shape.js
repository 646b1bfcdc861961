// Elongation over time and along the tube.
function stretchLimits() {
  const [low, high] = extent(series(experiment().elongation), series(experiment().markers), ...manifest.rungs.map(r => series(prediction(r)?.elongation)));
  return [low, high];
}
// Carpets one below the other: measured from the curvature, between markers where there are any, modelled.
const stretchRows = () => [["measured", series(experiment().elongation)], ...(experiment().markers ? [["measured between markers", series(experiment().markers)]] : []), ["modelled", series(prediction()?.elongation)]];
const stretchBox = (pen, part) => {
  const count = stretchRows().length, each = (pen.height - 30) / count;
  return {left: 54, right: pen.width - 74, top: part * each + 18, bottom: (part + 1) * each - (part === count - 1 ? 0 : 4)};
};
plots.elongation = {
  need: needs(measuredNeeds("elongation")),
  draw(pen) {
    const [low, high] = stretchLimits(), c = pen.colours, t = series(experiment().tc), half = (t[t.length - 1] - t[0]) / (2 * (t.length - 1));
    const rows = stretchRows();
    rows.forEach(([name, array], part) => {
      const box = stretchBox(pen, part), x = timeScale(box), last = part === rows.length - 1;
      pen.text(name, box.left, box.top - 3, {base: "bottom", colour: last ? c.modelled : c.measured, bold: true});
      if (!array) return pen.text(modelNeeds("elongation")().replaceAll("`", ""), box.left, (box.top + box.bottom) / 2);
      pen.clip(box.left, box.top, box.right - box.left, box.bottom - box.top, () => {
        const from = x(t[0] - half);
        pen.image(cells(array, v => brightRamp((v - low) / (high - low || 1))), from, box.top, x(t[t.length - 1] + half) - from, box.bottom - box.top);
      });
      pen.text("clamp", box.left - 7, box.top + 6, {align: "right"}); pen.text("tip", box.left - 7, box.bottom - 6, {align: "right"});
      if (last) axisX(pen, box, x, "time in s");
    });
    const box = stretchBox(pen, 0);
    colourBar(pen, box.right + 14, box.top, Math.min(120, box.bottom - box.top), brightRamp, 100 * low, 100 * high, "%");
  },
  cursor(pen) { stretchRows().forEach((_, part) => cursorAt(pen, stretchBox(pen, part))); },
  drag(px, py, figure) { setTime(timeScale(stretchBox(figure.size(), 0)).back(px)); },
};

const middles = count => Float64Array.from({length: count}, (_, i) => (i + 0.5) / count);
function rowOf(array, times) {
  if (!array) return undefined;
  const width = array.shape[1], i = nearest(times, state.time);
  return array.subarray(i * width, (i + 1) * width);
}
function profileFrame(pen, range) {
  const box = area(pen, {top: 10, bottom: 38}), x = scale(0, 1, box.left, box.right), y = scale(...padded(range.map(v => 100 * v)), box.bottom, box.top);
  axisY(pen, box, y, "elongation in %"); axisX(pen, box, x, "clamp 0 … tip 1");
  return [x, y];
}
const percent = (y, values) => Float64Array.from(values, v => y(100 * v));
plots["profile-now"] = {
  atCursor: true,
  need: plots.elongation.need,
  draw() {},
  cursor(pen) {
    const [x, y] = profileFrame(pen, stretchLimits()), c = pen.colours, times = series(experiment().tc);
    const real = rowOf(series(experiment().elongation), times), sigma = rowOf(series(experiment().elongation_sigma), times), model = rowOf(series(prediction()?.elongation), times), before = rowOf(series(predictionBefore()?.elongation), times);
    const xs = Array.from(x.all(middles(real.length)));
    if (sigma && real[0] === real[0]) pen.area(xs, percent(y, real.map((v, i) => v - sigma[i])), percent(y, real.map((v, i) => v + sigma[i])), c.measured);
    pen.line(xs, percent(y, real), c.measured, 2.2);
    const marked = rowOf(series(experiment().markers), times), spread = rowOf(series(experiment().markers_sigma), times);
    marked?.forEach((v, i) => {
      const px = x((i + 0.5) / marked.length);
      if (spread) pen.line([px, px], [y(100 * (v - spread[i])), y(100 * (v + spread[i]))], c.c3, 1.2);
      if (v === v) pen.dot(px, y(100 * v), 3.2, c.c3, c.paper);
    });
    if (before) pen.line(x.all(middles(before.length)), percent(y, before), c.earlier, 1.2, [4, 3]);
    if (model) pen.line(x.all(middles(model.length)), percent(y, model), c.modelled, 1.6);
  },
  readout: () => `at ${show(state.time, 4)} s${experiment().markers ? " · dots: markers" : ""}`,
};
plots.profiles = {
  need() {
    if (!rung()) return "No model has been fitted yet.";
    return rung().profiles.length ? undefined : rung().why.comparison ?? `The comparison of ${rung().model} has no elongation profiles.`;
  },
  draw(pen) {
    const rows = rung().profiles, c = pen.colours, paint = [c.c1, c.c2, c.c3, c.c4, c.c5, c.c6];
    const [x, y] = profileFrame(pen, extent(...rows.flatMap(row => [row.measured, row.modelled, ...(row.measured && row.sigma ? [-1, 1].map(side => row.measured.map((v, i) => v + side * row.sigma[i])) : [])].filter(Boolean))));
    rows.forEach((row, k) => {
      const colour = paint[k % 6], xs = Array.from(row.position ?? middles((row.measured ?? row.modelled).length), x);
      if (row.measured) {
        if (row.sigma) pen.area(xs, percent(y, row.measured.map((v, i) => v - row.sigma[i])), percent(y, row.measured.map((v, i) => v + row.sigma[i])), colour);
        row.measured.forEach((v, i) => pen.dot(xs[i], y(100 * v), 2.6, colour));
      }
      if (row.modelled) pen.line(xs, percent(y, row.modelled), colour, 1.5);
      const last = row.measured ?? row.modelled;
      pen.text(`${show(row.pressure_kPa, 3)} kPa`, xs[0], y(100 * last[0]) - 14, {colour, bold: true});
    });
  },
};
