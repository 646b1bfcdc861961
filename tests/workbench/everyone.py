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
WINDOWS = {"light": {"width": 1280, "height": 900}, "dark": {"width": 400, "height": 860}}

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
    count = page.evaluate(f"{CONTROLS}.length".replace("SCOPE", scope))
    for pressed in range(count + 3):  # Chromium stops at what scrolls, too
        if pressed >= count and not page.evaluate(MISSED.replace("SCOPE", scope)):
            break
        if indents and page.evaluate("document.activeElement.matches('textarea')"):
            page.keyboard.press("Escape")  # Tab indents there
        page.keyboard.press("Tab")
    return [*page.evaluate(MISSED.replace("SCOPE", scope)), *page.evaluate("[...ringless]")]


def unfit(page: Any, *panels: str) -> dict[str, list[str]]:
    """What on these panels somebody cannot use, in a wide light window or on a dark phone; around them, too."""
    found: dict[str, list[str]] = {}
    for panel in panels:
        page.set_viewport_size(WINDOWS["light"])
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
        for theme, window in WINDOWS.items():
            page.set_viewport_size(window)
            page.wait_for_timeout(100)
            assert page.get_attribute("html", "data-theme") == theme
            wide = page.evaluate("document.documentElement.scrollWidth")
            found[f"{panel}, {theme}: overflows"] = [f"{wide} px"] if wide > window["width"] else []
            found[f"{panel}, {theme}: faint"] = page.evaluate(FAINT_TEXT)
            page.keyboard.press("t")
    return {what: where for what, where in found.items() if where}
