// Elements by hand: whatever comes from a file becomes text, never markup.
export const one = selector => document.querySelector(selector), every = selector => [...document.querySelectorAll(selector)];

// h("button", {type: "button", onclick: f, class: "x", data: {a: 1}, aria: {label: "…"}}, child, "text", …)
export function h(tag, given = {}, ...children) {
  const element = document.createElement(tag);
  for (const [key, value] of Object.entries(given)) {
    if (value === undefined || value === null || value === false) continue;
    if (key.startsWith("on")) element.addEventListener(key.slice(2), value);
    else if (key === "class") element.className = value;
    else if (key === "data") Object.assign(element.dataset, value);
    else if (key === "style") for (const [name, text] of Object.entries(value)) element.style.setProperty(name, text);
    else if (key === "aria") for (const [name, text] of Object.entries(value)) element.setAttribute(`aria-${name}`, text);
    else if (key in element && key !== "list" && key !== "form") element[key] = value;
    else element.setAttribute(key, value);
  }
  element.append(...children.flat().filter(child => child !== undefined && child !== null && child !== false));
  return element;
}

// A figure of the report: its canvas follows the state by itself once `Figure` knows it.
export function figure(name, title, label, height) {
  return h("figure", {class: "figure", data: {figure: name}, style: {"--height": `${height}px`}},
    h("header", {}, h("h3", {}, title), h("span", {class: "readout", aria: {hidden: "true"}})),
    h("div", {class: "canvas", role: "img", aria: {label}}));
}
