"""The seven points on a campaign whose tube is only found where one points, as a person walks them from films to a law."""

from __future__ import annotations

import pytest

from rfea_vision.artefacts import Track
from rfea_vision.campaign import load_campaign
from rfea_vision.workbench.trying import FirstFrames

from .cabled import OFFSET_S, RUNS, write_campaign
from .conftest import idle, until
from .test_pointing import point

pytestmark = pytest.mark.chromium


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    folder = tmp_path_factory.mktemp("hinted") / "cables"
    return folder, write_campaign(folder)


def test_a_trial_sees_the_colours_that_the_track_sees(campaign):
    from rfea_vision.readers.video import open_video

    whole = open_video(campaign[0] / "steps" / "film.mp4")
    piece = FirstFrames(whole.path, whole.size, 3, whole.rate_Hz, whole=whole, count=3)
    pictures = [picture for _, picture in piece.colours(0.5)]
    assert len(pictures) == 3 and (pictures[0][..., 0] != pictures[0][..., 2]).any()


@pytest.mark.study
def test_from_films_in_which_no_tube_is_found_to_a_law(campaign, serve, visit):
    folder, truth = campaign
    page = visit(serve(folder).address)
    do = page.locator("#next-do")

    # 1: nothing is found; the page says where to point, film by film, and what was pointed at is tried
    do.click()
    page.wait_for_selector("#fault:has-text('also failed')")
    page.wait_for_selector("html:not([data-busy])")
    for name in sorted(RUNS):
        for tool, places in (("clamp", truth.clamp_px), ("tip", [truth.tip_px])):
            page.wait_for_selector(f"#next-say:has-text('No tube was found in {name}')")
            page.keyboard.press("n")
            page.wait_for_selector(f'#films [data-film="{name}"][aria-selected=true]')
            page.wait_for_selector(f'[data-tool="{tool}"][aria-checked=true]')
            for place in places:
                point(page, place)
            page.wait_for_selector(f"#hints b:text-is('{tool.capitalize()}')")
    page.click("#try")
    page.wait_for_selector("#tool-say:has-text('of the first 80 frames were tracked')")
    idle(page)
    assert int(page.text_content("#tool-say").split()[0]) > 60
    assert all(item.camera.hints.tip and item.camera.hints.clamp for item in load_campaign(folder).experiments)

    # 2: measured and on one clock, which is dragged and found again
    do.click()
    idle(page)
    page.wait_for_selector("#next-do:not(:text('Measure'))")
    assert all(Track.load(folder / "rfea" / name / "track.nc").valid.mean() > 0.8 for name in RUNS)
    page.click('.places a[href="#/clock"]')
    page.wait_for_selector("#clock-say:has-text('found from the motion')")
    assert float(page.input_value("#offset")) == pytest.approx(1e3 * OFFSET_S, abs=15)
    page.fill("#offset", f"{1e3 * OFFSET_S:.1f}")
    page.click("#keep-offset")
    page.wait_for_selector("#clock-say:has-text('given by hand')")
    idle(page)

    # 3: fitted, doubts or not, and played over the film
    other = page.locator("#next-otherwise")
    (other if other.is_visible() else do).click()
    page.wait_for_selector('[data-rung="base"]')
    idle(page)
    page.click('.places a[href="#/play"]')
    page.wait_for_selector("html[data-look=exact]")
    before = page.text_content("#now-validate")
    page.locator('[data-name="r_hyd"]').focus()
    page.keyboard.press("Shift+ArrowRight")
    for _ in range(20):
        page.keyboard.press("ArrowRight")
    until(page, lambda: page.text_content("#now-validate") != before)
    page.keyboard.press("Control+z")
    until(page, lambda: page.text_content("#now-validate") == before)

    # 4: what is missing is asked, added, and the error falls
    do.click()
    page.wait_for_selector("#next-do:has-text('and watch')")
    idle(page)
    do.click()
    page.wait_for_selector('[data-rung^="base+"][aria-checked="true"]')
    idle(page)
    errors = [float(text.split()[-2]) for text in page.locator("#rungs .error").all_text_contents()]
    assert errors[1] < errors[0]

    # 5 and 6: a law of one's own, and where the campaign stands among others
    page.click('.places a[href="#/law"]')
    page.wait_for_selector("#law-said:has-text('Units fit')")
    page.click('.places a[href="#/batch"]')
    page.wait_for_selector("#batch tr.on :text('2 of 2 runs')")
    for command in ("rfea sync", "rfea fit", "rfea diagnose"):
        assert command in page.text_content("#log")
