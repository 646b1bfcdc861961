"""Pointing at the tube, in a real Chromium: on a film whose tube is only found with hints."""

from __future__ import annotations

import time

import pytest

from rfea_vision.artefacts import Track
from rfea_vision.campaign import load_campaign
from rfea_vision.stages import open_campaign

from .conftest import at_rest, hold, idle, until
from .everyone import highlighted, unfit
from .filmed import HIDDEN, LAMP_PX, OFFSET_S, RATE_HZ, write_film, write_log

pytestmark = pytest.mark.chromium


@pytest.fixture(scope="module")
def film(tmp_path_factory):
    folder = tmp_path_factory.mktemp("film") / "two-tubes"
    return folder, write_film(folder)


@pytest.fixture(scope="module")
def served(serve, film):
    return serve(film[0])


#: Pixels of the film from side to side.
WIDTH = "fetch('film/0').then(answer => answer.json()).then(film => film.width)"


def point(page, at, until=None, canvas="#frame") -> None:
    """Click a pixel of the film, or drag from it to another."""
    page.wait_for_selector(f"{canvas}[width]")  # it is drawn, and listens
    page.locator(canvas).scroll_into_view_if_needed()
    box = at_rest(page, canvas)
    scale = box["width"] / page.evaluate(WIDTH)
    x, y = ((at[0] + 0.5) * scale + box["x"], (at[1] + 0.5) * scale + box["y"])
    page.mouse.move(x, y)
    page.mouse.down()
    if until is not None:
        page.mouse.move((until[0] + 0.5) * scale + box["x"], (until[1] + 0.5) * scale + box["y"], steps=4)
    page.mouse.up()


def slowly(route) -> None:
    """A picture on a busy machine: what plays through them still plays when the next thing is asked for."""
    time.sleep(0.2)
    route.continue_()


def test_a_tube_is_found_where_one_points(film, served, visit):
    folder, places = film
    page = visit(served.address)
    assert "have not been measured" in page.text_content("#next-say") and highlighted(page) == ["Measure the runs"]
    page.click("#next-do")
    idle(page)
    tip = Track.load(folder / "rfea" / "swing" / "track.nc").dataset["tip"].values
    assert abs(tip[30, 0] - tip[0, 0]) < 1.0, "without a hint it is the other tube, which hangs still"

    before = (folder / "swing" / "experiment.yaml").read_text()
    page.click('[data-tool="clamp"]')
    point(page, places["left"])
    point(page, places["right"])
    page.wait_for_selector("#hints b:text('Clamp')")
    page.click('[data-tool="tip"]')
    point(page, places["tip"])
    page.wait_for_selector("#hints b:text('Tip')")
    text = (folder / "swing" / "experiment.yaml").read_text()
    assert text.startswith(before) and "role: train  # the only one" in text
    hints = load_campaign(folder).experiments[0].camera.hints
    assert hints.clamp[0] == pytest.approx(places["left"], abs=2) and hints.tip == pytest.approx(places["tip"], abs=2)
    assert "Hints have changed" in page.text_content("#next-say") and highlighted(page) == ["Measure again"]

    page.route("**/picture/*", slowly)
    page.click("#try")
    page.wait_for_selector("#tool-say:has-text('first 60 frames')", timeout=300_000)
    idle(page)
    page.click("#refused button:text('show')")
    page.wait_for_selector("#frame-reason:has-text('Refused')")
    page.wait_for_timeout(1500)
    assert "Refused" in page.text_content("#frame-reason"), (
        "what plays by itself took the frame away that was asked for"
    )
    page.unroute("**/picture/*")
    page.click("#measure")
    idle(page)
    track = Track.load(folder / "rfea" / "swing" / "track.nc")
    tip = track.dataset["tip"].values
    assert abs(tip[30, 0] - tip[0, 0]) > 8.0
    page.wait_for_selector(f"#refused :text('{len(HIDDEN)} of 60 frames')")
    page.click("#refused button:text('show')")
    page.wait_for_selector("#frame-reason:has-text('Refused')")
    assert round(float(page.text_content("#frame-clock").split()[0]) * RATE_HZ) in HIDDEN
    page.click("#refused .remedy")
    assert page.locator('#tools [aria-checked="true"]').get_attribute("data-tool") in (
        "clamp",
        "tip",
        "exclude",
        "region",
    )


