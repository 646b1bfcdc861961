// One drawing, two papers: canvas for the screen, SVG for saving and printing.
// Of a curve with several points to a pixel, the lowest and the highest in each pixel are all that can be seen; the others only take time.
// What goes back and forth, or has few points, stays as it is.
function visible(xs, ys) {
  const n = xs.length;
  if (n < 400 || n < 3 * (xs[n - 1] - xs[0])) return [xs, ys];
  const x = [], y = [];
  let column = NaN, low = -1, high = -1;
  const close = () => { if (low >= 0) for (const i of low === high ? [low] : [Math.min(low, high), Math.max(low, high)]) { x.push(xs[i]); y.push(ys[i]); } low = high = -1; };
  for (let i = 0; i < n; i++) {
    if (i && !(xs[i] >= xs[i - 1])) return [xs, ys];
    if (!(ys[i] === ys[i])) { close(); x.push(NaN); y.push(NaN); continue; }
    if (Math.round(xs[i]) !== column) { close(); column = Math.round(xs[i]); }
    if (low < 0 || ys[i] < ys[low]) low = i;
    if (high < 0 || ys[i] > ys[high]) high = i;
  }
  close();
  return [x, y];
}

// Points of a curve that are stroked at once. Of a noisy curve of 560 points a browser that draws in software makes 2.9 ms at
// once and 1.1 ms in pieces; dashed with round ends 31 ms at once, with plain ones in pieces 2.7 ms.
const PIECE = 8;
class CanvasPen {
  constructor(context, width, height, colours) {
    Object.assign(this, {c: context, width, height, colours});
    context.lineJoin = context.lineCap = "round";
  }
  line(allX, allY, colour, width = 1.6, dash = []) {
    const c = this.c, [xs, ys] = visible(allX, allY);
    c.strokeStyle = colour; c.lineWidth = width; c.setLineDash(dash); c.lineCap = dash.length ? "butt" : "round";
    c.beginPath();
    let last = -1, length = 0, points = 0;
    for (let i = 0; i < xs.length; i++) {
      if (!(ys[i] === ys[i]) || !(xs[i] === xs[i])) { last = -1; continue; }
      if (last < 0) c.moveTo(xs[i], ys[i]); else { c.lineTo(xs[i], ys[i]); length += Math.hypot(xs[i] - xs[last], ys[i] - ys[last]); }
      last = i;
      if (++points === PIECE) { c.stroke(); c.beginPath(); c.moveTo(xs[i], ys[i]); c.lineDashOffset = length; points = 0; }
    }
    c.stroke(); c.setLineDash([]); c.lineDashOffset = 0;
  }
  area(xs, low, high, colour, opacity = 0.18) {
    const c = this.c;
    c.beginPath();
    xs.forEach((x, i) => i ? c.lineTo(x, high[i]) : c.moveTo(x, high[i]));
    for (let i = xs.length - 1; i >= 0; i--) c.lineTo(xs[i], low[i]);
    c.closePath(); c.globalAlpha = opacity; c.fillStyle = colour; c.fill(); c.globalAlpha = 1;
  }
  rect(x, y, w, h, colour, opacity = 1) { this.c.globalAlpha = opacity; this.c.fillStyle = colour; this.c.fillRect(x, y, w, h); this.c.globalAlpha = 1; }
  dot(x, y, r, fill, stroke, opacity = 1) {
    const c = this.c;
    c.globalAlpha = opacity; c.beginPath(); c.arc(x, y, r, 0, 7);
    if (fill) { c.fillStyle = fill; c.fill(); }
    if (stroke) { c.strokeStyle = stroke; c.lineWidth = 1.5; c.stroke(); }
    c.globalAlpha = 1;
  }
  text(words, x, y, {align = "left", base = "middle", colour = this.colours.muted, size = 11.5, turn = 0, bold = false} = {}) {
    const c = this.c;
    c.save(); c.translate(x, y); c.rotate(turn * Math.PI / 180);
    c.font = `${bold ? 600 : 400} ${size}px ${this.colours.font}`; c.fillStyle = colour; c.textAlign = align; c.textBaseline = base === "top" ? "top" : base === "bottom" ? "bottom" : "middle";
    c.fillText(words, 0, 0); c.restore();
  }
  image(picture, x, y, w, h, smooth = false) { this.c.imageSmoothingEnabled = smooth; this.c.drawImage(picture, x, y, w, h); }
  clip(x, y, w, h, draw) { const c = this.c; c.save(); c.beginPath(); c.rect(x, y, w, h); c.clip(); draw(); c.restore(); }
}

