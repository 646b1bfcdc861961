"""The page as a person uses it, in a real Chromium."""

from __future__ import annotations

import time

import pytest

pytestmark = pytest.mark.chromium


@pytest.fixture(scope="module")
def served(serve, fitted):
    return serve(fitted)


def settled(page) -> None:
    """Wait until the last look was taken in the steps of a fit."""
    page.wait_for_selector("html[data-look=exact]")


def until(condition, seconds: float = 30) -> None:
    """Wait for the page; its policy forbids the evaluation of text that Playwright's own waiting needs."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "never came true"
        time.sleep(0.05)


def number(page, selector: str) -> float:
    return float(page.text_content(selector).split()[0].replace("−", "-"))


def test_the_modelled_tube_follows_a_slider_and_undo_takes_it_back(served, visit):
    page = visit(served.address + "#/play")
    settled(page)
    before = number(page, "#now-validate")
    assert page.text_content("#scores tr:last-child td:nth-child(2)") == page.text_content(
        "#scores tr:last-child td:nth-child(3)"
    )
    slider = page.locator('[data-name="r_hyd"]')
    slider.focus()
    for _ in range(30):
        slider.press("ArrowRight")
    settled(page)
    moved = number(page, "#now-validate")
    assert moved > before + 0.05 and "worse" in page.get_attribute("#now-validate", "class")
    page.keyboard.press("Control+z")
    until(lambda: abs(number(page, "#now-validate") - before) < 0.002)


def test_an_effect_of_the_catalogue_gets_sliders(served, visit):
    page = visit(served.address + "#/play")
    settled(page)
    page.click("#more-effects summary")
    page.check('#effects input[value="maxwell"]')
    page.wait_for_selector('[data-name="maxwell.k1"]')
    settled(page)
    before = page.text_content("#now-train")
    page.fill('[data-name="maxwell.k1"]', "400")
    until(lambda: page.text_content("#now-train") != before)
