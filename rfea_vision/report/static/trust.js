// What the numbers rest on: tracking, clock, width, and the fit itself.
// Standard error of the tip in the norm of its error.
const tipSigma = () => { const both = series(experiment().tip_sigma); return both && column(both, 0).map((x, i) => Math.hypot(x, column(both, 1)[i])); };
plots.tracking = timePlot({
  times: frameTimes, measured: tipSigma, unit: "mm", digits: 2, limits: () => [0, extent(tipSigma())[1] * 1.1 || 1],
  extra(pen, box, x) { for (const gap of experiment().gaps) pen.rect(x(gap.from) - 1, box.top, Math.max(2, x(gap.to) - x(gap.from)), 8, pen.colours.bad); },
});
plots.tracking.need = needs(measuredNeeds("tip_sigma"));

plots.seen = timePlot({times: frameTimes, measured: () => series(experiment().seen), unit: "", limits: () => [0, 1.05]});
plots.seen.need = needs(measuredNeeds("seen"));
plots.blur = timePlot({times: frameTimes, measured: () => series(experiment().blur), unit: "px", label: true, limits: () => [0, extent(series(experiment().blur))[1] * 1.1 || 1]});
plots.blur.need = needs(measuredNeeds("blur"));

plots.hinge = {
  need: needs(measuredNeeds("hinge"), measuredNeeds("angle")),
  frame(pen) {
    const box = area(pen, {top: 10, bottom: 38, left: 64}), angle = thinned(series(experiment().angle)), length = series(experiment().hinge);
    return [box, scale(...padded(extent(angle)), box.left, box.right), scale(...padded(extent(length), 0.25), box.bottom, box.top), angle, length];
  },
  draw(pen) {
    const [box, x, y, angle, length] = this.frame(pen);
    axisY(pen, box, y, "length in mm"); axisX(pen, box, x, "bend angle in deg", {about: 4});
    for (let i = 0; i < angle.length; i++) if (angle[i] === angle[i] && length[i] === length[i]) pen.dot(x(angle[i]), y(length[i]), 1.6, pen.colours.measured, null, 0.4);
  },
};

plots.sync = {
  need: needs(measuredNeeds("lp", "pressure"), () => experiment().angle || experiment().tip ? undefined : "Neither angle nor tip was tracked."),
  draw(pen) {
    const box = timeBox(pen), x = timeScale(box), c = pen.colours, e = experiment();
    const motion = e.angle ? series(e.angle) : column(series(e.tip), 1), pressure = series(e.lp), lamp = series(e.lamp);
    const stretch = (values, from = box.bottom, to = box.top) => scale(...padded(extent(values)), from, to).all(values), base = lamp ? box.bottom - 26 : box.bottom;
    const seen = frameTimes().map(t => x(t + state.shift));
    axisY(pen, box, scale(...padded(extent(motion)), base, box.top), e.angle ? "bend angle in deg" : "tip y in mm");
    axisX(pen, box, x, "time in s", {grid: true});
    pen.clip(box.left, box.top, box.right - box.left, box.bottom - box.top, () => {
      pen.line(x.all(series(e.lt)), stretch(pressure, base), c.muted, 1.4);
      pen.line(seen, stretch(motion, base), c.measured, 2);
      if (lamp) pen.line(seen, stretch(lamp, box.bottom - 2, base + 4), c.c5, 1.4);
    });
  },
  key: c => [[`pressure, ${extent(series(experiment().lp)).map(Math.round).join(" to ")} kPa`, c.muted], experiment().lamp && ["lamp", c.c5]],
  readout: () => `<b>pressure</b> · <b class="m">${experiment().angle ? "bend angle" : "tip y"}</b>${experiment().lamp ? " · <b class=\"l\">lamp</b>" : ""}`,
  cursor(pen) { cursorAt(pen, timeBox(pen)); },
  drag(px, py, figure) { setTime(timeScale(timeBox(figure.size())).back(px)); },
};

plots.offsets = {
  need: needs(measuredNeeds("offsets")),
  draw(pen) {
    const {ms, explained, chosen} = experiment().offsets, box = area(pen, {top: 10, bottom: 32}), c = pen.colours, x = scale(...padded(extent(series(ms), [chosen]), 0.02), box.left, box.right), y = scale(Math.min(0, extent(series(explained))[0]), 1.05, box.bottom, box.top);
    axisY(pen, box, y, "share explained", {about: 3}); axisX(pen, box, x, "offset in ms", {about: 4});
    pen.line([x(chosen), x(chosen)], [box.top, box.bottom], c.modelled, 1.4, [4, 3]);
    pen.clip(box.left, box.top, box.right - box.left, box.bottom - box.top, () => pen.line(x.all(series(ms)), y.all(series(explained)), c.ink, 1.8));
  },
  readout: () => `<b class="f">${toError(experiment().offsets.chosen, experiment().offsets.error)}</b> ms`,
};

