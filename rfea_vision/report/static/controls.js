// Choosing a rung, an experiment, a moment; keys; theme; tables to CSV; printing.
const one = selector => document.querySelector(selector), every = selector => [...document.querySelectorAll(selector)];

function chooseRung(index) {
  if (!manifest.rungs[index]) return;
  state.rung = index;
  tell("rung");
}

function holdEarlier(held) {
  if (state.earlier === held || state.rung === 0) return;
  state.earlier = held;
  tell("rung");
}

function chooseExperiment(index) {
  const e = manifest.experiments[index];
  if (!e) return;
  play(false);
  state.experiment = index;
  if (e.span) { state.window = [...e.span]; state.time = Math.min(e.span[1], Math.max(e.span[0], state.time)); }
  tell("experiment"); tell("time");
}

function jump(name, from, to) {
  const index = manifest.experiments.findIndex(e => e.name === name);
  if (index < 0) return;
  if (index !== state.experiment) chooseExperiment(index);
  jumpToPeak(from, to);
  one("#see .see").scrollIntoView({block: "start"});
}

function showRung() {
  const shown = shownRung();
  every("[data-rung]").forEach(element => { element.hidden = Number(element.dataset.rung) !== shown; });
  every("[role=radio][data-choose]").forEach(element => {
    const index = Number(element.dataset.choose);
    element.setAttribute("aria-checked", index === state.rung); element.tabIndex = index === state.rung ? 0 : -1;
    element.classList.toggle("earlier", state.earlier && index === shown);
  });
  every(".on-rung").forEach(note => { note.textContent = rung() ? `${rung().ladder ? `rung ${shown + 1} of ${manifest.rungs.filter(r => r.ladder).length}: ` : ""}${rung().name}` : ""; note.classList.toggle("earlier", state.earlier); });
  every("tr[data-choose]").forEach(row => row.classList.toggle("on", Number(row.dataset.choose) === shown));
  const said = one("#said"), r = rung();
  if (said && r) said.textContent = `Rung ${shown + 1}, ${r.name}: error ${show(r.validate ?? r.train, 3)} ${r.unit}`;
  const hold = one("#before");
  if (hold) { hold.classList.toggle("on", state.earlier); hold.disabled = !state.earlier && !rungBefore(); }
  const count = prediction()?.torque?.shape[1] ?? 1, slider = one("#segment");
  if (slider) { slider.max = count; state.segment = Math.min(state.segment, count - 1); slider.value = state.segment + 1; one("#segment-name").textContent = `${state.segment + 1} of ${count}, from the clamp`; }
}

function showExperiment() {
  every("[data-experiment]").forEach(tab => { const here = Number(tab.dataset.experiment) === state.experiment; tab.setAttribute("aria-selected", here); if (here) one("#run")?.setAttribute("aria-labelledby", tab.id); });
  const scrub = one("#scrub"), e = experiment();
  if (scrub && e?.tp) scrub.max = series(e.tp).length - 1;
}

// Above the slider: worst moments of this rung, and frames that were set aside.
function showMarks() {
  const marks = one("#marks"), e = experiment();
  if (!marks || !e?.span) return;
  const [from, to] = e.span, bands = [...(rung()?.worst ?? []).filter(w => w.experiment === e.name).map(w => [w.from_s, w.to_s, ""]), ...e.gaps.map(g => [g.from, g.to, "gap"])];
  marks.replaceChildren(...bands.map(([a, b, kind]) => {
    const mark = document.createElement("i");
    mark.className = kind; mark.style.left = `${100 * (a - from) / (to - from)}%`; mark.style.width = `${100 * (b - a) / (to - from)}%`;
    return mark;
  }));
}

function showTime() {
  const scrub = one("#scrub");
  if (!scrub || !experiment()?.tp) return;
  scrub.value = pose(); scrub.setAttribute("aria-valuetext", `${state.time.toFixed(2)} seconds`);
  one("#clock").textContent = `${state.time.toFixed(3)} s`;
}

