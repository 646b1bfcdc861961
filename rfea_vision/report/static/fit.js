// The fit seen from outside: how many segments it takes, and how well the data bound its parameters.
const studyRows = () => rung()?.study ?? [];
const noStudy = modelOnly(r => r.study?.length > 1, "No study over the number of segments: rfea fit --study-segments makes one.");
// Segments double from one chain to the next: their axis is logarithmic and names the chains that were tried.
function segmentAxis(pen, box, rows) {
  const x = scale(...padded(extent(rows.map(r => Math.log2(r.segments)))), box.left, box.right);
  pen.line([box.left, box.right], [box.bottom, box.bottom], pen.colours.hair, 1);
  for (const r of rows) pen.text(r.segments, x(Math.log2(r.segments)), box.bottom + 5, {align: "center", base: "top"});
  pen.text("segments", box.right, pen.height - 1, {align: "right", base: "bottom"});
  return r => x(Math.log2(r.segments));
}
const logTicks = (low, high) => { if (high - low < 0.8) return ticks(10 ** low, 10 ** high, 5).map(Math.log10); const out = []; for (let p = Math.floor(low); p <= Math.ceil(high); p++) for (const m of [1, 2, 5]) { const v = Math.log10(m) + p; if (v >= low && v <= high) out.push(v); } return out; };
function logAxisY(pen, box, y, label) {
  for (const v of logTicks(y.low, y.high)) { pen.line([box.left, box.right], [y(v), y(v)], pen.colours.grid, 1); pen.text(tickText(+(10 ** v).toPrecision(2)), box.left - 7, y(v), {align: "right"}); }
  pen.text(label, 11, (box.top + box.bottom) / 2, {align: "center", turn: -90});
}

