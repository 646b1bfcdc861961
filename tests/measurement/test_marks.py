"""Coloured marks as points of the material."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from rfea_vision.artefacts import Track
from rfea_vision.vision.body.begin import first_body
from rfea_vision.vision.body.fit import UNKNOWNS, Evidence, fit_body
from rfea_vision.vision.body.marks import Mark, SeenMark, along_line, find_marks, marks_in, place_of, row_apart
from rfea_vision.vision.body.model import STATIONS, lab_of
from rfea_vision.vision.body.wall import Wall
from testing.phone import Arm, Room, film
from tests.cli.console import rfea
from tests.measurement.test_gone import HALF, drawn, follower_of, middle_of

RED, GREEN, GREY = (200, 40, 40), (40, 150, 60), (130, 145, 165)


def picture(aside: float = 0.0, *, covered: bool = False) -> np.ndarray:
    """CIELAB (200, 120, 3) of a hanging arm 20 px wide with a red and a green mark, and a red pin on the wall beside it."""
    rgb = np.full((200, 120, 3), 225, dtype=np.uint8)
    left = round(50 + aside)
    rgb[20:180, left : left + 20] = GREY
    cv2.circle(rgb, (95, 150), 4, RED, -1)
    if not covered:
        cv2.circle(rgb, (left + 13, 150), 4, RED, -1)
    cv2.circle(rgb, (left + 10, 90), 4, GREEN, -1)
    return np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2LAB))


def arm(aside: float = 0.0):
    points = np.column_stack([np.full(STATIONS, 59.5 + aside), np.linspace(20.0, 180.0, STATIONS)])
    return first_body(picture(aside), points, 10.0)


def test_marks_are_found_where_they_are_and_named_ones_alone():
    body = arm()
    marks = find_marks(picture(), body, None)
    places = sorted((place_of(mark, body).round(1).tolist() for mark in marks), key=lambda place: place[1])
    assert places == [[60.0, 90.0], [63.0, 150.0]]
    (red,) = find_marks(picture(), body, lab_of(RED))
    assert red.share == pytest.approx(130 / 160, abs=0.01)


@pytest.mark.parametrize(("marks", "unseen"), [("red", False), ("'#00ff00'", True)])
def test_a_colour_that_no_mark_has_is_told_when_the_film_is_tracked(tmp_path, marks, unseen):
    """A green that nobody had painted was taken in silence, and no mark was followed."""
    arm = Arm(opacity=0.7, glare=0.3, marks=3, tape_end=5.0, swell=0.25)
    room = Room(size=(240, 260), px_per_mm=2.2, clamp=(120.0, 40.0), ruled=6.0, clutter=3, seed=4)
    (tmp_path / "swing").mkdir()
    truth = film(tmp_path / "swing" / "film.mp4", arm, room, -np.linspace(0.05, 0.4, 6))
    one, other, tip = (np.round(place, 1).tolist() for place in (*truth.clamp_px, truth.tip_px))
    (tmp_path / "campaign.yaml").write_text(
        "format: rfea-campaign/1\nname: marked\n"
        f"actuator: {{outer_radius: {arm.half_width} mm, inner_radius: 1 mm, length: {arm.length} mm}}\n"
        f"camera: {{vertical: image, scale: {{points: [[10, 10], [120, 10]], distance: 50 mm}}, clamp: [{one}, {other}], tip: {tip}, "
        f"marks: {marks}}}\n"
    )
    (tmp_path / "swing" / "experiment.yaml").write_text("format: rfea-experiment/1\nname: swing\nvideo: {file: film.mp4}\n")
    answer = rfea("track", tmp_path)
    assert answer.code == 0, answer.err
    warned = "warning: swing: camera.marks: nothing on the tube is of the colour '#00ff00' in the first frame"
    assert (warned in answer.err) == ("camera.marks" in answer.err) == unseen
    assert ("camera.marks" in Track.load(tmp_path / "rfea" / "swing" / "track.nc").dataset.attrs["doubts"]) == unseen


def test_grain_and_patterns_are_no_marks():
    """Dithered GIFs, enlarged: hundreds of patches made a fit take half a second. And a mark in two pieces was two marks.

    Grain is less than a quarter of a wide body's half width in radius, and of a narrow one fewer pixels than a film shows colour by.
    """
    rgb = cv2.cvtColor(picture(), cv2.COLOR_LAB2RGB)
    points = arm().points
    for seed in range(5):
        rgb[25 + 12 * seed : 28 + 12 * seed, 56:59] = RED  # grain: nine pixels of the film
    rgb[60:63, 64:72] = rgb[68:71, 64:72] = rgb[60:71, 70:72] = RED  # a hook, open to the body, whose bow hangs over the edge
    large = cv2.resize(np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2LAB)), None, fx=3, fy=3, interpolation=cv2.INTER_NEAREST)
    body = first_body(large, 3 * points + 1, 30.0)
    assert len(find_marks(large, body, None)) == 3
    narrow = first_body(large, 3 * points + 1, 12.0)
    assert len(find_marks(large, narrow, None)) - len(find_marks(large, narrow, None, 3.0)) == 5
    grain = np.random.default_rng(3).random(rgb.shape[:2]) < 0.1
    rgb[grain] = RED
    large = cv2.resize(np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2LAB)), None, fx=3, fy=3, interpolation=cv2.INTER_NEAREST)
    assert len(find_marks(large, first_body(large, 3 * points + 1, 30.0), None)) == 3  # what are marks, and none of the grain


def test_a_streak_along_the_body_is_no_mark():
    """Glare in the wall's light: the middle of what a window cut out of it lay wherever it was expected, and the line slipped."""
    lab = picture()
    lab[24:176, 52:55] = lab[30, 60] + np.array([40, 20, 5], dtype=np.uint8)
    assert len(find_marks(lab, arm(), None)) == 2  # the red and the green one