function step(by) { const e = experiment(); if (e?.tp) setTime(poseTime(Math.min(series(e.tp).length - 1, Math.max(0, pose() + by)))); }

// The address keeps section, rung, run and instant: reloading comes back to them, and a copied address leads to them.
function rememberPlace() {
  clearTimeout(rememberPlace.waiting);
  rememberPlace.waiting = setTimeout(() => {
    const section = location.hash.slice(1).split("?")[0] || "see", place = new URLSearchParams({rung: rung()?.model ?? "", run: experiment()?.name ?? "", t: state.time.toFixed(3)});
    try { history.replaceState(null, "", `#${section}?${place}`); } catch { /* some browsers keep the address of a file as it is */ }
  }, 250);
}
function recallPlace() {
  const [section, query] = location.hash.slice(1).split("?");
  if (!query) return false;
  const place = new URLSearchParams(query), index = manifest.rungs.findIndex(r => r.model === place.get("rung")), run = manifest.experiments.findIndex(e => e.name === place.get("run"));
  if (index >= 0) state.rung = index;
  chooseExperiment(Math.max(0, run)); tell("rung"); setTime(Number(place.get("t")) || 0);
  document.getElementById(section)?.scrollIntoView({block: "start"});
  return true;
}

const actions = {
  ArrowLeft: event => step(event.shiftKey ? -10 : -1), ArrowRight: event => step(event.shiftKey ? 10 : 1), " ": () => play(),
  "[": () => chooseExperiment(state.experiment - 1), "]": () => chooseExperiment(state.experiment + 1),
  "+": () => zoom("in"), "=": () => zoom("in"), "-": () => zoom("out"), 0: () => zoom("all"), s: () => toggleScale(), t: () => toggleTheme(), "?": () => one("#help").showModal(),
};
function toggleScale(same = !state.same) { state.same = same; every(".same-scale").forEach(box => { box.checked = same; }); Figure.redraw(); }

function listenKeys() {
  addEventListener("keydown", event => {
    const at = event.target instanceof Element ? event.target : document.body;
    if (event.ctrlKey || event.metaKey || event.altKey || one("#help").open || at.matches("select, input:not([type=range]):not([type=checkbox])")) return;
    if (at.matches("button, summary, input[type=checkbox]") && event.key === " ") return;
    const ladder = at.closest(".ladder");
    if (ladder && (event.key === "ArrowUp" || event.key === "ArrowDown")) {
      chooseRung(Math.min(manifest.rungs.length - 1, Math.max(0, state.rung + (event.key === "ArrowDown" ? 1 : -1))));
      one("[role=radio][aria-checked=true]").focus();
      return event.preventDefault();
    }
    if (event.key === "b" || event.key === "B") return holdEarlier(true);
    if (/^[1-9]$/.test(event.key)) return chooseRung(Number(event.key) - 1);
    const action = actions[event.key] ?? actions[event.key.toLowerCase()];
    if (action && !(at.matches("#segment") && event.key.startsWith("Arrow"))) { event.preventDefault(); action(event); }
  });
  addEventListener("keyup", event => { if (event.key === "b" || event.key === "B") holdEarlier(false); });
  addEventListener("blur", () => holdEarlier(false));
}

function setTheme(name) { document.documentElement.dataset.theme = name; screenColours = null; Figure.redraw(); paintStage(); }
function toggleTheme() {
  const name = document.documentElement.dataset.theme === "dark" ? "light" : "dark";
  setTheme(name);
  try { localStorage.setItem("rfea-theme", name); } catch { /* storage may be closed to files */ }
}

