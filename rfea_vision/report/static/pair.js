// Two campaigns: every figure draws the first in blue and the second in orange.
const pairColours = c => [c.measured, c.modelled];
const chosen = [0, 0];

plots.intervals = {
  need: () => manifest.parameters.length ? undefined : "Neither campaign has a fitted model yet.",
  draw(pen) {
    const c = pen.colours, rows = manifest.parameters, pitch = pen.height / rows.length, left = Math.min(200, pen.width * 0.32), right = pen.width - 150;
    rows.forEach((row, i) => {
      const y = (i + 0.5) * pitch, known = row.sides.filter(s => s.value !== null), range = known.length ? padded(extent(known.flatMap(s => s.interval ?? [s.value])), 0.25) : [0, 1], x = scale(...range, left, right);
      pen.text(row.name, left - 14, y, {align: "right", colour: c.ink}); pen.line([left, right], [y, y], c.grid, 1);
      row.sides.forEach((side, k) => {
        const at = y + (k - 0.5) * pitch * 0.36, colour = pairColours(c)[k];
        pen.text(side.text, right + 10, at, {colour});
        if (side.interval) pen.line(side.interval.map(x), [at, at], colour, 2);
        if (side.value !== null) pen.dot(x(side.value), at, 3.6, colour, c.paper);
      });
    });
  },
};

function pairPlot(xLabel, yLabel, need, curves) {
  return {
    need,
    draw(pen) {
      const box = area(pen, {top: 10, bottom: 38}), c = pen.colours, all = curves(c), x = scale(...padded(extent(...all.map(a => a.x))), box.left, box.right), y = scale(...padded(extent(...all.map(a => a.y))), box.bottom, box.top);
      axisY(pen, box, y, yLabel); axisX(pen, box, x, xLabel, {grid: true, about: 5});
      for (const a of all) {
        if (a.dots) Array.from(a.y).forEach((v, i) => { if (v !== null) pen.dot(x(a.x[i]), y(v), 3.4, a.colour, c.paper); });
        else pen.line(x.all(a.x), y.all(Array.from(a.y, v => v ?? NaN)), a.colour, 1.8, a.dash ?? []);
      }
    },
  };
}
plots.loops = pairPlot("pressure in kPa", "bend angle in deg", () => manifest.pair.some(s => s.loops.length) ? undefined : "Neither campaign has a run with bend angle and pressure on one clock.",
  c => manifest.pair.flatMap((side, k) => { const loop = side.loops[chosen[k]]; return loop ? [{x: series(loop.pressure), y: series(loop.angle), colour: pairColours(c)[k]}] : []; }));
plots.steady = pairPlot("pressure in kPa", "bend angle at rest in deg", () => manifest.pair.some(s => s.steady.pressure_kPa?.length) ? undefined : "Neither model carries a steady state.",
  c => manifest.pair.flatMap((side, k) => {
    const s = side.steady;
    if (!s.pressure_kPa?.length) return [];
    const order = s.pressure_kPa.map((_, i) => i).sort((a, b) => s.pressure_kPa[a] - s.pressure_kPa[b]), pick = key => order.map(i => s[key][i]);
    return [s.angle_deg && {x: pick("pressure_kPa"), y: pick("angle_deg"), colour: pairColours(c)[k], dots: true}, s.fitted_angle_deg && {x: pick("pressure_kPa"), y: pick("fitted_angle_deg"), colour: pairColours(c)[k]}].filter(Boolean);
  }));
plots.profiles = pairPlot("clamp 0 … tip 1", "elongation in %", () => manifest.pair.some(s => s.profiles.length) ? undefined : "Neither comparison carries elongation profiles.",
  c => manifest.pair.flatMap((side, k) => side.profiles.filter(p => p.measured).map(p => ({x: p.position ?? p.measured.map((_, i) => (i + 0.5) / p.measured.length), y: p.measured.map(v => v === null ? null : 100 * v), colour: pairColours(c)[k]}))));

async function start() {
  await openSeries();
  Figure.all = [...document.querySelectorAll("[data-figure]")].map(element => new Figure(element));
  document.querySelectorAll("select[data-side]").forEach(select => select.addEventListener("change", () => { chosen[Number(select.dataset.side)] = Number(select.value); Figure.redraw(); }));
  document.getElementById("theme").addEventListener("click", () => { document.documentElement.dataset.theme = document.documentElement.dataset.theme === "dark" ? "light" : "dark"; screenColours = null; Figure.redraw(); });
  document.documentElement.dataset.ready = "yes";
}
start();