def test_a_lamp_is_shown_and_brings_the_clocks_together(film, served, visit):
    """The log may be too short for the motion; with the lamp's box drawn, or typed, it need not be asked."""
    folder, _ = film
    open_campaign(folder).track()  # done already, unless this test is run alone
    write_log(folder)
    page = visit(served.address + "#/clock")
    page.click("#lamp-box summary")
    page.wait_for_selector("#log-has:has-text('blink')")
    assert page.locator("#columns option[value=blink]").count() == 1
    page.fill("#channel", "blink")
    left, top, wide, high = LAMP_PX
    point(page, (left, top), (left + wide, top + high), canvas="#lamp-frame")
    drawn = [int(text) for text in page.input_value("#lamp-place").split(",")]
    assert drawn == pytest.approx(LAMP_PX, abs=2) and highlighted(page) == ["Go by this lamp"]
    page.fill("#lamp-place", "12, 16")
    page.click("#by-lamp")
    page.wait_for_selector("#fault:has-text('drag a box around the lamp')")
    page.fill("#lamp-place", ", ".join(map(str, drawn)))
    page.click("#by-lamp")
    page.wait_for_selector("#clock-say:has-text('seen by the lamp')")
    idle(page)
    assert float(page.input_value("#offset")) == pytest.approx(1e3 * OFFSET_S, abs=4) and highlighted(page) == [
        page.text_content("#next-do")
    ]
    sync = load_campaign(folder).experiments[0].sync
    assert (sync.method, sync.channel) == ("led", "blink") and list(sync.lamp_box) == drawn
    assert "# the only one" in (folder / "swing" / "experiment.yaml").read_text()
    assert unfit(page, "setup", "clock") == {}


def test_boxes_are_dragged_and_taken_away(film, served, visit):
    folder, _ = film
    page = visit(served.address + "#/setup")
    page.click('[data-tool="exclude"]')
    point(page, (20, 150), (150, 500))
    page.wait_for_selector("#hints :text('one box')")
    page.check("#for-all")
    page.click('[data-tool="region"]')
    point(page, (160, 60), (340, 560))
    page.wait_for_selector("#hints b:text('Region')")
    hints = load_campaign(folder).experiments[0].camera.hints
    assert hints.exclude[0] == pytest.approx((20, 150, 130, 350), abs=3) and hints.region == pytest.approx(
        (160, 60, 180, 500), abs=3
    )
    assert (
        "region:" in (folder / "campaign.yaml").read_text()
        and "# no board at hand" in (folder / "campaign.yaml").read_text()
    )
    page.click('[aria-label="Take Region away"]')
    page.wait_for_selector("#hints b:text('Region')", state="detached")
    assert load_campaign(folder).experiments[0].camera.hints.region is None


def test_points_of_the_centre_line_are_clicked_and_taken_away(film, served, visit):
    folder, _ = film
    page = visit(served.address + "#/setup")
    page.click('[data-tool="centre_line"]')
    for number in range(5):
        point(page, (250, 100 + 90 * number))
        if number < 4:
            page.wait_for_selector(f"#tool-say:has-text('{number + 1} of 5.')")
    page.wait_for_selector("#hints :text('5 points')")
    line = load_campaign(folder).experiments[0].camera.hints.centre_line
    assert [y for _, y in line] == pytest.approx([100, 190, 280, 370, 460], abs=2)
    page.click('[aria-label="Take Centre line away"]')
    page.wait_for_selector("#hints b:text('Centre line')", state="detached")
    assert load_campaign(folder).experiments[0].camera.hints.centre_line == ()


