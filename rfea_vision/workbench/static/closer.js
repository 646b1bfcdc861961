// A closer look at a picture: its canvas grows inside of a window that scrolls, so that a click still is a pixel of the film.
import {h, one} from "./dom.js";

const MOST = 8;
let times = 1, under = null; // how much closer than the whole picture, and where in the window the mouse is
export const closeness = () => times;

export const view = canvas => h("div", {id: "frame-view"}, canvas);
export const buttons = paint => h("p", {class: "zoom", id: "closer"},
  ...[["in", "Closer"], ["out", "Farther"], ["all", "Whole picture"]].map(([way, label]) => h("button", {type: "button", data: {closer: way}, onclick: () => look(way, paint)}, label)));

// What lies under the mouse, or else in the middle of the window, stays there.
export function look(way, paint) {
  const box = one("#frame-view"), before = times, [x, y] = under ?? [box.clientWidth / 2, box.clientHeight / 2];
  times = way === "all" ? 1 : Math.min(MOST, Math.max(1, way === "in" ? 2 * times : times / 2));
  const by = times / before, left = (box.scrollLeft + x) * by - x, top = (box.scrollTop + y) * by - y;
  paint();
  Object.assign(box, {scrollLeft: left, scrollTop: top});
}

// Who only looks drags the picture about.
export function draggable(looking) {
  const box = one("#frame-view");
  let from = null;
  box.addEventListener("pointermove", event => {
    const r = box.getBoundingClientRect();
    if (event.pointerType === "mouse") under = [event.clientX - r.left, event.clientY - r.top];
    if (from) Object.assign(box, {scrollLeft: from[0] - event.clientX, scrollTop: from[1] - event.clientY});
  });
  box.addEventListener("pointerleave", () => { under = null; });
  box.addEventListener("pointerdown", event => { if (looking() && times > 1) { from = [box.scrollLeft + event.clientX, box.scrollTop + event.clientY]; box.setPointerCapture(event.pointerId); } });
  for (const end of ["pointerup", "pointercancel"]) box.addEventListener(end, () => { from = null; });
}
