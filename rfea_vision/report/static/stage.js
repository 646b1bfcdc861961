// The tube over its picture, in millimetres: film below, measured and modelled centre lines above.
const stage = {canvas: document.querySelector("#stage canvas"), films: new Map(), playing: false};

function filmOf(e) {
  if (!e?.clip) return undefined;
  if (!stage.films.has(e.name)) {
    const film = document.createElement("video");
    film.muted = true; film.playsInline = true; film.preload = "auto";
    if (e.clip.address) fetchFilm(film, e.clip.address);
    else film.src = addressOf(bytesOf(document.querySelector(`script[data-clip="${CSS.escape(e.name)}"]`).textContent));
    film.addEventListener("loadeddata", () => seek(true));
    film.addEventListener("seeked", () => { film.busy = false; seek(); paintStage(); });
    film.addEventListener("error", () => { film.broken = true; paintStage(); });
    stage.films.set(e.name, film);
  }
  return stage.films.get(e.name);
}

const addressOf = bytes => URL.createObjectURL(new Blob([bytes], {type: "video/mp4"}));
// A film is taken whole before it is shown: in one that still comes, the browser can seek to no frame.
async function fetchFilm(film, address) {
  try { film.src = addressOf(await (await fetch(address)).arrayBuffer()); } catch { film.broken = true; paintStage(); }
}

const pose = () => { const e = experiment(); return e?.tp ? nearest(series(e.tp), state.time) : 0; };
const poseTime = k => series(experiment().tp)[k];

// The film's frames are evenly spaced: frame k is shown in the middle of its interval.
function seek(force = false) {
  const e = experiment(), film = filmOf(e);
  if (!film || film.busy || film.readyState < 1 || !Number.isFinite(film.duration)) return;
  const frame = pose() * e.clip.step;
  if (frame === film.frame && !force) return;
  film.frame = frame; film.busy = true;
  film.requestVideoFrameCallback?.(() => paintStage());  // a busy browser may say that it has sought before the picture is there
  film.currentTime = Math.min(film.duration - 1e-4, (frame + 0.5) * film.duration / e.clip.frames);
}

const filmRect = e => e?.clip && {left: e.clip.x_min_mm, top: e.clip.y_max_mm, width: e.clip.width / e.clip.px_per_mm, height: e.clip.height / e.clip.px_per_mm};

// The rectangle to show, in mm: it holds the film and every pose.
let lastView = {};
function forgetView() { lastView = {}; }
function stageView() {
  const e = experiment();
  if (lastView.of !== e) { lastView = {of: e, ...findView(e)}; lastView.corner = lensCorner(lastView); }
  return lastView;
}
function findView(e) {
  const lines = [series(e?.midline) ?? series(e?.tip), ...manifest.rungs.map(r => series(prediction(r)?.midline) ?? series(prediction(r)?.tip))].filter(Boolean);
  const film = filmRect(e), length = manifest.length_mm ?? 150, xs = film ? [film.left, film.left + film.width] : [0, 0], ys = film ? [film.top - film.height, film.top] : [0, -length];
  for (const line of lines) for (let i = 0; i < line.length; i += 2) if (line[i] === line[i]) { xs.push(line[i]); ys.push(line[i + 1]); }
  const [x0, x1] = extent(xs), [y0, y1] = extent(ys);
  if (film) return {left: x0, top: y1, width: x1 - x0, height: y1 - y0};
  const pad = 0.08 * length, side = Math.max(x1 - x0, y1 - y0) + 2 * pad;
  return {left: (x0 + x1 - side) / 2, top: (y0 + y1 + side) / 2, width: side, height: side};
}

function poseOf(record, key, k) {
  const array = series(record?.[key]);
  if (!array) return undefined;
  const size = array.length / array.shape[0];
  return array.subarray(k * size, (k + 1) * size);
}