def test_patches_within_the_scatter_of_a_body_s_own_hue_are_no_marks():
    """Shaded windings: patches of a hue that half the body nearly has came and went beside their places, and held the line."""
    lab, body = picture().astype(float), arm()
    lab[20:180, 50:70, 1:] += np.random.default_rng(1).normal(0.0, 6.0, (160, 20, 2))
    lab[40:48, 56:64, 2] += 35.0
    lab = np.clip(np.round(lab), 0, 255).astype(np.uint8)
    pale = lab_of(GREY) + np.array([0, 0, 35])
    places = [place_of(mark, body)[1] for mark in find_marks(lab, body, None)]
    assert sorted(round(place, -1) for place in places) == [90, 150]  # the red and the green one
    assert any(abs(place_of(mark, body)[1] - 44.0) < 1.5 for mark in find_marks(lab, body, pale))  # its colour was named


@pytest.mark.parametrize("aside", [-12.0, 9.0])
def test_marks_are_followed_and_pins_are_not(aside):
    """The arm moves aside, foretold where it was; a pin of the mark's colour hangs on the wall that is known."""
    body, wall = arm(), Wall(picture().shape)
    marks = find_marks(picture(), body, None)
    wall.learn(picture(), body)
    wall.times[:] = 9
    found = marks_in(picture(aside), marks, body, body, wall)
    moved = {round(seen.place[1]): seen.place[0] - place_of(seen.mark, body)[0] for seen in found}
    assert moved == {90: pytest.approx(aside, abs=0.3), 150: pytest.approx(aside, abs=0.3)}
    (left,) = marks_in(picture(aside, covered=True), marks, body, body, wall)
    assert round(left.place[1]) == 90


@pytest.mark.parametrize(("marked", "aside"), [(True, 0.0), (False, 2.0)])
def test_rubber_that_swells_to_one_side_leaves_its_material_where_the_marks_are(marked, aside):
    """The right edge moves out by 4 px, and the marks stay: so does the line, which without marks lies between the edges."""
    body, wall = arm(), Wall(picture().shape)
    marks = find_marks(picture(), body, None) if marked else []
    swollen = picture()
    grey = swollen[30, 60].copy()
    swollen[24:180, 70:74] = grey
    clamp = np.array([body.points[0], [0.0, 1.0]])
    covariance = np.eye(UNKNOWNS) * 1e2
    for _ in range(3):
        seen = marks_in(swollen, marks, body, body, wall)
        evidence = Evidence(swollen, wall, clamp, np.full(STATIONS, 10.0), None, marks=seen)
        body = fit_body(evidence, body, covariance, 8.0).body
    assert np.median(body.points[20:60, 0]) - 59.5 == pytest.approx(aside, abs=1.0)
    assert np.median(body.half[20:60]) == pytest.approx(12.0, abs=0.7)


