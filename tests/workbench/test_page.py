"""The page as a person uses it, in a real Chromium."""

from __future__ import annotations

import json
import shutil

import av
import numpy as np
import pytest

from rfea_vision.artefacts import Recording

from .conftest import hold, idle, until

pytestmark = pytest.mark.chromium


@pytest.fixture(scope="module")
def served(serve, fitted, tmp_path_factory):
    folder = shutil.copytree(fitted, tmp_path_factory.mktemp("page") / "tube-A")
    for recording in folder.glob("rfea/*/recording.nc"):
        brightening_film(recording)
    return serve(folder)


def brightening_film(recording) -> None:
    """A film of a run as its track would have left it, the brighter the later."""
    times = Recording.load(recording).dataset["time"].values[::2]
    with av.open(str(recording.with_name("clip.mp4")), "w") as container:
        stream = container.add_stream("libx264", rate=30)
        stream.width, stream.height, stream.pix_fmt = 64, 64, "yuv420p"
        for share in np.linspace(0, 1, times.size):
            picture = np.full((64, 64, 3), round(40 + 180 * share), np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode())
    record = {
        "file": "clip.mp4", "times_s": times.tolist(), "x_min_mm": -160.0, "y_max_mm": 20.0, "px_per_mm": 0.3,
        "width": 64, "height": 64,
    }  # fmt: skip
    recording.with_name("clip.json").write_text(json.dumps(record))


def corner(page) -> int:
    """Brightness of the film in the upper left corner of the stage."""
    data = "document.querySelector('#stage canvas').getContext('2d').getImageData(4, 4, 1, 1).data[0]"
    return int(page.evaluate(data))


def settled(page) -> None:
    """Wait until the last look was taken in the steps of a fit."""
    page.wait_for_selector("html[data-look=exact]")


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
    until(page, lambda: abs(number(page, "#now-validate") - before) < 0.002)


def test_with_nothing_touched_the_fits_own_figures_are_shown_before_any_look(served, visit):
    page = visit(served.address + "#/play")
    held = hold(page, "**/play")
    page.reload()
    settled(page)
    cells = [page.text_content(f"#scores tr:last-child td:nth-child({column})") for column in (2, 3)]
    assert cells[0] == cells[1] == page.text_content("#now-validate")
    for route in held:
        route.continue_()


def test_the_film_stands_at_the_instant_that_is_shown(served, visit):
    page = visit(served.address + "#/play")
    settled(page)
    page.uncheck("#lens")
    last = int(page.get_attribute("#scrub", "max"))
    for frame in (last, 0, last // 2):
        page.fill("#scrub", str(frame))
        until(page, lambda frame=frame: abs(corner(page) - (40 + 180 * frame / last)) < 25)


#: The most points that are stroked at once, and whether dashes have round ends, while all figures are drawn.
STROKES = """import(new URL('../../report/report.js', location)).then(report => new Promise(done => {
  const pen = CanvasRenderingContext2D.prototype, {lineTo, beginPath, stroke} = pen, found = {most: 0, round: false, strokes: 0};
  let points = 0;
  pen.beginPath = function () { points = 0; beginPath.call(this); };
  pen.lineTo = function (x, y) { points++; lineTo.call(this, x, y); };
  pen.stroke = function (...path) {
    found.strokes++; found.most = Math.max(found.most, points);
    if (this.getLineDash().length && this.lineCap === "round") found.round = true;
    stroke.apply(this, path);
  };
  for (const figure of report.Figure.all) if (figure.visible) { figure.stale = true; figure.paint(); }
  Object.assign(pen, {lineTo, beginPath, stroke});
  done(found);
}))"""


def test_curves_are_stroked_in_short_pieces_for_one_long_one_takes_half_of_a_looks_time(served, visit):
    page = visit(served.address + "#/play")
    settled(page)
    page.fill('[data-name="r_hyd"]', "600")  # the earlier line, dashed, stands beside
    page.wait_for_selector("html[data-look=quick]")
    found = page.evaluate(STROKES)
    assert found["strokes"] > 50 and found["most"] <= 8 and not found["round"]


def test_an_effect_of_the_catalogue_gets_sliders(served, visit):
    page = visit(served.address + "#/play")
    settled(page)
    page.click("#more-effects summary")
    page.check('#effects input[value="maxwell"]')
    page.wait_for_selector('[data-name="maxwell.k1"]')
    settled(page)
    before = page.text_content("#now-train")
    page.fill('[data-name="maxwell.k1"]', "400")
    until(page, lambda: page.text_content("#now-train") != before)


def test_nothing_is_said_to_be_missing_before_the_campaign_was_read(served, visit):
    page = visit(served.address + "#/play")
    held = hold(page, "**/state")
    page.reload(wait_until="commit")
    until(page, lambda: held)
    page.wait_for_selector("#next-say:text('Reading the campaign')")
    page.click('.places a[href="#/clock"]')
    page.wait_for_selector('.places a[href="#/clock"][aria-current]')
    assert "No experiment has been tracked yet" not in page.inner_text("main")
    held.pop().continue_()
    page.wait_for_selector("[data-panel=clock] h2", state="visible")


def test_a_rung_that_is_chosen_stays_when_an_earlier_look_comes_late(served, visit):
    page = visit(served.address + "#/play")
    settled(page)
    held = hold(page, "**/play")
    page.fill('[data-name="r_hyd"]', "600")
    until(page, lambda: held)
    page.click('[data-rung="base"]')
    with page.expect_response("**/play"):
        held.pop().continue_()
    page.wait_for_timeout(1000)
    assert page.get_attribute('[data-rung="base"]', "aria-checked") == "true"


def test_a_fit_from_here_is_shown_when_it_is_there_and_undo_leads_back_to_the_sliders(served, visit):
    page = visit(served.address + "#/play")
    settled(page)
    found, place = number(page, "#now-validate"), page.input_value('[data-name="r_hyd"]')
    page.fill('[data-name="r_hyd"]', "700")
    until(page, lambda: number(page, "#now-validate") > found + 0.1)
    page.click("#fit-here")
    idle(page)
    until(page, lambda: abs(number(page, "#now-validate") - found) < 0.002)
    assert float(page.input_value('[data-name="r_hyd"]')) == pytest.approx(float(place), abs=5)
    command = page.text_content("#log").splitlines()[-1]
    assert command.startswith("rfea fit") and command.count("--start") > 3 and "--start 'r_hyd=" in command
    page.click("#undo")
    until(page, lambda: number(page, "#now-validate") > found + 0.1)
    assert page.input_value('[data-name="r_hyd"]') == "700" and page.locator("#undo").is_enabled()