class SvgPen {
  constructor(width, height, colours) { Object.assign(this, {width, height, colours, parts: [], clips: 0}); }
  static n(v) { return Math.round(v * 100) / 100; }
  line(xs, ys, colour, width = 1.6, dash = []) {
    let path = "", down = false;
    for (let i = 0; i < xs.length; i++) {
      if (!(ys[i] === ys[i]) || !(xs[i] === xs[i])) { down = false; continue; }
      path += `${down ? "L" : "M"}${SvgPen.n(xs[i])} ${SvgPen.n(ys[i])}`; down = true;
    }
    if (path) this.parts.push(`<path d="${path}" fill="none" stroke="${colour}" stroke-width="${width}" stroke-linejoin="round" stroke-linecap="round"${dash.length ? ` stroke-dasharray="${dash.join(" ")}"` : ""}/>`);
  }
  area(xs, low, high, colour, opacity = 0.18) {
    const points = [...xs.map((x, i) => [x, high[i]]), ...xs.map((x, i) => [x, low[i]]).reverse()];
    this.parts.push(`<polygon points="${points.map(p => p.map(SvgPen.n).join(",")).join(" ")}" fill="${colour}" fill-opacity="${opacity}"/>`);
  }
  rect(x, y, w, h, colour, opacity = 1) { this.parts.push(`<rect x="${SvgPen.n(x)}" y="${SvgPen.n(y)}" width="${SvgPen.n(Math.max(0, w))}" height="${SvgPen.n(Math.max(0, h))}" fill="${colour}"${opacity < 1 ? ` fill-opacity="${opacity}"` : ""}/>`); }
  dot(x, y, r, fill, stroke, opacity = 1) { this.parts.push(`<circle cx="${SvgPen.n(x)}" cy="${SvgPen.n(y)}" r="${r}" fill="${fill || "none"}"${stroke ? ` stroke="${stroke}" stroke-width="1.5"` : ""}${opacity < 1 ? ` opacity="${opacity}"` : ""}/>`); }
  text(words, x, y, {align = "left", base = "middle", colour = this.colours.muted, size = 11.5, turn = 0, bold = false} = {}) {
    const safe = String(words).replace(/[&<>]/g, mark => ({"&": "&amp;", "<": "&lt;", ">": "&gt;"})[mark]);
    const anchor = {left: "start", center: "middle", right: "end"}[align], shift = {top: size * 0.8, middle: size * 0.35, bottom: -size * 0.2}[base];
    this.parts.push(`<text transform="translate(${SvgPen.n(x)} ${SvgPen.n(y)})${turn ? ` rotate(${turn})` : ""}" y="${SvgPen.n(shift)}" text-anchor="${anchor}" font-size="${size}" fill="${colour}"${bold ? ' font-weight="600"' : ""}>${safe}</text>`);
  }
  image(picture, x, y, w, h) { this.parts.push(`<image href="${picture.src ?? picture.toDataURL("image/png")}" x="${SvgPen.n(x)}" y="${SvgPen.n(y)}" width="${SvgPen.n(w)}" height="${SvgPen.n(h)}" preserveAspectRatio="none"${picture.src ? "" : ' style="image-rendering:pixelated"'}/>`); }
  clip(x, y, w, h, draw) {
    const id = `clip${SvgPen.count = (SvgPen.count ?? 0) + 1}`;
    this.parts.push(`<clipPath id="${id}"><rect x="${x}" y="${y}" width="${w}" height="${h}"/></clipPath><g clip-path="url(#${id})">`);
    draw();
    this.parts.push("</g>");
  }
  // The drawing as a file; `caption` is [words, colour] for the line of the title and those of the legend below it.
  document([title, ...legend] = []) {
    const drawing = this.parts;
    let x = 12, y = 33;
    this.parts = [];
    if (title) {
      this.text(title[0], 12, 14, {colour: title[1], size: 14, bold: true});
      for (const [words, colour] of legend) {
        const wide = 6.1 * words.length;
        if (x > 12 && x + wide > this.width) { x = 12; y += 16; }
        this.text(words, x, y, {colour}); x += 18 + wide;
      }
    }
    const head = title ? y + 11 : 0, height = this.height + head;
    return `<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 ${this.width} ${height}" width="${this.width}" height="${height}" font-family="${this.colours.font.replaceAll('"', "'")}"><rect width="100%" height="100%" fill="${this.colours.paper}"/>${this.parts.join("")}<g transform="translate(0 ${head})">${drawing.join("")}</g></svg>`;
  }
}

const colourNames = ["paper", "sunk", "ink", "muted", "hair", "grid", "measured", "modelled", "earlier", "good", "bad", "accent", "low", "mid", "high", "c1", "c2", "c3", "c4", "c5", "c6", "font"];
function coloursOf(element) {
  const style = getComputedStyle(element);
  return Object.fromEntries(colourNames.map(name => [name, style.getPropertyValue(`--${name}`).trim()]));
}
let screenColours = null;
const colours = () => screenColours ??= coloursOf(document.documentElement);