function csvOf(table) {
  const own = element => { const id = element.querySelector(":scope > br + code"); return id ? {textContent: `${element.firstChild.textContent.trim()} (${id.textContent})`} : element; };
  const cell = element => { const text = element.dataset.value ?? own(element).textContent.trim().replace(/\s+/g, " ").replace(/^–$/, "").replaceAll("−", "-"); return /[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text; };
  return [...table.rows].filter(row => !row.matches(".aside")).map(row => [...row.cells].map(cell).join(",")).join("\r\n") + "\r\n";
}

function dressTables() {
  for (const table of every("table[data-csv]")) {
    const box = document.createElement("div"), button = document.createElement("button"), scroll = table.parentElement;
    box.className = "tablebox"; button.type = "button"; button.className = "csv"; button.textContent = "CSV"; button.setAttribute("aria-label", `Save table ${table.dataset.csv} as CSV`);
    button.addEventListener("click", () => download(new Blob([csvOf(table)], {type: "text/csv"}), `${table.dataset.csv}.csv`));
    scroll.replaceWith(box); box.append(scroll, button);
  }
  for (const box of every(".copy")) {
    const button = document.createElement("button");
    button.type = "button"; button.className = "copier"; button.textContent = "Copy";
    button.addEventListener("click", async () => { await navigator.clipboard?.writeText([...box.querySelectorAll("p, pre")].map(e => e.textContent).join("\n\n")); button.textContent = "Copied"; setTimeout(() => { button.textContent = "Copy"; }, 1500); });
    box.append(button);
  }
}

// On paper: light colours, every figure as SVG, drawn as wide as its column is there, so that type keeps its size.
function paperWidth(element) {
  if (element.closest(".thirds, .halves")) return 330;
  if (element.closest(".twothirds")) return element === element.parentElement.firstElementChild ? 450 : 230;
  return element.closest(".linked") ? 440 : 690;
}
// What differs from rung to rung is printed for the first and for the last.
const rungsOnPaper = () => { const climbed = manifest.rungs.map((r, i) => [r, i]).filter(([r]) => r.ladder); return [...new Set([climbed.at(0)?.[1] ?? 0, climbed.at(-1)?.[1] ?? 0])]; };
function sheetsOf(figure) {
  const chosen = state.rung, size = [paperWidth(figure.element), parseFloat(figure.element.style.getPropertyValue("--height"))], sheets = [];
  for (const index of rungsOnPaper()) {
    state.rung = index;
    if (figure.plot.need?.()) continue;
    const svg = figure.svg(...size);
    if (!sheets.some(([, other]) => other === svg)) sheets.push([index, svg]);
  }
  state.rung = chosen;
  return sheets;
}
let themeBefore = null;
function toPaper() {
  if (themeBefore !== null) return;
  themeBefore = document.documentElement.dataset.theme;
  setTheme("light");
  for (const element of every("[data-rung]")) {
    const index = Number(element.dataset.rung);
    element.hidden = !rungsOnPaper().includes(index);
    const title = document.createElement("p");
    title.className = "rung-on-paper"; title.textContent = `Rung ${index + 1}: ${manifest.rungs[index].name}`;
    if (rungsOnPaper().length > 1) element.prepend(title);
  }
  for (const figure of Figure.all) {
    const why = figure.plot.need?.();
    figure.element.classList.toggle("empty", Boolean(why));
    figure.holder.querySelector(".why")?.remove();
    figure.base.hidden = figure.top.hidden = true;
    if (why) { const note = figure.holder.appendChild(document.createElement("p")); note.className = "why"; note.textContent = why.replaceAll("`", ""); continue; }
    const sheets = sheetsOf(figure);
    for (const [index, svg] of sheets) {
      const sheet = document.createElement("div");
      sheet.className = "sheet"; sheet.innerHTML = svg;
      if (sheets.length > 1) sheet.prepend(Object.assign(document.createElement("p"), {className: "rung-on-paper", textContent: `Rung ${index + 1}: ${manifest.rungs[index].name}`}));
      figure.holder.append(sheet);
    }
  }
}
function fromPaper() {
  if (themeBefore === null) return;
  every(".sheet, .rung-on-paper").forEach(sheet => sheet.remove());
  showRung();
  for (const figure of Figure.all) figure.base.hidden = figure.top.hidden = false;
  setTheme(themeBefore);
  themeBefore = null;
}
