// Wire the page up: series first, then figures; films when they are wanted.
function listen(selector, event, action) { every(selector).forEach(element => element.addEventListener(event, () => action(element))); }

function wire() {
  listen("[data-choose]", "click", element => chooseRung(Number(element.dataset.choose)));
  listen("[data-experiment]", "click", element => chooseExperiment(Number(element.dataset.experiment)));
  listen("[data-jump]", "click", element => jump(element.dataset.jump, Number(element.dataset.from), Number(element.dataset.to)));
  listen("[data-zoom]", "click", element => zoom(element.dataset.zoom));
  listen("#scrub", "input", element => setTime(poseTime(Number(element.value))));
  listen("#play", "click", () => play());
  listen("#lens, #outline", "change", paintStage);
  listen(".same-scale", "change", element => toggleScale(element.checked));
  listen("#segment", "input", element => { state.segment = Number(element.value) - 1; showRung(); Figure.redraw(); });
  listen("#against", "change", element => { state.against = element.value; Figure.redraw(); });
  listen("#theme", "click", toggleTheme);
  listen("#keys", "click", () => one("#help").showModal());
  listen("#snapshot", "click", saveStage);
  for (const event of ["pointerdown", "pointerenter"]) listen("#before", event, () => holdEarlier(true));
  for (const event of ["pointerleave", "pointercancel"]) listen("#before", event, () => holdEarlier(false));
  listenKeys();
  addEventListener("beforeprint", toPaper);
  addEventListener("afterprint", fromPaper);
  listen("#link", "click", async button => { await navigator.clipboard?.writeText(location.href); button.textContent = "Copied"; setTimeout(() => { button.textContent = "Link to this instant"; }, 1500); });
  on("rung experiment time", rememberPlace);
  addEventListener("hashchange", () => { if (!location.hash.includes("?")) rememberPlace(); });
  on("rung experiment", showMarks);
  on("rung", () => { showRung(); Figure.redraw(); paintStage(); });
  on("experiment", () => { showExperiment(); showRung(); Figure.redraw(); });
  on("window", () => Figure.redraw());
  on("time", () => { showTime(); Figure.move(); seek(); paintStage(); });
  if (stage.canvas) new ResizeObserver(() => paintStage()).observe(stage.canvas.parentElement);
}

function followSections() {
  const links = new Map(every(".sections a").map(link => [link.hash.slice(1), link]));
  const watch = new IntersectionObserver(entries => {
    for (const entry of entries) if (entry.isIntersecting) { links.forEach(link => link.classList.remove("here")); links.get(entry.target.id)?.classList.add("here"); }
  }, {rootMargin: "-20% 0px -70% 0px"});
  every("main > section, #ladder, #fit").forEach(section => watch.observe(section));
}

async function start() {
  dressTables();
  followSections();
  await openSeries();
  Figure.all = every("[data-figure]").map(element => new Figure(element));
  wire();
  showRung();
  // Begin where the first rung fails most: that is what the page is about.
  if (recallPlace()) { document.documentElement.dataset.ready = "yes"; return; }
  const [index, time] = worstMoment();
  chooseExperiment(index);
  if (experiment()?.span) setTime(time ?? experiment().span[0]);
  document.documentElement.dataset.ready = "yes";
}
start();
