// Campaigns: where each of a folder stands, and what runs on which worker.
import {show} from "../report/report.js";
import {h, one} from "./dom.js";
import {here} from "./server.js";
import {guarded, order, standing} from "./main.js";

const verdicts = {complete: "complete", missing: "something is missing", uncertain: "too uncertain to say", unexplained: "unexplained"};
const running = new Map(); // folder -> what is said of it while a batch runs

export function build() {
  one('[data-panel="batch"]').append(
    h("h2", {}, "Campaigns"), h("p", {class: "muted", id: "batch-folder"}),
    h("div", {class: "scroll"}, h("table", {class: "matrix", id: "batch", aria: {label: "Campaigns"}}, h("thead", {}, h("tr", {}, ...["Campaign", "Held-out error", "Verdict", "Added", "Measured", "Next", "Now"].map(text => h("th", {scope: "col"}, text)))), h("tbody", {}, h("tr", {}, h("td", {colSpan: 7, class: "muted"}, "Reading the campaigns…"))))),
    h("div", {class: "buttons"}, h("button", {type: "button", id: "run-all", onclick: () => order("../../batch", {})}, "Run all of them")),
    h("p", {class: "muted", id: "tasks", role: "status"}));
}
// The error of the first model and of the last, as far as there are two.
function cured(models) {
  const [first, last] = [models[0]?.held_out, models.at(-1)?.held_out];
  if (!last) return "–";
  const before = models.length > 1 && first?.unit === last.unit ? `${show(first.value)} → ` : "";
  return `${before}${show(last.value)} ${last.unit}`;
}
export async function shown() { await guarded(showCampaigns); }
let asked = 0, drawn = "";
async function showCampaigns() {
  const mine = ++asked, said = await standing("../../campaigns");
  if (mine !== asked) return; // a later answer tells more
  one("#batch-folder").textContent = said.folder;
  if (here < 0) one("#title").textContent = said.folder.split("/").pop();
  one("#run-all").classList.toggle("primary", here < 0 && said.campaigns.some(c => c.next.label)); // the next step of a folder
  const stands = JSON.stringify([said.campaigns, ...running]);
  if (stands === drawn) return; // a row that is drawn anew loses the focus of who goes through it with keys
  drawn = stands;
  one("#batch tbody").replaceChildren(...said.campaigns.map(c => {
    const last = c.models.at(-1), done = c.measured.filter(Boolean).length;
    return h("tr", {class: c.index === here ? "on" : "", data: {campaign: c.index}}, h("th", {scope: "row"}, h("a", {href: `../${c.index}/`}, c.name), h("br"), h("small", {class: "muted"}, c.folder)),
      h("td", {class: "whole"}, cured(c.models)), h("td", {}, last ? `${verdicts[last.uncertain && last.verdict !== "missing" ? "uncertain" : last.verdict] ?? "not asked"}${last.asks_less && !last.uncertain ? " as far as the held-out runs ask" : ""}` : "–"), h("td", {}, last?.effects.join(", ").replaceAll("_", " ") || "–"), h("td", {}, c.problems.length ? h("span", {class: "worse"}, c.problems[0]) : `${done} of ${c.measured.length} runs`), h("td", {class: "muted"}, c.next.label ?? ""), h("td", {class: "muted"}, running.get(c.folder) ?? ""));
  }));
}
export function hear(event) {
  if (event.event === "campaign") { running.set(event.folder, event.status); guarded(showCampaigns); }
  if (event.event === "tasks") one("#tasks").textContent = event.sentence;
  if (event.do === "batch" && ["finished", "failed", "stopped"].includes(event.event)) { one("#tasks").textContent = ""; guarded(showCampaigns); }
}
