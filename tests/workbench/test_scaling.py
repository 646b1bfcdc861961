"""A film without a board: its scale is pointed at before anything of its campaign can be read."""

from __future__ import annotations

import re

import pytest

from rfea_vision.campaign import load_campaign
from rfea_vision.errors import InputError
from rfea_vision.workbench.opened import OpenedCampaign
from rfea_vision.workbench.pointing import write_hint
from rfea_vision.workbench.state import state_of

from .everyone import highlighted, unfit
from .filmed import write_film
from .test_pointing import point

POINTS = [[250.0, 100.0], [250.0, 500.0]]
HEAD = "format: rfea-campaign/1\nname: bare  # bench 4\ncamera:\n"
EXAMPLE = "  # scale: {points: [[x, y], [x, y]], distance: 155 mm}  # needed: two points of the first frame\n"


def bare(folder, run=""):
    write_film(folder)
    (folder / "campaign.yaml").write_text(HEAD + EXAMPLE)
    with (folder / "swing" / "experiment.yaml").open("a") as file:
        file.write(run)
    return folder


@pytest.fixture(scope="module")
def unscaled(tmp_path_factory):
    return bare(tmp_path_factory.mktemp("bare") / "bare")


def pointed(folder, points=POINTS, distance="155 mm", *, everywhere=True):
    opened = OpenedCampaign(folder, None)
    value = {"points": points, "distance": distance}
    return write_hint(opened.as_far_as_read(), opened.experiment(0), "scale", value, everywhere=everywhere)


@pytest.mark.parametrize(
    ("points", "distance", "says"),
    [
        (POINTS, "", "is missing; type what lies between"),
        (POINTS, "155", "has no unit; write for example '155 mm'"),
        (POINTS, "0 mm", "lies between no two points; type what you have measured"),
        (POINTS, "-3 cm", "lies between no two points"),
        (POINTS, "long", "write for example '155 mm'"),
        (POINTS, "3 kg", "write one that converts to 'm'"),
        ([POINTS[0], POINTS[0]], "155 mm", "they are 0 px apart; take two that are far apart"),
        ([POINTS[0], [250.0, 5000.0]], "155 mm", "lies outside the picture"),
    ],
)
def test_what_is_no_scale_is_refused_with_its_remedy_and_nothing_is_written(unscaled, points, distance, says):
    before = (unscaled / "campaign.yaml").read_bytes()
    with pytest.raises(InputError, match=re.escape(says)):
        pointed(unscaled, points, distance)
    assert (unscaled / "campaign.yaml").read_bytes() == before


def test_a_scale_stands_in_place_of_its_example_and_keeps_what_stands_beside_it(tmp_path):
    folder = bare(tmp_path / "bare")
    assert pointed(folder) == folder / "campaign.yaml"
    assert (folder / "campaign.yaml").read_text() == HEAD + "  scale: {points: [[250.0, 100.0], [250.0, 500.0]], distance: 155 mm}\n"
    (folder / "campaign.yaml").write_text(
        HEAD + "  scale:\n    points: [[1, 2], [3, 400]]  # a ruler\n    distance: 9 cm\n    error: 1 mm\n"
    )
    pointed(folder, distance="16 cm")
    text = (folder / "campaign.yaml").read_text()
    assert "[250.0, 500.0]]  # a ruler\n    distance: 16 cm\n    error: 1 mm" in text
    load_campaign(folder)


def test_marks_behind_the_tube_say_so_and_may_be_said_to_lie_in_its_plane_again(tmp_path):
    folder = bare(tmp_path / "bare")
    opened = OpenedCampaign(folder, None)

    def keep(behind):
        value = {"points": POINTS, "distance": "155 mm", "behind": behind}
        write_hint(opened.as_far_as_read(), opened.experiment(0), "scale", value, everywhere=True)
        return state_of(folder, None)["experiments"][0]["scale"]["behind"], (folder / "campaign.yaml").read_text()

    with pytest.raises(InputError, match=r"camera\.scale\.behind: 900 mm lead to the camera"):
        keep("900 mm")
    shown, text = keep("1.2 cm")
    assert shown == "12 mm" and "distance: 155 mm, behind: 1.2 cm}" in text
    shown, text = keep("")
    assert shown == "" and "behind" not in text