function paintStage() {
  const e = experiment(), canvas = stage.canvas;
  if (!canvas || !e?.tp || !block) return;
  const view = stageView(), holder = canvas.parentElement, width = holder.clientWidth, dense = Math.min(3, devicePixelRatio || 1);
  const height = Math.min(width * view.height / view.width, 440), k = pose();
  canvas.style.height = `${height}px`;
  if (canvas.width !== Math.round(width * dense) || canvas.height !== Math.round(height * dense)) { canvas.width = Math.round(width * dense); canvas.height = Math.round(height * dense); }
  const c = canvas.getContext("2d"), perMm = Math.min(width / view.width, height / view.height);
  c.setTransform(dense, 0, 0, dense, 0, 0); c.clearRect(0, 0, width, height);
  const at = {left: (width - view.width * perMm) / 2, top: (height - view.height * perMm) / 2};
  drawScene(c, {x: mm => at.left + (mm - view.left) * perMm, y: mm => at.top + (view.top - mm) * perMm, perMm}, k, 1);
  rulerOf(c, width, height, perMm);
  const tip = tipOf(e, k);
  if (document.getElementById("lens").checked && tip) drawLens(c, width, height, perMm, tip, k);
  showGap();
  const film = stage.films.get(e.name);
  const alone = film?.broken ? "This browser cannot play the film (H.264); the tube is drawn alone." : e.clip ? "" : e.why.clip ?? "";
  const slowed = slower() > 1 ? `Plays ${+slower().toPrecision(2)} times slower than it went.` : "";
  document.getElementById("stage-note").textContent = [alone, e.turned, slowed].filter(Boolean).join(" ");
}

// The last rung of the ladder, where it is not the one that is shown: the cure beside what it cures.
function cureOf() {
  const climbed = manifest.rungs.filter(r => r.ladder), last = climbed.at(-1);
  return last && climbed.length > 1 && last !== rung() ? last : undefined;
}

// What stands under the picture: how far apart measured and modelled are at the cursor, with this rung and with the last.
function showGap() {
  const line = document.getElementById("gap"), cured = cureOf(), note = document.getElementById("cured"), earlier = document.getElementById("rung-before");
  if (!line || !experiment()?.t) return;
  const i = nearest(frameTimes(), state.time), gap = of => { const p = prediction(of), all = series(p?.error); return all && all[i] === all[i] ? show(all[i]) : undefined; };
  const now = gap(rung()), then = cured && gap(cured), what = prediction()?.unit === "deg" ? "bend angle" : "tip";
  if (note) note.hidden = !then;
  if (earlier) earlier.hidden = !predictionBefore();
  const tested = experiment().role === "test" && (now || then) ? " · test run: drawn after the end, scored once" : "";
  line.textContent = now || then ? `Gap ${what === "tip" ? "at" : "in"} the ${what}, ${state.time.toFixed(2)} s: ${[now, then].filter(Boolean).join(" → ")} ${(prediction() ?? prediction(cured)).unit ?? ""}${then ? (cured.verdict === "complete" ? " once cured" : " with the last rung") : ""}${tested}` : prediction()?.why?.prediction?.replaceAll("`", "") ?? "";
}

function tipOf(e, k) {
  const line = poseOf(e, "midline", k);
  if (line && line[0] === line[0]) return [line[line.length - 2], line[line.length - 1]];
  const tips = series(e.tip);
  if (!tips) return undefined;
  const i = nearest(frameTimes(), poseTime(k));
  return [tips[2 * i], tips[2 * i + 1]];
}

