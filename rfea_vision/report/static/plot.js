// Scales, axes, and the figure: a drawing that follows the state, with a cursor drawn on a second canvas above it.
function scale(low, high, from, to) {
  const k = (to - from) / (high - low || 1), at = v => from + (v - low) * k;
  return Object.assign(at, {low, high, from, to, back: p => low + (p - from) / k, all: values => { const out = new Float64Array(values.length); for (let i = 0; i < out.length; i++) out[i] = from + (values[i] - low) * k; return out; }});
}

function ticks(low, high, about) {
  const raw = (high - low) / Math.max(1, about), power = 10 ** Math.floor(Math.log10(raw)), part = raw / power;
  const step = power * (part < 1.5 ? 1 : part < 3.5 ? 2 : part < 7.5 ? 5 : 10), out = [];
  if (!(step > 0)) return [low];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + step * 1e-9; k++) out.push(+(k * step).toPrecision(12));
  return out;
}
const padded = ([low, high], part = 0.06) => { const pad = (high - low || Math.abs(high) || 1) * part; return [low - pad, high + pad]; };
const raised = power => String(power).replace(/[-\d]/g, mark => "⁰¹²³⁴⁵⁶⁷⁸⁹"[mark] ?? "⁻");
function tickText(v) {
  if (v === 0 || (Math.abs(v) < 1e5 && Math.abs(v) >= 1e-4)) return String(v).replace("-", "−");
  const [mantissa, power] = v.toExponential().split("e");
  return `${Number(Number(mantissa).toPrecision(5))}·10${raised(Number(power))}`.replace("-", "−");
}

// Plot area inside the labels. Left margin is the same everywhere so that stacked time axes line up.
function area(pen, {left = 54, right = 14, top = 8, bottom = 30} = {}) { return {left, right: pen.width - right, top, bottom: pen.height - bottom}; }

function axisX(pen, box, x, label, {grid = false, about} = {}) {
  const c = pen.colours;
  const at = ticks(x.low, x.high, about ?? Math.max(2, (box.right - box.left) / 90)), from = distantZero(at, x);
  for (const v of at) {
    if (grid) pen.line([x(v), x(v)], [box.top, box.bottom], c.grid, 1);
    pen.line([x(v), x(v)], [box.bottom, box.bottom + 3], c.hair, 1);
    pen.text(tickText(+(v - from).toPrecision(6)), x(v), box.bottom + 5, {align: "center", base: "top"});
  }
  pen.line([box.left, box.right], [box.bottom, box.bottom], c.hair, 1);
  if (label) pen.text(from ? `${label}, from ${String(from).replace("-", "−")}` : label, box.right, pen.height - 1, {align: "right", base: "bottom"});
}

// Where numbers written with a power (of a clock that counts from another day) are alike or run into one another, the first of them is
// the zero that the others are told from.
function distantZero(at, x) {
  const words = at.map(tickText), wide = Math.max(...words.map(word => word.length)) * 6.5;
  const crowded = at.length > 1 && (new Set(words).size < at.length || Math.abs(x(at[1]) - x(at[0])) < wide);
  return crowded && words.some(word => word.includes("·10")) ? at[0] : 0;
}

function axisY(pen, box, y, label, {about} = {}) {
  for (const v of ticks(y.low, y.high, about ?? Math.max(2, (box.bottom - box.top) / 44))) {
    pen.line([box.left, box.right], [y(v), y(v)], pen.colours.grid, 1);
    pen.text(tickText(v), box.left - 7, y(v), {align: "right"});
  }
  if (label) pen.text(label, 11, (box.top + box.bottom) / 2, {align: "center", turn: -90});
}