def test_marks_outweigh_what_was_carried():
    """On silicone glare stays where the light comes from: flow and skin claimed half a pixel, and marks had gone 3 px."""
    body, wall = arm(), Wall(picture().shape)
    marks = find_marks(picture(), body, None)
    seen = picture(3.0)
    found = marks_in(seen, marks, body, body, wall)
    clamp = np.array([body.points[0] + np.array([3.0, 0.0]), [0.0, 1.0]])
    evidence = Evidence(seen, wall, clamp, np.full(STATIONS, 10.0), None, marks=found)
    body = fit_body(evidence, body, 0.5**2 * np.eye(UNKNOWNS), 8.0).body
    assert [place_of(mark.mark, body)[0] for mark in found] == [pytest.approx(mark.place[0], abs=1.0) for mark in found]


@pytest.mark.parametrize(("top", "bottom"), [(60, 138), (30, 140)])
def test_a_chamber_that_swells_to_one_side_does_not_turn_the_marked_end(top, bottom):
    """It swells by 6 px between clamp and mark. Leaning that changed slowly along the body turned the end by a pixel the other way."""

    def swollen(px: int) -> np.ndarray:
        lab = picture()
        lab[156:182, 45:85] = lab[5, 5]  # the arm ends behind the mark
        lab[top:bottom, 70 : 70 + px] = lab[30, 60]
        return lab

    body = first_body(swollen(0), np.column_stack([np.full(STATIONS, 59.5), np.linspace(20.0, 156.0, STATIONS)]), 10.0)
    wall, covariance = Wall(swollen(0).shape), np.eye(UNKNOWNS)
    marks = find_marks(swollen(0), body, lab_of(RED))
    for px in np.minimum(np.arange(1, 17), 6):
        seen = swollen(int(px))
        clamp = np.array([[59.5, 20.0], [0.0, 1.0]])
        evidence = Evidence(seen, wall, clamp, np.full(STATIONS, 10.0), None, marks=marks_in(seen, marks, body, body, wall))
        fit = fit_body(evidence, body, covariance, 8.0)
        body, covariance = fit.body, fit.covariance + 0.05 * np.eye(UNKNOWNS)
    assert body.points[32, 0] == pytest.approx(62.5, abs=0.5), "the middle of the edges"
    assert body.points[-1, 0] == pytest.approx(59.5, abs=0.5)


def test_beyond_a_mark_near_its_end_a_body_goes_straight_on():
    """Tape that peels off to one side turned the line of four real arms there, by up to a quarter of a half width."""

    def taped(px: int) -> np.ndarray:
        lab = picture()
        lab[164:182, 45:85] = lab[5, 5]  # the arm ends 1.4 half widths behind the mark
        for row in range(152, 164):
            aside = px * (row - 151) // 14
            lab[row, 50 : 50 + aside], lab[row, 70 : 70 + aside] = lab[5, 5], lab[30, 60]
        return lab

    body = first_body(taped(0), np.column_stack([np.full(STATIONS, 59.5), np.linspace(20.0, 164.0, STATIONS)]), 10.0)
    wall, covariance = Wall(taped(0).shape), np.eye(UNKNOWNS)
    marks = find_marks(taped(0), body, lab_of(RED))
    for px in (2, 4, 6, 8, 8, 8, 8, 8):
        evidence = Evidence(
            taped(px), wall, np.array([[59.5, 20.0], [0.0, 1.0]]), np.full(STATIONS, 10.0), None,
            marks=marks_in(taped(px), marks, body, body, wall),
        )  # fmt: skip
        fit = fit_body(evidence, body, covariance, 8.0)
        body, covariance = fit.body, fit.covariance + 0.05 * np.eye(UNKNOWNS)
    assert body.points[-1, 0] == pytest.approx(59.5, abs=0.5)


def test_a_mark_whose_middle_is_pointed_at_as_the_tip_is_a_mark():
    """The click is beside that middle, so that the mark may lie beyond the line's end; it holds the end, and tells of no stretch."""
    for end in (148.0, 151.5):
        points = np.column_stack([np.full(STATIONS, 59.5), np.linspace(20.0, end, STATIONS)])
        body, wall = first_body(picture(), points, 10.0), Wall(picture().shape)
        marks = find_marks(picture(), body, lab_of(RED))
        assert [mark.share for mark in marks] == [pytest.approx(130 / (end - 20), abs=0.01)]
        found = marks_in(picture(6.0), marks, body, body, wall)
        assert [seen.place[0] for seen in found] == [pytest.approx(69.0, abs=0.3)]
        lines = along_line(found, body, body.points, 1.0)
        assert len(lines) == (end > 150.0)
        clamp = np.array([body.points[0] + np.array([6.0, 0.0]), [0.0, 1.0]])
        evidence = Evidence(picture(6.0), wall, clamp, body.half, None, marks=found)
        assert fit_body(evidence, body, np.eye(UNKNOWNS) * 1e2, 8.0).body.points[-1, 0] == pytest.approx(65.5, abs=1.0)