function drawScene(c, to, k, weight) {
  const e = experiment(), film = filmOf(e), frame = filmRect(e), paint = colours();
  if (film && film.readyState >= 2 && !film.broken) c.drawImage(film, to.x(frame.left), to.y(frame.top), frame.width * to.perMm, frame.height * to.perMm);
  const trace = (line, colour, width, dash = [], halo = true) => {
    if (!line) return;
    const path = new Path2D();
    let down = false;
    for (let i = 0; i < line.length; i += 2) {
      if (!(line[i] === line[i])) { down = false; continue; }
      if (down) path.lineTo(to.x(line[i]), to.y(line[i + 1])); else { path.moveTo(to.x(line[i]), to.y(line[i + 1])); down = true; }
    }
    c.lineJoin = c.lineCap = "round"; c.setLineDash(dash);
    if (halo) { c.strokeStyle = "rgb(255 255 255 / .75)"; c.lineWidth = width + 2.4; c.stroke(path); }
    c.strokeStyle = colour; c.lineWidth = width; c.stroke(path); c.setLineDash([]);
  };
  const overFilm = Boolean(film && film.readyState >= 2);
  const hue = overFilm ? {measured: "#56b4e9", modelled: "#e8590c", earlier: "#cfd2d6", cured: "#2ec4a0"} : {...paint, cured: paint.good};
  if (!overFilm) { c.fillStyle = paint.muted; c.fillRect(to.x(-9), to.y(3.5), 18 * to.perMm, 3 * to.perMm); }
  if (document.getElementById("outline").checked) {
    const edges = poseOf(e, "edges", k);
    if (edges) for (const side of [0, 1]) trace(edges.subarray(side * edges.length / 2, (side + 1) * edges.length / 2), hue.measured, 1, [], false);
  }
  const before = poseOf(predictionBefore(), "midline", k);
  trace(before, hue.earlier, 1.5 * weight, [5, 4], false);
  trace(poseOf(e, "midline", k), hue.measured, 3.2 * weight, [], overFilm);
  const cured = cureOf();
  if (cured) trace(poseOf(prediction(cured), "midline", k), hue.cured, 1.6 * weight, [2, 3], false);
  trace(poseOf(prediction(), "midline", k), hue.modelled, 1.8 * weight, [], false);
  const dot = (x, y, colour) => { c.beginPath(); c.arc(to.x(x), to.y(y), 4, 0, 7); c.fillStyle = colour; c.fill(); c.strokeStyle = "#fff"; c.lineWidth = 1.2; c.stroke(); };
  const i = nearest(frameTimes(), poseTime(k)), tips = series(e.tip), modelTips = series(prediction()?.tip);
  if (tips && tips[2 * i] === tips[2 * i]) dot(tips[2 * i], tips[2 * i + 1], hue.measured);
  if (modelTips && modelTips[2 * i] === modelTips[2 * i]) dot(modelTips[2 * i], modelTips[2 * i + 1], hue.modelled);
}

// The picture as a file: on the page's paper, and below it which run and instant it is, and what its lines are.
function saveStage() {
  const from = stage.canvas, dense = from.width / from.clientWidth, c = colours(), hidden = id => document.getElementById(id).hidden;
  const rows = [[`${experiment().name} at ${show(state.time, 4)} s`, c.ink], ["measured", c.measured], prediction() && [`modelled: ${rung().name}`, c.modelled], !hidden("cured") && ["modelled, last rung", c.good], !hidden("rung-before") && ["rung before", c.earlier]].filter(Boolean);
  const width = Math.max(from.clientWidth, 16 + 6.4 * Math.max(...rows.map(([words]) => words.length))), sheet = document.createElement("canvas");
  sheet.width = dense * width; sheet.height = from.height + dense * (16 * rows.length + 8);
  const context = sheet.getContext("2d"), pen = new CanvasPen(context, width, sheet.height / dense, c);
  context.fillStyle = c.paper; context.fillRect(0, 0, sheet.width, sheet.height); context.drawImage(from, 0, 0); context.scale(dense, dense);
  rows.forEach(([words, colour], i) => pen.text(words, 8, from.height / dense + 12 + 16 * i, {colour, bold: !i}));
  sheet.toBlob(blob => download(blob, `tube-${experiment().name}-${state.time.toFixed(3)}s.png`));
}

// The corner of the picture that the tube keeps clear of most; one per run, so that the lens does not wander.
function lensCorner(view) {
  const tips = series(experiment().midline) ?? series(experiment().tip) ?? series(prediction()?.tip) ?? new Float64Array(0), best = {distance: -1};
  for (const [u, v] of [[0.85, 0.84], [0.15, 0.84], [0.85, 0.16], [0.15, 0.16]]) {
    const x = view.left + u * view.width, y = view.top - v * view.height;
    let distance = Math.hypot(x, y); // the clamp is in the way too
    for (let i = 0; i < tips.length; i += 2) if (tips[i] === tips[i]) distance = Math.min(distance, Math.hypot(tips[i] - x, tips[i + 1] - y));
    if (distance > best.distance) Object.assign(best, {distance, u, v});
  }
  return best;
}