plots.study = {
  need: noStudy,
  draw(pen) {
    const rows = studyRows(), c = pen.colours, box = area(pen, {top: 10, bottom: 38}), known = key => rows.some(r => r[key] > 0), tip = known("train_tip_rmse_mm") || known("validate_tip_rmse_mm");
    const keys = (tip ? ["tip_x", "tip_y", "tip"] : ["angle"]).flatMap(what => ["train", "validate"].map(role => ({key: `${role}_${what}_rmse_${tip ? "mm" : "deg"}`, role, what}))).filter(k => known(k.key));
    const floor = rung().floor > 0 && rung().unit === (tip ? "mm" : "deg") ? Math.log10(rung().floor) : NaN;
    const y = scale(...padded(extent(...keys.map(k => rows.map(r => r[k.key] > 0 ? Math.log10(r[k.key]) : NaN)), [floor])), box.bottom, box.top), x = segmentAxis(pen, box, rows);
    logAxisY(pen, box, y, tip ? "tip error in mm" : "angle error in deg");
    if (floor === floor) pen.line([box.left, box.right], [y(floor), y(floor)], c.good, 1.5, [5, 4]);
    for (const {key, role, what} of keys) {
      const main = what === "tip" || what === "angle", colour = main ? c.ink : what === "tip_x" ? c.c1 : c.c2, at = rows.map(r => r[key] > 0 ? y(Math.log10(r[key])) : NaN), xs = rows.map(x);
      pen.line(xs, at, colour, main ? 2 : 1, role === "train" ? [4, 3] : []);
      at.forEach((v, i) => { if (v === v) pen.dot(xs[i], v, main ? 3.6 : 2.4, role === "train" ? c.paper : colour, colour); });
    }
    if (keys.length > 2) { pen.text("x", box.right - 18, box.top + 4, {colour: c.c1, bold: true}); pen.text("y", box.right - 6, box.top + 4, {colour: c.c2, bold: true}); }
  },
};
plots["study-path"] = {
  need: modelOnly(r => r.study?.some(row => manifest.experiments.find(e => e.name === row.tip_path_mm?.experiment)?.tip), "No study over the number of segments, or no tip in these tracks."),
  draw(pen) {
    const rows = studyRows().filter(r => r.tip_path_mm?.x), box = area(pen, {top: 10, bottom: 38}), c = pen.colours, run = manifest.experiments.find(e => e.name === rows[0].tip_path_mm.experiment), tip = series(run.tip);
    const real = [column(tip, 0), column(tip, 1)], paths = rows.map(r => r.tip_path_mm), far = 1.5 * Math.max(...extent(real[0], real[1]).map(Math.abs), 1);
    const inside = values => values.filter(v => Math.abs(v) < far); // a chain of two flies far off: it must not flatten the others
    let [rx, ry] = [["x", 0], ["y", 1]].map(([key, k]) => padded(extent(real[k], ...paths.map(p => inside(p[key])))));
    const perPixel = Math.max((rx[1] - rx[0]) / (box.right - box.left), (ry[1] - ry[0]) / (box.bottom - box.top)), grow = (r, pixels) => { const extra = (perPixel * pixels - (r[1] - r[0])) / 2; return [r[0] - extra, r[1] + extra]; };
    const x = scale(...grow(rx, box.right - box.left), box.left, box.right), y = scale(...grow(ry, box.bottom - box.top), box.bottom, box.top);
    axisY(pen, box, y, "y in mm"); axisX(pen, box, x, `x in mm, ${paths[0].experiment}`, {about: 4, grid: true});
    pen.clip(box.left, box.top, box.right - box.left, box.bottom - box.top, () => {
      pen.line(x.all(real[0]), y.all(real[1]), c.measured, 4);
      paths.forEach((p, i) => pen.line(x.all(p.x), y.all(p.y), c.modelled, 0.7 + 1.2 * (i + 1) / paths.length, i === paths.length - 1 ? [] : [2 + 2 * i, 3]));
    });
    let free = -Infinity; // where the paths end apart, their number of segments stands beside them
    paths.map((p, i) => [x(p.x.at(-1)), y(p.y.at(-1)), rows[i].segments]).sort((a, b) => a[0] - b[0]).forEach(([px, py, n]) => { if (px > free) { pen.text(n, px, py - 8, {align: "center", size: 10, colour: c.ink}); free = px + 16; } });
  },
};
plots["study-seconds"] = {
  need: modelOnly(r => Object.keys(r.seconds ?? {}).length > 1, "The time that each chain took was not written down: rfea fit --study-segments writes timings.json."),
  draw(pen) {
    const rows = studyRows().filter(r => rung().seconds[r.segments] > 0), c = pen.colours, box = area(pen, {top: 10, bottom: 38}), value = r => Math.log10(rung().seconds[r.segments]);
    const y = scale(...padded(extent(rows.map(value)), 0.15), box.bottom, box.top), x = segmentAxis(pen, box, rows);
    logAxisY(pen, box, y, "seconds");
    pen.line(rows.map(x), rows.map(r => y(value(r))), c.ink, 1.5); rows.forEach(r => pen.dot(x(r), y(value(r)), 3.6, c.ink, c.paper));
  },
};

plots.likelihood = {
  need: modelOnly(r => Object.keys(r.likelihood ?? {}).length, "No profile likelihood was asked for: rfea fit --profile NAME."),
  draw(pen) {
    const all = Object.entries(rung().likelihood), gap = 28, wide = Math.min(360, (pen.width - gap * (all.length - 1)) / all.length), c = pen.colours, most = 3.84;
    all.forEach(([name, {value, delta, unit, interval_95: interval}], k) => {
      const box = {left: k * (wide + gap) + 40, right: k * (wide + gap) + wide, top: 22, bottom: pen.height - 38}, x = scale(...padded(extent(value)), box.left, box.right), y = scale(0, 1.6 * most, box.bottom, box.top);
      axisY(pen, box, y, "", {about: 3});
      axisX(pen, box, x, "", {about: 3});
      pen.text(name, box.left, 8, {colour: c.ink, bold: true}); pen.text(unit === "1" ? "" : `in ${unit.replaceAll("*", " ")}`, box.right, pen.height - 1, {align: "right", base: "bottom"});
      pen.line([box.left, box.right], [y(most), y(most)], c.good, 1.5, [5, 4]);
      if (interval[0] !== null && interval[1] !== null) pen.rect(x(interval[0]), box.top, x(interval[1]) - x(interval[0]), box.bottom - box.top, c.measured, 0.1);
      pen.clip(box.left, box.top, box.right - box.left, box.bottom - box.top, () => pen.line(x.all(value), y.all(delta), c.modelled, 1.8));
      value.forEach((v, i) => { if (delta[i] <= 1.6 * most) pen.dot(x(v), y(delta[i]), 3, c.modelled, c.paper); });
    });
  },
};
