// The scale of a film: two points in it, and what lies between them. What was clicked or typed stays until it is written.
import {h, one} from "./dom.js";

const COLOUR = "#c9a6ff";
export const tool = {label: "Scale", say: "First frame: click two points a known distance apart, beside the tube and far from each other: a ruler, ruled paper, a thing of known size."};

export const form = keep => h("form", {id: "scale-form", class: "switches", hidden: true, onsubmit: event => { event.preventDefault(); keep(); }},
  h("label", {}, "Distance between them, with its unit ", h("input", {type: "text", id: "scale-distance", size: 9, placeholder: "155 mm", autocomplete: "off"})),
  h("label", {title: "Marks on paper behind the tube are farther from the camera than its outline: of a round tube that is its middle, of a flat finger its front face. Left empty, they lie in the plane of the outline."}, "How far they lie behind the tube ", h("input", {type: "text", id: "scale-behind", size: 7, placeholder: "0 mm", autocomplete: "off"})),
  h("label", {class: "muted"}, h("input", {type: "checkbox", id: "scale-own"}), "for this film alone"),
  h("button", {type: "submit", id: "keep-scale"}, "Keep this scale"));

// The form as the files have it, when the tool is taken; a film with a scale of its own keeps it there.
export function fill(scale) {
  one("#scale-distance").value = scale?.distance ?? "";
  one("#scale-behind").value = scale?.behind ?? "";
  Object.assign(one("#scale-own"), {checked: Boolean(scale?.own), disabled: Boolean(scale?.own)});
}
export function ready(points) {
  one("#keep-scale").disabled = points.length !== 2;
  one("#keep-scale").classList.toggle("primary", points.length === 2);
}
export const asked = points => ({points, distance: one("#scale-distance").value, behind: one("#scale-behind").value});
export const alone = () => one("#scale-own").checked;
const apart = ([[x0, y0], [x1, y1]]) => Math.round(Math.hypot(x1 - x0, y1 - y0));
export const words = ({points, distance, behind}) => distance ? `${distance} over ${apart(points)} px${behind ? `, ${behind} behind` : ""}` : points.length ? `${points.length} known places` : "the tube's own length";

// A dimension line as in a drawing; points without a distance are known places.
export function paint(c, {points, distance}, at) {
  const ends = points.map(at), line = distance && ends.length === 2;
  const [[x0, y0], [x1, y1]] = line ? ends : [[0, 0], [0, 0]], long = Math.hypot(x1 - x0, y1 - y0) || 1, [u, v] = [7 * (y1 - y0) / long, -7 * (x1 - x0) / long];
  c.beginPath();
  for (const [x, y] of ends) line ? (c.moveTo(x - u, y - v), c.lineTo(x + u, y + v)) : (c.moveTo(x + 5, y), c.arc(x, y, 5, 0, 7));
  if (line) { c.moveTo(x0, y0); c.lineTo(x1, y1); }
  for (const [colour, width] of [["rgb(0 0 0 / .55)", 4], [COLOUR, 2]]) { c.strokeStyle = colour; c.lineWidth = width; c.stroke(); }
  if (!line) return;
  c.font = "600 13px system-ui, sans-serif"; c.textBaseline = "middle";
  const wide = c.measureText(distance).width, x = Math.min((x0 + x1) / 2 + 8, c.canvas.clientWidth - wide - 4), y = (y0 + y1) / 2;
  c.strokeStyle = "rgb(0 0 0 / .75)"; c.lineWidth = 3; c.strokeText(distance, x, y); c.fillStyle = COLOUR; c.fillText(distance, x, y);
}