plots.width = carpet({data: () => series(experiment().width), limit: () => extent(series(experiment().width)), unit: "mm", yLabel: "clamp 0 … tip 1", places: () => [0, 1], paint: () => s => brightRamp(s)});
plots.width.need = needs(measuredNeeds("width"));

const modelOnly = (has, text) => () => !rung() ? "No model has been fitted yet." : has(rung()) ? undefined : text;
plots.correlation = {
  need: modelOnly(r => r.correlation?.matrix?.length, "model.json of this rung carries no correlations."),
  draw(pen) {
    const {names, matrix} = rung().correlation, c = pen.colours, left = Math.min(pen.width * 0.4, 12 + 6.4 * Math.max(...names.map(n => n.length))), top = 8;
    const side = Math.min((pen.width - left - 52) / names.length, (pen.height - top - 60) / names.length), colour = divergingRamp(c);
    names.forEach((name, i) => {
      pen.text(name, left - 6, top + (i + 0.5) * side, {align: "right", colour: c.ink, size: 11});
      pen.text(name, left + (i + 0.5) * side, top + names.length * side + 6, {align: "right", turn: -45, size: 10.5});
      names.forEach((_, j) => {
        const v = matrix[i][j];
        if (v === null) return;
        pen.rect(left + j * side, top + i * side, side - 1, side - 1, `rgb(${colour((v + 1) / 2).map(Math.round)})`);
        if (side > 30 && i !== j && Math.abs(v) >= 0.5) pen.text(show(v, 2), left + (j + 0.5) * side, top + (i + 0.5) * side, {align: "center", size: 10, colour: c.ink});
      });
    });
    colourBar(pen, left + names.length * side + 12, top, Math.min(100, names.length * side), colour, -1, 1, "");
  },
};
plots.steady = {
  need: modelOnly(r => r.steady?.pressure_kPa?.length, "model.json of this rung carries no steady state."),
  draw(pen) {
    const s = rung().steady, box = area(pen, {top: 10, bottom: 38}), c = pen.colours;
    const x = scale(...padded(extent(s.pressure_kPa)), box.left, box.right), y = scale(...padded(extent(s.angle_deg ?? [], s.fitted_angle_deg ?? [])), box.bottom, box.top);
    axisY(pen, box, y, "bend angle in deg"); axisX(pen, box, x, "pressure in kPa", {about: 4});
    if (s.fitted_angle_deg) {
      const order = s.pressure_kPa.map((_, i) => i).sort((a, b) => s.pressure_kPa[a] - s.pressure_kPa[b]);
      pen.line(order.map(i => x(s.pressure_kPa[i])), order.map(i => y(s.fitted_angle_deg[i] ?? NaN)), c.modelled, 1.6);
    }
    s.angle_deg?.forEach((v, i) => { if (v !== null) pen.dot(x(s.pressure_kPa[i]), y(v), 4, c.measured, c.paper); });
  },
};
plots.starts = {
  need: modelOnly(r => r.starts?.length > 1, "This fit was started once, so there is no waterfall."),
  draw(pen) {
    const found = rung().starts.map(s => s.cost).filter(v => v !== null && v !== undefined).sort((a, b) => a - b), costs = found.map(v => v / (found[0] || 1)), box = area(pen, {top: 10, bottom: 38, left: 64}), c = pen.colours;
    const x = scale(0.5, costs.length + 0.5, box.left, box.right), [best, worst] = extent(costs), y = scale(...padded([best, Math.max(worst, best + 0.01)], 0.1), box.bottom, box.top);
    axisY(pen, box, y, "final cost over the best"); axisX(pen, box, x, "start, best first", {about: Math.min(8, costs.length)});
    pen.line(costs.map((_, i) => x(i + 1)), costs.map(v => y(v)), c.hair, 1.2);
    costs.forEach((v, i) => pen.dot(x(i + 1), y(v), 4, c.modelled, c.paper));
  },
};
plots.next = {
  need: modelOnly(r => r.next, "This rung asks for no further experiment: nothing that it lacks is tied, or it has not been diagnosed. What would split a tie of an effect that it has stands on the rung before."),
  draw(pen) {
    const [time, pressure] = rung().next, box = area(pen, {top: 10, bottom: 34}), c = pen.colours;
    const x = scale(...extent(time), box.left, box.right), y = scale(...padded(extent(pressure)), box.bottom, box.top);
    axisY(pen, box, y, "pressure in kPa"); axisX(pen, box, x, "time in s");
    pen.line(x.all(time), y.all(pressure), c.ink, 1.8);
  },
};