def test_a_film_with_a_scale_of_its_own_keeps_it_there(tmp_path):
    folder = bare(tmp_path / "bare", "camera: {scale: {points: [[1, 2], [3, 400]], distance: 9 cm}}\n")
    before = (folder / "campaign.yaml").read_text()
    assert state_of(folder, None)["experiments"][0]["scale"]["own"]
    assert pointed(folder) == folder / "swing" / "experiment.yaml"
    assert (folder / "campaign.yaml").read_text() == before
    assert load_campaign(folder).experiments[0].camera.scale.points[1] == (250.0, 500.0)


def test_a_scale_is_taken_away_where_it_stands(tmp_path):
    """It could be changed only; a film without its own one goes by that of all films again."""
    folder = bare(tmp_path / "bare", "camera: {scale: {points: [[1, 2], [3, 400]], distance: 9 cm}, tip: [250, 500]}\n")
    shared = "  scale: {points: [[250, 100], [250, 500]], distance: 155 mm}  # a ruler\n"
    (folder / "campaign.yaml").write_text(HEAD + "  vertical: image\n" + shared)

    def taken() -> object:
        opened = OpenedCampaign(folder, None)
        return write_hint(opened.as_far_as_read(), opened.experiment(0), "scale", None, everywhere=False)

    assert taken() == folder / "swing" / "experiment.yaml"
    camera = load_campaign(folder).experiments[0].camera
    assert camera.scale.distance == pytest.approx(0.155) and camera.hints.tip == (250.0, 500.0)
    assert taken() == folder / "campaign.yaml" and (folder / "campaign.yaml").read_text() == HEAD + "  vertical: image\n"
    state = state_of(folder, None)
    assert state["experiments"][0]["pointable"] == ("scale",) and "has no scale yet" in state["next"]["say"]
    with pytest.raises(InputError, match=r"camera\.scale: is not there, and cannot be taken away"):
        taken()


def test_beside_a_board_no_scale_is_written(tmp_path):
    folder = bare(tmp_path / "bare")
    (folder / "campaign.yaml").write_text(HEAD + "  photos: calibration/board_*.png\n")
    with pytest.raises(InputError, match=r"camera\.photos tells the scale already; to point at it, take that line out"):
        pointed(folder)


@pytest.mark.chromium
def test_a_film_without_a_board_is_shown_and_its_scale_pointed_at(unscaled, serve, visit):
    page = visit(serve(unscaled).address, width=500)
    assert "has no scale yet" in page.text_content("#next-say") and highlighted(page) == ["Point at them"]
    assert page.locator("#no-films").is_hidden() and page.locator("#measure").is_disabled()
    assert page.locator("#tools button").all_text_contents() == ["Look", "Scale"]
    page.click("#next-do")
    page.wait_for_selector("#frame-clock:has-text('0.000 s')")
    page.wait_for_selector('[data-tool="scale"][aria-checked=true]')
    for place in POINTS:
        point(page, place)
    page.wait_for_selector("#scale-distance:focus")
    page.keyboard.type("155")
    assert highlighted(page) == ["Keep this scale"]
    page.click("#keep-scale")
    page.wait_for_selector("#fault:has-text('has no unit')")
    page.fill("#scale-distance", "155 mm")
    page.keyboard.press("Enter")
    page.wait_for_selector("#hints :text('155 mm over')")
    page.wait_for_selector("#tool-say:has-text('camera.scale written')")
    assert "have not been measured" in page.text_content("#next-say") and page.locator("#fault").is_hidden()
    assert page.locator('[data-tool="clamp"]').is_visible() and page.locator("#measure").is_enabled()
    scale = load_campaign(unscaled).experiments[0].camera.scale
    assert scale.distance == pytest.approx(0.155) and [y for _, y in scale.points] == pytest.approx([100, 500], abs=2)
    page.click("#hints button:text('change')")  # the points stay, another distance is typed
    assert page.input_value("#scale-distance") == "155 mm"
    page.fill("#scale-distance", "16 cm")
    page.click("#keep-scale")
    page.wait_for_selector("#hints :text('160 mm over')")
    assert load_campaign(unscaled).experiments[0].camera.scale.points == scale.points
    assert unfit(page, "setup") == {}
    page.click('[aria-label="Take Scale away"]')
    page.wait_for_selector("#next-say:has-text('has no scale yet')")
    page.wait_for_selector("#tool-say:has-text('camera.scale taken away')")
    assert "scale" not in (unscaled / "campaign.yaml").read_text() and page.locator("#measure").is_disabled()
    assert page.locator("#hints button").count() == 0 and highlighted(page) == ["Point at them"]