def test_the_tube_is_pointed_at_again_in_a_later_frame(film, served, visit):
    """In the frame that is shown; in the first one it is told that others are meant. They are one film's, whatever is checked."""
    folder, _ = film
    page = visit(served.address + "#/setup")
    page.click('[data-tool="corrections"]')
    point(page, (250, 100))
    page.wait_for_selector("#tool-say:has-text('Go to a later frame first')")
    page.check("#for-all")
    for frame, left in ((30, 250), (12, 240)):
        page.fill("#frame-slider", str(frame))
        page.click('[data-tool="corrections"]')
        assert page.input_value("#frame-slider") == str(frame)
        for number in range(5):
            point(page, (left, 100 + 90 * number))
            if number < 4:
                page.wait_for_selector(f"#tool-say:has-text('{number + 1} of 5.')")
        page.wait_for_selector("#tool-say:has-text('camera.corrections written')")
    page.wait_for_selector("#hints :text('in frames 12, 30')")
    corrections = load_campaign(folder).experiments[0].camera.hints.corrections
    assert [later.frame for later in corrections] == [12, 30]
    assert corrections[1].points[-1] == pytest.approx((250, 460), abs=2)
    assert "corrections" not in (folder / "campaign.yaml").read_text()
    page.click('[aria-label="Take Point again away"]')
    page.wait_for_selector("#hints b:text('Point again')", state="detached")
    assert load_campaign(folder).experiments[0].camera.hints.corrections == ()


def test_a_box_that_is_drawn_before_the_last_one_is_written_stays_beside_it(film, served, visit):
    folder, _ = film
    page = visit(served.address + "#/setup")
    held = hold(page, "**/hint/*")
    before = len(load_campaign(folder).experiments[0].camera.hints.exclude)
    for left in (20, 60):
        page.click('[data-tool="exclude"]')
        point(page, (left, 150), (left + 30, 500))
    page.click('[data-tool="tip"]')
    for _ in range(2):
        until(page, lambda: held)
        held.pop().continue_()
    until(page, lambda: len(load_campaign(folder).experiments[0].camera.hints.exclude) == before + 2)
    page.unroute("**/hint/*")
    assert page.get_attribute('[data-tool="tip"]', "aria-checked") == "true", "the answer took the tool away"


def test_one_points_with_keys_too(film, served, visit):
    folder, _ = film
    page = visit(served.address + "#/setup")
    page.focus('[data-tool="tip"]')
    page.keyboard.press("Enter")
    page.wait_for_selector("#frame:focus")
    page.wait_for_selector("#frame-clock:has-text('0.000 s')")  # the film is there, and its frame listens
    for key, place in (("ArrowDown", "Column 180, row 325"), ("ArrowRight", "Column 185, row 325")):
        page.keyboard.press(key)
        page.wait_for_selector(f"#tool-say:has-text('{place}')")
    page.keyboard.press("Enter")
    page.wait_for_selector("#tool-say:has-text('written')")
    tip = load_campaign(folder).experiments[0].camera.hints.tip
    assert tip == pytest.approx((180 + 5, 320 + 5), abs=1)


def test_closer_the_pixel_under_the_mouse_stays_there_and_is_the_one_that_is_pointed_at(film, served, visit):
    """In a window of 900 px the picture had been 213 px wide, beside a list, and could not be seen closer."""
    folder, places = film
    page = visit(served.address + "#/setup", width=900)
    page.click('[data-tool="tip"]')
    page.wait_for_selector("#frame-clock:has-text('0.000 s')")
    page.wait_for_selector("#frame[width]")
    whole = at_rest(page, "#frame")
    assert whole["width"] > 300 or whole["height"] > 600
    scale = whole["width"] / page.evaluate(WIDTH)
    x, y = ((places["tip"][axis] + 0.5) * scale + whole[side] for axis, side in enumerate(("x", "y")))
    page.mouse.move(x, y)
    for _ in range(2):
        page.keyboard.press("+")
    closer = at_rest(page, "#frame")
    assert closer["width"] == pytest.approx(4 * whole["width"], rel=0.01)
    assert ((x - closer["x"]) / closer["width"], (y - closer["y"]) / closer["height"]) == pytest.approx(
        ((x - whole["x"]) / whole["width"], (y - whole["y"]) / whole["height"]), abs=0.004
    )
    page.mouse.down()
    page.mouse.up()
    page.wait_for_selector("#tool-say:has-text('written')")
    assert load_campaign(folder).experiments[0].camera.hints.tip == pytest.approx(places["tip"], abs=1)
    page.mouse.move(x - 20, y)
    page.mouse.down()
    page.mouse.move(x + 40, y, steps=4)
    page.mouse.up()
    dragged = at_rest(page, "#frame")
    assert dragged["x"] == pytest.approx(closer["x"] + 60, abs=2)
    page.click('[data-closer="all"]')
    assert at_rest(page, "#frame")["width"] == pytest.approx(whole["width"], rel=0.01)
    assert not unfit(page)