def test_what_an_arm_touches_with_its_end_is_no_mark():
    """A plate before the end of a finger, beside its line, was one, and the finger lagged behind its edges."""
    lab = picture()
    lab[150:170, 66:100] = lab[150, 95]  # of the pin's colour; a corner of it lies on the finger's end
    body = first_body(lab, np.column_stack([np.full(STATIONS, 59.5), np.linspace(20.0, 156.0, STATIONS)]), 13.0)
    assert [mark.share for mark in find_marks(lab, body, lab_of(RED))] == []


def test_what_lies_beside_the_body_is_no_mark():
    """A piece of the wall within the outline went on outside of it, and had held the material: its middle lies beside the body."""
    rgb = cv2.cvtColor(picture(), cv2.COLOR_LAB2RGB)
    rgb[60:74, 69:78] = RED  # behind the arm, whose right edge is at 70: a column of it lies within the outline
    marked = np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2LAB))
    assert len(find_marks(marked, arm(), None)) == len(find_marks(picture(), arm(), None))


def test_a_cap_as_wide_as_the_body_holds_it_along_itself_alone():
    """Its lit side is paler than it is, so that the middle of its colour goes to the other one: the line had gone with that."""

    def capped(lit: int) -> np.ndarray:
        lab = picture()
        lab[140:180, 50:70], lab[140:180, 70 - lit : 70] = lab_of(GREEN), lab_of((145, 160, 160))
        return lab

    body, wall = arm(), Wall(picture().shape)
    marks = [mark for mark in find_marks(capped(0), body, None) if mark.share > 0.7]
    assert [mark.wide for mark in marks] == [True] and not any(mark.wide for mark in find_marks(picture(), body, None))
    found = marks_in(capped(6), marks, body, body, wall)
    assert found[0].place[0] < 57.5
    evidence = Evidence(capped(6), wall, np.array([body.points[0], [0.0, 1.0]]), np.full(STATIONS, 10.0), None, marks=found)
    fit = fit_body(evidence, body, 1e2 * np.eye(UNKNOWNS), 8.0)
    assert np.abs(fit.body.points[50:, 0] - 59.5).max() < 0.5
    assert fit.body.points[-1, 1] == pytest.approx(180.0, abs=1.0)


@pytest.mark.parametrize(
    ("colours", "apart"), [((RED,) * 4, 0.2), ((RED, RED), 0.0), ((RED, GREEN, RED, GREEN), 0.0), ((GREEN, RED, RED, RED), 0.2)]
)
def test_marks_of_a_row_may_be_taken_for_the_next_one_and_those_of_other_colours_not(colours, apart):
    marks = [Mark(0.2 * k, 0.0, lab_of(colour)[1:], lab_of(GREY)[1:], 50.0, False, False) for k, colour in enumerate(colours)]
    assert row_apart([SeenMark(mark, np.zeros(2), 1.0) for mark in marks]) == pytest.approx(apart)


@pytest.mark.parametrize("told", [True, False])
def test_a_row_of_marks_whose_skin_is_elsewhere_may_have_slipped_by_one(told):
    """A spine with nine ribs, six of which are marks: taken for the next ones, they had its end off by one or two, and sure of it."""
    follower = follower_of(middle_of(0.0, 110.0))
    assert follower.next(drawn(middle_of(0.0, 110.0), np.full(65, HALF)), 0.0) == ""
    marks = [Mark(share, 0.0, lab_of(RED)[1:], lab_of(GREY)[1:], 50.0, False, False) for share in (0.5, 0.7, 0.9)]
    material = [SeenMark(mark, np.zeros(2), 1.0) for mark in marks]
    fit = replace(follower.first.fit, material=material, length_told=told, end=np.full(7, np.nan))
    doubt = follower._slipped(fit, np.empty(0), level=False) ** 0.5
    assert (doubt > 0.19 * fit.body.length) == (not told)