// A round lens over the tip, up to six times larger than the picture, less where both tips would not fit.
function drawLens(c, width, height, perMm, tip, k) {
  const radius = Math.min(78, width * 0.19), margin = 12, corner = lastView.corner, i = nearest(frameTimes(), poseTime(k)), model = series(prediction()?.tip);
  const apart = model ? Math.hypot(model[2 * i] - tip[0], model[2 * i + 1] - tip[1]) : 0, scaleUp = perMm * Math.max(1.5, Math.min(6, 0.75 * radius / (apart * perMm || 1)));
  const cx = corner.u < 0.5 ? margin + radius : width - margin - radius, cy = corner.v < 0.5 ? margin + radius : height - margin - radius;
  c.save(); c.beginPath(); c.arc(cx, cy, radius, 0, 7); c.fillStyle = colours().paper; c.fill(); c.clip();
  drawScene(c, {x: mm => cx + (mm - tip[0]) * scaleUp, y: mm => cy + (tip[1] - mm) * scaleUp, perMm: scaleUp}, k, 1.1);
  const mm = [0.5, 1, 2, 5, 10, 20].find(length => length * scaleUp > 22) ?? 50, bar = scaleUp * mm;
  c.fillStyle = "rgb(255 255 255 / .85)"; c.fillRect(cx - Math.max(bar, 34) / 2 - 4, cy + radius - 33, Math.max(bar, 34) + 8, 21);
  c.fillStyle = "#1c1e22"; c.fillRect(cx - bar / 2, cy + radius - 16, bar, 1.5); c.font = `11px ${colours().font}`; c.textAlign = "center"; c.fillText(`${mm} mm`, cx, cy + radius - 21);
  c.restore(); c.beginPath(); c.arc(cx, cy, radius, 0, 7); c.strokeStyle = colours().paper; c.lineWidth = 3; c.stroke(); c.strokeStyle = colours().muted; c.lineWidth = 1; c.stroke();
}

// 50 mm, or the next round length that is no longer than a third of the picture.
function rulerOf(c, width, height, perMm) {
  let mm = 50;
  for (let k = 0; mm * perMm > width / 3; k++) mm /= k % 3 === 0 ? 2.5 : 2;
  const long = mm * perMm, {u, v} = lastView.corner, x = u < 0.5 && v > 0.5 ? width - 14 - long : 14, y = height - 14;
  c.fillStyle = "rgb(255 255 255 / .8)"; c.fillRect(x - 6, y - 20, long + 12, 27);
  c.fillStyle = "#1c1e22"; c.fillRect(x, y, long, 2); c.font = `11px ${colours().font}`; c.textAlign = "left"; c.fillText(`${+mm.toPrecision(1)} mm`, x, y - 5);
}

// Playing moves the cursor in real time, of a run that would flash by slowed down; the film follows by seeking, so that line and picture
// never part.
const LEAST_PLAYED_S = 3;
let playFrom = 0, playTime = 0;
const slower = () => { const [low, high] = experiment().span; return high > low ? Math.max(1, LEAST_PLAYED_S / (high - low)) : 1; };
function play(go = !stage.playing) {
  stage.playing = go;
  const button = document.getElementById("play");
  button.textContent = go ? "❚❚" : "▶"; button.setAttribute("aria-label", go ? "Pause" : "Play");
  if (!go) return;
  const [low, high] = experiment().span;
  playTime = state.time >= high - 1e-6 ? low : state.time; playFrom = performance.now();
  requestAnimationFrame(advance);
}
function advance(now) {
  if (!stage.playing) return;
  const time = playTime + (now - playFrom) / 1000 / slower(), [, high] = experiment().span;
  setTime(time);
  if (time >= high) play(false); else requestAnimationFrame(advance);
}
