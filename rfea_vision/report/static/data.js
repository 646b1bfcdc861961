// Series: one deflated block of 16-bit numbers; an address is {at, shape, zero, step}.
const manifest = JSON.parse(document.getElementById("manifest").textContent);
let block = null;
function takeBlock(bytes) { block = bytes; }
const unpacked = new WeakMap();

function bytesOf(text) {
  const raw = atob(text.trim()), bytes = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
  return bytes;
}

async function openSeries() {
  const element = document.getElementById("series");
  const stream = new Blob([bytesOf(element.textContent)]).stream().pipeThrough(new DecompressionStream("deflate"));
  block = await new Response(stream).arrayBuffer();
  element.textContent = "";
}

// The array behind an address, as numbers (NaN where there is none); undefined where there is no address. An array is itself.
function series(address) {
  if (!address || ArrayBuffer.isView(address)) return address ?? undefined;
  let out = unpacked.get(address);
  if (out) return out;
  const count = address.shape.reduce((a, b) => a * b, 1), whole = new Int16Array(block, address.at, count);
  out = new Float64Array(count);
  for (let i = 0; i < count; i++) out[i] = whole[i] === -32768 ? NaN : address.zero + address.step * whole[i];
  out.shape = address.shape;
  unpacked.set(address, out);
  return out;
}

// Column k of an (n, m) array.
function column(array, k) {
  if (!array) return undefined;
  const width = array.shape[1];
  array.columns ??= [];
  if (!array.columns[k]) {
    const out = new Float64Array(array.shape[0]);
    for (let i = 0; i < out.length; i++) out[i] = array[i * width + k];
    array.columns[k] = out;
  }
  return array.columns[k];
}

// Row of the sorted array that lies nearest to the value.
function nearest(array, value) {
  let low = 0, high = array.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (array[middle] <= value) low = middle; else high = middle;
  }
  return value - array[low] <= array[high] - value ? low : high;
}

function extent(...arrays) {
  let low = Infinity, high = -Infinity;
  for (const array of arrays) {
    if (!array) continue;
    for (let i = 0; i < array.length; i++) {
      const v = array[i];
      if (v < low) low = v;
      if (v > high) high = v;
    }
  }
  return low <= high ? [low, high] : [0, 1];
}

// Where a colour scale ends: beyond lies a share of the values, since a few wild ones (the ends of a smoothed run) leave all others pale.
const BEYOND = 0.005;
function colourEnd(...arrays) {
  const sizes = Float64Array.from(arrays.flatMap(array => [...array ?? []]).filter(v => v === v), Math.abs).sort();
  return sizes[Math.floor((1 - BEYOND) * (sizes.length - 1))] || 1;
}

// What is shown, and who wants to know when it changes.
const state = {rung: 0, earlier: false, experiment: 0, time: 0, window: [0, 1], same: true, segment: 0, against: "angle", shift: 0};
const listeners = {};
function on(events, action) { for (const name of events.split(" ")) (listeners[name] ??= []).push(action); }
function tell(name) { for (const action of listeners[name] ?? []) action(); }

const shownRung = () => state.earlier ? Math.max(0, state.rung - 1) : state.rung;
const rung = () => manifest.rungs[shownRung()];
const rungBefore = () => state.earlier ? undefined : rung()?.before ?? (manifest.rungs[state.rung - 1]?.ladder === rung()?.ladder ? manifest.rungs[state.rung - 1] : undefined);
const experiment = () => manifest.experiments[state.experiment];
const prediction = (of = rung()) => of?.experiments[experiment()?.name];
const predictionBefore = () => { const before = rungBefore(); return before && prediction(before); };

// To the second digit of its standard error, however far two clocks are apart.
function toError(value, error) {
  return error > 0 ? value.toFixed(Math.min(6, Math.max(0, 1 - Math.floor(Math.log10(error))))).replace("-", "−") : show(value, 4);
}
function show(value, digits = 3) {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  if (value === 0) return "0";
  const size = Number(value.toExponential(digits - 1).split("e")[1]); // of the rounded number
  const text = size < -4 || size > 5 ? value.toExponential(digits - 1) : value.toFixed(Math.max(0, digits - 1 - size));
  return text.replace("-", "−");
}
