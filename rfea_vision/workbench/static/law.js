// Write one's own law: a file that this user types or opens, checked while it is typed, played and fitted at once.
import {manifest, state} from "../report/report.js";
import {h, one} from "./dom.js";
import {ask} from "./server.js";
import {begin, campaign, go, guarded, onJob} from "./main.js";

// file: where it is written, whatever name is being typed in the field; begun: whether it is more than the template
const law = {file: "", text: "", effects: [], version: 0, asked: 0, typed: 0, begun: false};

export function build() {
  one('[data-panel="law"]').append(
    h("h2", {}, "Write a law of your own"),
    h("p", {class: "muted"}, "An effect is one class: parameters with units, the value at which each is absent, and the hooks that it changes. It is Python that runs with your rights, so nothing is ever opened from a campaign: only what you type here, or a file that you name."),
    h("div", {class: "switches"}, h("label", {}, "File ", h("input", {type: "text", id: "law-file", size: 50, spellcheck: false})), h("button", {type: "button", id: "law-open", onclick: openFile}, "Open"), h("button", {type: "button", id: "law-save", onclick: saveAs}, "Save as"), h("button", {type: "button", id: "law-new", onclick: template}, "From the template"), h("button", {type: "button", id: "law-propose", onclick: propose}, "Propose one for what is left")),
    h("p", {id: "law-said", role: "status", class: "muted"}, "Nothing yet."), // above, where it is seen while one types
    h("div", {class: "lawing"},
      h("textarea", {id: "law-text", rows: 30, disabled: true, spellcheck: false, autocapitalize: "off", aria: {label: "The law, in Python", description: "Tab indents; Escape, then Tab leaves the field"}}),
      h("aside", {class: "beside"}, h("h3", {}, "What it says"), h("div", {id: "law-effects"}),
        h("div", {class: "buttons"}, h("button", {type: "button", id: "law-fit", disabled: true, onclick: fit}, "Fit with this law"), h("button", {type: "button", id: "law-play", disabled: true, onclick: playIt}, "Play with it")))));
  onJob(event => { if (event.do === "propose" && event.event === "finished" && event.result) proposed(event.result); });
  const text = one("#law-text");
  let waiting = 0;
  text.addEventListener("input", () => { law.typed++; law.begun = true; clearTimeout(waiting); allow(false); waiting = setTimeout(() => check(true), 400); });
  text.addEventListener("keydown", event => { // Tab indents; Escape lets Tab leave the field again
    if (event.key === "Escape") text.dataset.leave = "yes";
    if (event.key !== "Tab" || text.dataset.leave || event.shiftKey) return;
    event.preventDefault();
    text.setRangeText("    ", text.selectionStart, text.selectionEnd, "end"); text.dispatchEvent(new Event("input"));
  });
  text.addEventListener("focus", () => { delete text.dataset.leave; });
}
// The server sets the law; as in the report it is MathML, which browsers draw by themselves.
const setOf = mathml => [...new DOMParser().parseFromString(mathml, "text/html").body.childNodes];
export async function shown() { if (!law.file) await template(); }

function take(said) {
  Object.assign(law, said);
  one("#law-file").value = said.file; one("#law-text").value = said.text; one("#law-text").disabled = false;
  return check(false); // nothing is written before the user does something
}
// Of what is asked for the last counts, and nothing that comes late goes over what was typed meanwhile.
async function bring(address, body) {
  const asked = ++law.asked, typed = law.typed, said = await guarded(() => ask(address, body));
  if (said && asked === law.asked && typed === law.typed) { law.begun = address === "law/open"; await guarded(() => take(said)); }
}
const template = () => bring("law/template", {});
// What the worker read from the residual torque of the rung that is chosen, opened to be changed and weighed.
function propose() {
  law.before = law.typed;
  begin("propose", {model: manifest.rungs[state.rung]?.live ? undefined : manifest.rungs[state.rung]?.model}, "Propose a law for what is left");
}
async function proposed({file, sentence}) {
  go("law");
  if ((law.before ?? law.typed) === law.typed) await bring("law/open", {file}); else sentence += ` It lies in ${file}; what you have typed since stays here.`;
  one("#law-said").textContent = sentence;
}
const openFile = () => bring("law/open", {file: one("#law-file").value});
const saveAs = () => guarded(async () => { law.file = (await ask("law/new", {file: one("#law-file").value})).file; await check(true); });

async function check(keep) {
  const version = ++law.version, said = one("#law-said");
  said.textContent = "Checking…";
  try {
    const {effects} = await ask("law/check", {file: law.file, text: one("#law-text").value, keep});
    if (version !== law.version) return false;
    law.effects = effects;
    said.textContent = "Units fit, derivatives exist, and each amplitude can be absent."; said.className = "better";
    one("#law-effects").replaceChildren(...effects.map(effect => h("div", {}, h("h4", {}, effect.title), effect.law.text ? h("p", {}, effect.law.text) : null, ...setOf(effect.law.mathml),
      h("ul", {class: "plainlist"}, ...effect.parameters.map(p => h("li", {}, h("code", {}, `${effect.id}.${p.name}`), ` ${p.text}, ${p.lower} to ${p.upper}${p.unit === "1" ? "" : ` (${p.unit})`}${p.absent === null ? "" : `, absent at ${p.absent}`}`))))));
    allow(true);
    return true;
  } catch (error) {
    if (version !== law.version) return false;
    law.effects = []; said.textContent = error.message; said.className = "worse";
    one("#law-effects").replaceChildren(); allow(false);
    return false;
  }
}
function allow(on) { one("#law-fit").disabled = one("#law-play").disabled = !on; one("#law-fit").classList.toggle("primary", on && law.begun); }
const withLaw = () => [...new Set([...(campaign.play.effects() ?? []), ...law.effects.map(effect => effect.id)])];
async function fit() {
  if (!await check(true)) return;
  begin("fit", {add: withLaw(), segments: campaign.add.segments(), effect_files: [law.file]}, `Fit with ${law.effects[0].id}`); go("add"); campaign.add.want(withLaw());
}
async function playIt() {
  if (!await check(true)) return;
  campaign.play.forgetEffects(); campaign.play.addEffects(withLaw());
}
