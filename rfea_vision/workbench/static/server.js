// Talking to the server. Addresses are relative: the page's own carries the token.
export const here = Number(location.pathname.match(/\/c\/(\d+)\/$/)?.[1] ?? -1); // number of the campaign, -1 for the folder

async function said(answer) {
  if (answer.ok) return answer;
  let sentence = `the workbench answered ${answer.status}`;
  try { sentence = (await answer.json()).error ?? sentence; } catch { /* no sentence came with it */ }
  throw new Error(sentence);
}
const lost = error => { throw error instanceof TypeError ? new Error("the workbench does not answer: has the command been ended?") : error; };

const fetched = path => fetch(path).catch(lost).then(said);
export const get = path => fetched(path).then(answer => answer.json());
export const getPacket = path => fetched(path).then(packetOf);
export const post = (path, body) => fetch(path, {method: "POST", headers: {"Content-Type": "application/json"}, body: JSON.stringify(body)}).catch(lost).then(said);
export const ask = (path, body) => post(path, body).then(answer => answer.json());

// A packet: length of a JSON header, the header, a block of 16-bit numbers.
export async function packetOf(answer) {
  const bytes = await answer.arrayBuffer(), length = new DataView(bytes).getUint32(0, true);
  return {header: JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 4, length))), block: bytes.slice(4 + length)};
}

// Arrays of a record that came with its own block.
export function unpack(record, block) {
  const out = {};
  for (const [key, value] of Object.entries(record)) {
    if (!value || typeof value !== "object" || !("at" in value && "step" in value)) { out[key] = value; continue; }
    const count = value.shape.reduce((a, b) => a * b, 1), whole = new Int16Array(block, value.at, count), numbers = new Float64Array(count);
    for (let i = 0; i < count; i++) numbers[i] = whole[i] === -32768 ? NaN : value.zero + value.step * whole[i];
    out[key] = Object.assign(numbers, {shape: value.shape});
  }
  return out;
}

// Everything that happens, as it happens; the browser takes the line up again by itself, but what was said meanwhile is lost.
export function listenTo(action, opened) {
  const events = new EventSource("../../events");
  events.addEventListener("message", message => action(JSON.parse(message.data)));
  events.addEventListener("open", opened);
}
