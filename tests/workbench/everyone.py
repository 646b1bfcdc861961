"""What a page owes to whoever uses it: names for a screen reader, text that can be read, keys that reach everything, one next step."""

from __future__ import annotations

from typing import Any

from testing.readable import FAINT_TEXT

#: What a person can operate, by the roles that Chromium itself gives out, and what must be said where it cannot be seen.
NAMED = {
    "button", "checkbox", "combobox", "application", "dialog", "DisclosureTriangle", "image", "img", "link", "menuitem", "progressbar",
    "radio", "radiogroup", "searchbox", "slider", "spinbutton", "tab", "table", "tablist", "textbox",
}  # fmt: skip
#: When what comes late is there to stay.
THERE = {"play": "html[data-look=exact]", "law": "#law-said.better", "batch": "#batch tr[data-campaign]"}
WIDE, NARROW = {"width": 1280, "height": 900}, {"width": 400, "height": 860}

#: Buttons, and links that look like one, in the colour of the next step.
HIGHLIGHTED = """[...document.querySelectorAll('button, a')].filter(b => b.checkVisibility() && !b.disabled
  && getComputedStyle(b).backgroundColor === getComputedStyle(document.querySelector('.probe')).color).map(b => b.textContent)"""
PROBE = "document.body.append(Object.assign(document.createElement('i'), {className: 'probe plain', hidden: true}))"

#: Notes what the Tab key comes to, and what of it shows no ring.
LISTEN = """(() => { window.reached = new Set(); window.ringless = new Set();
  document.addEventListener('focusin', ({target}) => {
    reached.add(target);
    if (getComputedStyle(target).outlineStyle === 'none') ringless.add(target.outerHTML.slice(0, 90));
  }); })()"""
CONTROLS = """[...document.querySelectorAll('SCOPE :is(a[href], button, input, select, textarea, summary, [tabindex])')].filter(e =>
  e.tabIndex >= 0 && !e.disabled && e.checkVisibility({visibilityProperty: true}))"""
MISSED = f"{CONTROLS}.filter(e => !reached.has(e)).map(e => e.outerHTML.slice(0, 90))"
#: Things that can be clicked and that no key reaches: of a group of radios one is reached, arrows go to the others.
UNREACHED = """[...document.querySelectorAll('button, input, summary')].filter(e => e.tabIndex < 0 && !e.disabled
  && e.checkVisibility() && !e.closest('[role=radiogroup]')).map(e => e.outerHTML.slice(0, 90))"""

#: What sticks out of its panel to the right, but for what lies in something that scrolls.
STICKS_OUT = """[...document.querySelectorAll('[data-panel=PANEL] *')].filter(e => {
  const scrolls = p => p.dataset.panel === undefined && (getComputedStyle(p).overflowX !== 'visible' || scrolls(p.parentElement));
  return e.checkVisibility() && !e.matches('.sr, .sr *, canvas, option') && !scrolls(e.parentElement)
    && e.getBoundingClientRect().right > e.closest('[data-panel]').getBoundingClientRect().right + 1;
}).map(e => e.outerHTML.slice(0, 90))"""


def highlighted(page: Any) -> list[str]:
    """Text of every button that is drawn as the next thing to do."""
    if page.locator(".probe").count() == 0:
        page.evaluate(PROBE)
    return page.evaluate(HIGHLIGHTED)


def nameless(page: Any) -> list[str]:
    """Controls and pictures without a name, as Chromium tells them to a screen reader."""
    session = page.context.new_cdp_session(page)
    tree = session.send("Accessibility.getFullAXTree")["nodes"]
    session.detach()
    told = [(node["role"]["value"], node.get("name", {}).get("value", "")) for node in tree if not node["ignored"]]
    return [role for role, name in told if role in NAMED and not name.strip()]


def walked_with_tab(page: Any, scope: str) -> list[str]:
    """What of a part of the page the Tab key does not come to, or comes to without a ring to be seen."""
    page.click(f"{scope} {'h2' if scope != 'body' else '#title'}")  # from here the key goes on
    page.evaluate(LISTEN)
    indents = page.locator("textarea:visible").count()
    pressed, count = 0, f"{CONTROLS}.length".replace("SCOPE", scope)
    while pressed < (controls := page.evaluate(count)) + 3:  # some come late; Chromium stops at what scrolls, too
        if pressed >= controls and not page.evaluate(MISSED.replace("SCOPE", scope)):
            break
        if indents and page.evaluate("document.activeElement.matches('textarea')"):
            page.keyboard.press("Escape")  # Tab indents there
        page.keyboard.press("Tab")
        pressed += 1
    return [*page.evaluate(MISSED.replace("SCOPE", scope)), *page.evaluate("[...ringless]")]


def unfit(page: Any, *panels: str) -> dict[str, list[str]]:
    """What on these panels somebody cannot use, in a wide window or on a phone, light or dark; around them, too."""
    found: dict[str, list[str]] = {}
    for panel in panels:
        page.set_viewport_size(WIDE)
        page.click(f'.places a[href="#/{panel}"]')
        page.wait_for_selector(f"[data-panel={panel}] h2", state="visible")
        for details in page.locator(f"[data-panel={panel}] details:not([open]) > summary").all():
            if details.is_visible():
                details.click()
        page.wait_for_timeout(200)
        if panel in THERE:
            page.wait_for_selector(THERE[panel])
        found |= {f"{panel}: no name": nameless(page), f"{panel}: no key": page.evaluate(UNREACHED)}
        found[f"{panel}: Tab"] = walked_with_tab(page, f"[data-panel={panel}]" if panel != panels[0] else "body")
        page.evaluate("document.activeElement.blur()")
        for window in (WIDE, NARROW):
            page.set_viewport_size(window)
            page.wait_for_timeout(100)
            where = f"{panel} at {window['width']} px"
            wide = page.evaluate("document.documentElement.scrollWidth")
            found[f"{where}: overflows"] = [f"{wide} px"] if wide > window["width"] else []
            found[f"{where}: sticks out"] = page.evaluate(STICKS_OUT.replace("PANEL", panel))
            for _ in range(2):
                found[f"{where}, {page.get_attribute('html', 'data-theme')}: faint"] = page.evaluate(FAINT_TEXT)
                page.keyboard.press("t")
        assert {name.rpartition(", ")[2] for name in found if "faint" in name} == {"light: faint", "dark: faint"}
    return {what: where for what, where in found.items() if where}