const plots = {}; // name -> {draw(pen), need(): reason or undefined, cursor(pen, hover), readout(): html, pick(x, y), key(colours): [words, colour] of lines that are neither measured nor modelled}
class Figure {
  constructor(element) {
    this.element = element;
    this.name = element.dataset.figure;
    this.holder = element.querySelector(".canvas");
    this.plot = plots[this.name];
    this.base = this.holder.appendChild(document.createElement("canvas"));
    this.top = this.holder.appendChild(document.createElement("canvas"));
    this.stale = true;
    this.visible = false;
    new ResizeObserver(() => this.refresh()).observe(this.holder);
    new IntersectionObserver(entries => { this.visible = entries.at(-1).isIntersecting; if (this.visible) Figure.schedule(); }, {rootMargin: "300px"}).observe(element);
    for (const button of element.querySelectorAll("[data-save]")) button.addEventListener("click", () => this.save(button.dataset.save));
    if (this.plot.pick || this.plot.drag) this.listen();
  }
  listen() {
    this.holder.classList.add("pick");
    let held = false, start = null;
    const at = event => { const r = this.holder.getBoundingClientRect(); return [event.clientX - r.left, event.clientY - r.top]; };
    this.holder.addEventListener("pointerdown", event => { held = true; start = at(event); this.holder.setPointerCapture(event.pointerId); this.plot.drag?.(...start, this); });
    this.holder.addEventListener("pointermove", event => { if (held) this.plot.drag?.(...at(event), this); });
    this.holder.addEventListener("pointerup", event => { const end = at(event); if (held && Math.hypot(end[0] - start[0], end[1] - start[1]) < 4) this.plot.pick?.(...end, this); held = false; });
    this.holder.addEventListener("pointercancel", () => { held = false; });
  }
  set stale(value) { this.isStale = value; this.element.dataset.state = value ? "stale" : "drawn"; }
  get stale() { return this.isStale; }
  refresh() { this.stale = true; Figure.schedule(); }
  paint() {
    if (!this.visible || this.holder.querySelector(".sheet")) return; // on paper the sheet stands for the canvas
    if (this.stale) {
      this.stale = false; // before drawing: a drawing that fails must not be tried for ever
      const why = this.plot.need?.();
      this.element.classList.toggle("empty", Boolean(why));
      this.holder.querySelector(".why")?.remove();
      this.base.hidden = this.top.hidden = Boolean(why);
      if (why) {
        const note = this.holder.appendChild(document.createElement("p"));
        note.className = "why"; note.textContent = why.replaceAll("`", "");
        this.element.querySelector(".readout").textContent = "";
        return;
      }
      this.plot.draw(this.pen(this.base));
      this.moved = true;
    }
    if (this.moved && !this.element.classList.contains("empty")) {
      this.moved = false;
      if (this.plot.cursor) this.plot.cursor(this.pen(this.top));
      if (this.plot.readout) this.element.querySelector(".readout").innerHTML = this.plot.readout();
    }
  }
  pen(canvas) {
    const width = this.holder.clientWidth, height = this.holder.clientHeight, dense = Math.min(3, devicePixelRatio || 1);
    if (canvas.width !== Math.round(width * dense) || canvas.height !== Math.round(height * dense)) { canvas.width = Math.round(width * dense); canvas.height = Math.round(height * dense); }
    const context = canvas.getContext("2d");
    context.setTransform(dense, 0, 0, dense, 0, 0); context.clearRect(0, 0, width, height);
    return new CanvasPen(context, width, height, colours());
  }
  size() { return {width: this.holder.clientWidth, height: this.holder.clientHeight}; }
  svg(width = this.holder.clientWidth || 720, height = this.holder.clientHeight || 260) {
    const pen = new SvgPen(width, height, coloursOf(document.getElementById("printed")));
    this.plot.draw(pen);
    if (this.plot.atCursor) this.plot.cursor(pen);
    return pen.document(Figure.saving ? this.caption(pen.parts.join("")) : []);
  }
  // What a figure must carry once it has left the page: what it shows, of which run, and what the lines are.
  caption(drawn) {
    const c = coloursOf(document.getElementById("printed")), has = colour => drawn.includes(`stroke="${colour}"`) || RegExp(`<circle[^>]*fill="${colour}"`).test(drawn);
    const model = rung() && (has(c.modelled) ? [`modelled: ${rung().name}`, c.modelled] : [rung().name, c.ink]);
    const lines = [[experiment()?.name, c.ink], has(c.measured) && ["measured", c.measured], ...(this.plot.key?.(c) ?? []), model];
    const unit = this.plot.unitNow?.(), at = this.plot.atCursor ? ` at ${show(state.time, 4)} s` : "";
    return [[`${this.element.querySelector("h3").textContent}${unit ? ` in ${unit}` : ""}${at}`, c.ink], ...lines.filter(Boolean)];
  }
  save(kind) {
    if (this.plot.need?.()) return;
    Figure.saving = true;
    const svg = this.svg(this.holder.clientWidth || 720, Math.max(180, this.holder.clientHeight || 260));
    Figure.saving = false;
    const name = `${this.name}-${experiment()?.name ?? "run"}-${rung()?.model ?? "measured"}`;
    if (kind === "svg") return download(new Blob([svg], {type: "image/svg+xml"}), `${name}.svg`);
    const picture = new Image(), sheet = document.createElement("canvas");
    picture.onload = () => {
      sheet.width = 2 * picture.width; sheet.height = 2 * picture.height;
      sheet.getContext("2d").drawImage(picture, 0, 0, sheet.width, sheet.height);
      sheet.toBlob(blob => download(blob, `${name}.png`));
    };
    picture.src = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(svg)}`;
  }
  static schedule() {
    if (Figure.waiting) return;
    Figure.waiting = requestAnimationFrame(() => {
      Figure.waiting = 0;
      for (const figure of Figure.all) try { figure.paint(); } catch (error) { console.error(figure.name, error); } // one broken figure must not take the others with it
    });
  }
  static redraw(but = "") { for (const figure of Figure.all) if (figure.name !== but) figure.stale = true; Figure.schedule(); }
  static move() { for (const figure of Figure.all) figure.moved = true; Figure.schedule(); }
}
Figure.all = [];

function download(blob, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob); link.download = name;
  document.body.append(link); link.click(); link.remove();
  setTimeout(() => URL.revokeObjectURL(link.href), 5000);
}

// Colour ramps: diverging around zero, and one that only gets brighter (colour-blind-safe, also in grey).
const rgb = hex => [1, 3, 5].map(i => parseInt(hex.slice(i, i + 2), 16));
function ramp(stops) {
  const parts = stops.map(rgb), table = Array.from({length: 256}, (_, k) => {
    const at = k / 255.01 * (parts.length - 1), i = Math.floor(at);
    return parts[i].map((v, j) => v + (parts[i + 1][j] - v) * (at - i));
  });
  return t => table[Math.round(255 * Math.min(1, Math.max(0, t)))];
}
const brightRamp = ramp(["#0b2a4f", "#2c5f8a", "#4f9a94", "#a5c46b", "#f6e04b"]);
const divergingRamp = c => ramp([c.low, c.mid, c.high]);

// A picture with one pixel per cell of an (n, m) array: n instants from left to right, m places from top to bottom.
function cells(array, paint) {
  const [n, m] = array.shape, sheet = document.createElement("canvas");
  sheet.width = n; sheet.height = m;
  const context = sheet.getContext("2d"), data = context.createImageData(n, m);
  for (let i = 0; i < n; i++) for (let j = 0; j < m; j++) {
    const v = array[i * m + j], k = 4 * (j * n + i);
    if (!(v === v)) continue;
    const colour = paint(v, i * m + j);
    data.data[k] = colour[0]; data.data[k + 1] = colour[1]; data.data[k + 2] = colour[2]; data.data[k + 3] = 255;
  }
  context.putImageData(data, 0, 0);
  return sheet;
}

function colourBar(pen, x, y, h, paint, low, high, unit) {
  for (let i = 0; i < h; i++) pen.rect(x, y + i, 8, 1.2, `rgb(${paint(1 - i / h).map(Math.round)})`);
  const digits = Math.max(0, Math.min(6, 1 - Math.floor(Math.log10(high - low || 1)))), end = v => v.toFixed(digits).replace(/^-(0\.?0*)$/, "$1").replace("-", "−");
  pen.text(end(high), x + 12, y + 4); pen.text(end(low), x + 12, y + h - 4); pen.text(unit, x + 12, y + h / 2);
}
