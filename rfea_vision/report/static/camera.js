// The camera: corners that do not fit, photo by photo, and what is left of it in millimetres.
const noCalibration = () => "There is no calibration here: the experiments came as tracks from another tool, or rfea calibrate has not run.";
plots.photos = {
  need: () => manifest.calibration.photos.length ? undefined : manifest.calibration.size ? "camera.yaml keeps no residuals of its photos: it came from another tool." : noCalibration(),
  draw(pen) {
    const {photos, size: [w, h]} = manifest.calibration, c = pen.colours, label = 32, gap = 14;
    let columns = 1, k = 0; // the arrangement that shows the photos largest
    for (let n = 1; n <= photos.length; n++) {
      const fits = Math.min((pen.width / n - gap) / w, (pen.height / Math.ceil(photos.length / n) - label) / h);
      if (fits > k) [columns, k] = [n, fits];
    }
    const cell = {w: w * k + gap, h: h * k + label}, stretch = 0.03 * h * k / (median(photos.map(p => p.rms_px)) || 1);
    photos.forEach((photo, i) => {
      const left = (i % columns) * cell.w, top = Math.floor(i / columns) * cell.h;
      pen.text(photo.file.replace(/\.[^.]*$/, ""), left, top + 6, {colour: c.ink, size: 11}); pen.text(`${show(photo.rms_px, 2)} px`, left, top + 19, {size: 11});
      pen.rect(left, top + 27, w * k, h * k, c.sunk);
      const real = photo.thumbnail?.complete && photo.thumbnail.naturalWidth, [stroke, spot] = real ? ["#ff7a1a", "#ffffff"] : [c.modelled, c.muted];
      if (real) { pen.image(photo.thumbnail, left, top + 27, w * k, h * k, true); pen.rect(left, top + 27, w * k, h * k, "#101215", 0.45); }
      pen.clip(left, top + 27, w * k, h * k, () => photo.x_px.forEach((x, j) => {
        const px = left + x * k, py = top + 27 + photo.y_px[j] * k;
        pen.line([px, px + photo.dx_px[j] * stretch], [py, py + photo.dy_px[j] * stretch], stroke, 1.2); pen.dot(px, py, 0.9, spot);
      }));
    });
  },
};
function pictureOf(address) {
  const picture = new Image();
  picture.addEventListener("load", () => Figure.redraw());
  picture.src = address;
  return picture;
}
for (const photo of manifest.calibration.photos) photo.thumbnail = photo.picture ? pictureOf(photo.picture) : null; // early, so that paper has them
const median = values => [...values].sort((a, b) => a - b)[values.length >> 1];

// Beyond the photos an error grows without end: brightest is ten times the median, or more.
function uncertaintyEnds(values) {
  const seen = values.filter(v => v !== null), [low, high] = extent(seen);
  return [low, seen.length ? Math.min(high, 10 * median(seen)) : high];
}
plots.uncertainty = {
  need: () => manifest.calibration.uncertainty_map ? undefined : manifest.calibration.size ? "camera.yaml carries no map of its uncertainty: there was no photo of the plane, or the file came from another tool." : noCalibration(),
  draw(pen) {
    const {uncertainty_map: map, size: [w, h]} = manifest.calibration, c = pen.colours, box = area(pen, {left: 8, right: 84, top: 4, bottom: 22});
    const k = Math.min((box.right - box.left) / w, (box.bottom - box.top) / h), [low, high] = uncertaintyEnds(map.sigma_mm.flat());
    pen.rect(box.left, box.top, w * k, h * k, c.sunk);
    const dx = (map.x_px[1] - map.x_px[0]) * k, dy = (map.y_px[1] - map.y_px[0]) * k;
    pen.clip(box.left, box.top, w * k, h * k, () => map.y_px.forEach((y, i) => map.x_px.forEach((x, j) => {
      const v = map.sigma_mm[i][j];
      if (v !== null) pen.rect(box.left + x * k - dx / 2, box.top + y * k - dy / 2, dx + 0.5, dy + 0.5, `rgb(${brightRamp((v - low) / (high - low || 1)).map(Math.round)})`);
    })));
    pen.text(`${w} × ${h} px`, box.left, box.top + h * k + 5, {base: "top"});
    colourBar(pen, box.left + w * k + 14, box.top, Math.min(120, h * k), brightRamp, low, high, "mm");
  },
};

plots.coverage = {
  need: () => manifest.calibration.coverage ? undefined : manifest.calibration.size ? "camera.yaml does not say where its photos showed the board: it came from another tool." : noCalibration(),
  draw(pen) {
    const {coverage: {counts, x_edges_px: xs, y_edges_px: ys}, size: [w, h]} = manifest.calibration, c = pen.colours, box = area(pen, {left: 8, right: 84, top: 4, bottom: 22});
    const k = Math.min((box.right - box.left) / w, (box.bottom - box.top) / h), high = Math.max(...counts.flat(), 1), mix = ramp([c.sunk, c.accent]);
    counts.forEach((row, i) => row.forEach((n, j) => {
      const [x, y, wide, tall] = [box.left + xs[j] * k, box.top + ys[i] * k, (xs[j + 1] - xs[j]) * k, (ys[i + 1] - ys[i]) * k];
      pen.rect(x, y, wide - 1, tall - 1, `rgb(${mix(n ? 0.15 + 0.85 * n / high : 0).map(Math.round)})`);
      if (!n) pen.line([x + 1, x + wide - 2, x + wide - 2, x + 1, x + 1], [y + 1, y + 1, y + tall - 2, y + tall - 2, y + 1], c.modelled, 1.2);
    }));
    pen.text(`${w} × ${h} px`, box.left, box.top + h * k + 5, {base: "top"});
    colourBar(pen, box.left + w * k + 14, box.top, Math.min(120, h * k), mix, 0, high, "corners");
  },
};
