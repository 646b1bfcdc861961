"""The length check: what the photos of the board cannot show, the tube's own length does."""

import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from rfea_vision.artefacts import Actuator, Hints
from rfea_vision.calibration.board import Board
from rfea_vision.calibration.calibrate import calibrate
from rfea_vision.calibration.scale import scaled_by_distance
from rfea_vision.stages.warnings import is_doubt
from rfea_vision.vision import advice, track_frames, trials
from rfea_vision.vision.derive.shape import _length_check
from rfea_vision.vision.find.begin import OTHER_LENGTH, Scene
from rfea_vision.vision.scene import make_scene
from rfea_vision.vision.trials import Trials
from testing.scenes import Look, bending, film
from testing.sources import memory_source

UNHINTED = Scene(np.zeros(0), Actuator(), np.array([0.0, -1.0]), 1.0)
NO_FILM: Any = SimpleNamespace(times_s=lambda: np.zeros(0))


@pytest.fixture(scope="module")
def checked(calibrated, small_lens):
    """What the length check says of a film, by the side of a square that was written to the campaign."""
    photos, plane, _, _ = calibrated
    pictures, times, _ = film(small_lens, Look(), bending(np.arange(24) / 60))
    source = memory_source(pictures, times)

    def said_for(square_m):
        board = Board("checkerboard", (9, 6), square_m)
        calibration = calibrate(photos, plane, board, lens="brown5")
        return track_frames(source, calibration, Actuator()).dataset

    return said_for


def test_the_right_square_gives_the_tubes_length(checked):
    data = checked(0.012)
    assert data.attrs["hinge_length_mm"] == pytest.approx(155.0, rel=0.006)
    assert data.attrs["length_check"].startswith("the inextensible side keeps its length within 0.")
    assert "square" not in data.attrs["length_check"]


@pytest.mark.parametrize(("square_m", "off"), [(0.013, "+8."), (0.0114, "-5.")])
def test_a_wrong_square_shows_as_a_wrong_length(checked, square_m, off):
    data = checked(square_m)
    assert data["valid"].values.mean() > 0.9
    assert data.attrs["hinge_length_mm"] == pytest.approx(155.0 * square_m / 0.012, rel=0.006)
    said = data.attrs["length_check"]
    assert f"it measures {off}" in said
    checks = said.partition("% against actuator.length: check ")[2]
    assert checks.startswith("the board's square (or camera.scale), the length, and by 'rfea track --preview' that the line ends at")


@pytest.mark.parametrize(("of_body", "doubted"), [(True, False), (False, True)])
def test_a_body_that_stretches_is_compared_as_it_is_at_rest(of_body, doubted):
    """Of one that grows by 14 % the median was said to be 5 % too long, and the scale to be wrong."""
    bend = np.linspace(0.0, 60.0, 40) ** 2 / 60.0
    hinge, scene = 80.0 * (1.0 + 0.14 * bend / 60.0), pointed_at(((108.0, 30.0), (132.0, 30.0)), (120.0, 200.0))
    said = _length_check(hinge, bend, scene, of_body=of_body)["length_check"]
    assert "changes by +13" in said and ("against actuator.length" in said) == doubted


@pytest.mark.parametrize(("kept_mm", "told"), [(12.0, True), (5.0, False)])
def test_a_finger_that_bends_about_its_inner_side_is_told_which_key_says_so(kept_mm, told):
    """A flat finger of 24 mm: its middle grows by 12 mm for each rad. It had been called one that stretches, and was fitted as such."""
    bend = np.linspace(0.0, 150.0, 40)
    scene = pointed_at(((108.0, 30.0), (132.0, 30.0)), (120.0, 200.0))
    half_mm = scene.half_mm
    flat = replace(scene, actuator=replace(scene.actuator, kind="rectangle", width=0.02))
    said = _length_check(flat.length_mm + kept_mm / 12.0 * half_mm * np.radians(bend), bend, flat, of_body=True)["length_check"]
    assert ("'keeps: side' in actuator.section" in said) == told and is_doubt("length_check", said) == told


SAID = "the inextensible side keeps its length within 0.1 % over all postures; it measures +20.0 % against actuator.length: check"


@pytest.mark.parametrize(
    ("reasons", "length_check", "says"),
    [
        (["width_off"] * 4, SAID, "the inextensible side measures +20.0 %"),  # a board of 10 mm declared as 12
        (["length_off"] * 4, SAID, "the inextensible side measures +20.0 %"),
        (["width_off"] * 4, SAID.partition(";")[0], "give camera.clamp and camera.tip"),
        ([OTHER_LENGTH] * 4, SAID.partition(";")[0], "check the board's square (or camera.scale)"),  # of 9 mm as 12
    ],
)
def test_a_scale_that_is_far_off_is_advised_on_before_a_hint(reasons, length_check, says, monkeypatch):
    """Clamp and tip had been asked for, which cannot mend a board's square."""
    monkeypatch.setattr(trials, "_suggested", lambda _: iter(()))
    said = advice.next_hint(Trials(NO_FILM, UNHINTED, len(reasons)), reasons, scale_off=advice.scale_doubt(length_check))
    assert said.startswith(says)


def test_hints_that_make_up_for_a_wrong_scale_do_not_come_before_it(monkeypatch):
    """Clamp and tip, found in the picture, read half of the frames of a film whose board is of another size."""
    monkeypatch.setattr(trials, "_suggested", lambda _: iter([(Hints(), "camera.tip: [3, 4]")]))
    monkeypatch.setattr(Trials, "of", lambda self, hints: trials.Trial(2, 3.0))
    said = advice.next_hint(Trials(NO_FILM, UNHINTED, 5), ["no_tube", *[OTHER_LENGTH] * 4])
    assert said.startswith("check the board's square (or camera.scale)") and "give it: camera.tip: [3, 4] (tried, it reads 2" in said
    said = advice.next_hint(Trials(NO_FILM, UNHINTED, 4), ["width_off"] * 4, scale_off="it measures +20 %")
    assert said.startswith("it measures +20 %; where these are right, check this against the picture and give it: camera.tip: [3, 4]")


def test_a_film_that_is_lost_on_the_way_is_not_asked_for_hints_that_were_right(monkeypatch):
    """It says up to where it was read; whether that is so, the frames told."""
    monkeypatch.setattr(trials, "_suggested", lambda _: iter(()))
    monkeypatch.setattr(advice, "base_moved", lambda *_: "")
    monkeypatch.setattr(advice, "film_lacks", lambda _: "")
    given = Hints(clamp=((0.0, 0.0), (0.0, 0.0)), tip=(0.0, 0.0), centre_line=((1.0, 2.0), (3.0, 4.0)))
    film = Trials(NO_FILM, replace(UNHINTED, hints=given), 25)
    lost = ["no_fit: folded"] * 20
    said = advice.next_hint(film, [""] * 18 + ["edge_lost"] + [""] * 2 + lost)
    assert said.startswith("the hints fit the first 21 frames, of which 20 were read: cut the film to these")
    again = "and point at the tube again where it is seen, from the clamp to the tip: "
    again += "camera.corrections: [{frame: 21, points: [[x, y], ...]}]"
    assert said.endswith(f"frame 21 (no_fit: folded) {again}")
    assert advice.next_hint(film, [""] * 18 + lost, scale_off="the scale").startswith("the hints fit the first ")
    assert advice.next_hint(film, [""] * 5 + lost, scale_off="the scale") == "the scale"
    said = advice.next_hint(film, [""] * 5 + lost)
    forbidden = ["off_hints: 20 % of it lies where camera.region or camera.exclude forbid it"] * 3 + lost
    assert advice.next_hint(film, [""] * 5 + forbidden).endswith("make the region larger, or the boxes smaller")
    assert said.startswith("see what changes in frame 5, the first that was refused (no_fit: folded), and point at the tube again")
    assert said.endswith("[{frame: 5, points: [[x, y], ...]}]")
    assert advice.next_hint(film, lost).startswith("check the hints")


@pytest.mark.parametrize(
    ("base_px", "wall_px", "from_frame", "cut"),
    [(0.0, 0.0, 0, ""), (16.0, 0.0, 0, "where both rest"), (16.0, 0.0, 18, r"its first 2\d frames"), (8.0, 8.0, 0, "")],
)
def test_a_base_that_moves_is_said_and_a_camera_that_drifts_is_not(base_px, wall_px, from_frame, cut):
    """No hint mends a clamp that leaves its place; a drift of the whole view is followed. The arm below swings in all three."""
    wall = cv2.GaussianBlur(np.random.default_rng(1).uniform(0, 255, (260, 240, 3)), (0, 0), 2.0)
    wall = np.clip(4 * (wall - 128) + 128, 0, 255).astype(np.uint8)
    wall[:, 60:180] = 120

    def colours(scale):
        for k in range(30):
            moved = np.array([[1.0, 0, wall_px * k / 29], [0, 1, 0]])
            picture = cv2.warpAffine(wall, moved, (240, 260), borderMode=cv2.BORDER_REFLECT)
            aside = round(base_px * max(k - from_frame, 0) / (29 - from_frame))
            cv2.rectangle(picture, (100 + aside, 20), (140 + aside, 40), (40, 40, 200), -1)
            cv2.line(picture, (120 + aside, 40), (120 + aside + k, 200), (220, 225, 215), 24, cv2.LINE_AA)
            yield k / 30, picture

    scene = make_scene(
        scaled_by_distance((240, 260), [[0, 0], [100, 0]], 50.0),
        Actuator(outer_radius=0.006, inner_radius=0.003, length=0.08),
        "image",
        Hints(clamp=((108.0, 40.0), (132.0, 40.0)), tip=(120.0, 200.0)),
        (240, 260),
    )
    source: Any = SimpleNamespace(size=(240, 260), colours=colours)
    said = advice.base_moved(source, scene, 30 * ["no_fit"])
    assert bool(re.fullmatch(f"what holds the tube has moved in the picture, by .* or cut the film to {cut}" if cut else "", said))
    farther = advice.base_moved(source, scene, 30 * ["no_fit"], 28)  # of a larva it was 45 frames for 189
    assert bool(farther) == bool(cut)
    assert ("its first 28 frames, in which it is followed as it moves, or point at the tube again" in farther) == bool(cut)


def pointed_at(clamp: Any, tip: tuple[float, float]) -> Any:
    """A scene in which clamp and tip were pointed at, 2 px per mm."""
    scale = scaled_by_distance((240, 260), [[0, 0], [100, 0]], 50.0)
    actuator = Actuator(outer_radius=0.006, inner_radius=0.003, length=0.08)
    return make_scene(scale, actuator, "image", Hints(clamp=clamp, tip=tip), (240, 260))


@pytest.mark.parametrize(
    ("half", "tip", "wall", "said"),
    [
        (12.0, 60.0, 60, r"what was pointed at is 1\.2 times as long as wide, .* from 1\.5 times on"),
        (1.5, 200.0, 60, r"the tube is 3\.0 px wide in the film, .* 3\.3 times as many"),
        (12.0, 200.0, 204, r"right of it the tube's colour differs .* by 0\.\d times"),
        (12.0, 200.0, 60, ""),
    ],
)
def test_where_no_hint_helps_it_is_said_what_the_film_lacks(half, tip, wall, said):
    """A body as long as wide, one of 3 px, and one that to one side has a wall of its own colour."""
    picture = np.full((260, 240, 3), 60, np.uint8)
    picture[:, 120:] = wall
    cv2.rectangle(picture, (round(120 - half), 0), (round(120 + half), 200), (205, 205, 205), -1)
    noise = np.random.default_rng(0).normal(0, 2, picture.shape)
    picture = np.clip(cv2.GaussianBlur(picture, (0, 0), 0.8) + noise, 0, 255).astype(np.uint8)
    colours = lambda scale: (pair for pair in [(0.0, picture)])  # noqa: E731
    source: Any = SimpleNamespace(size=(240, 260), colours=colours, times_s=lambda: np.zeros(1))
    told = advice.film_lacks(Trials(source, pointed_at(((120.0 - half, 30.0), (120.0 + half, 30.0)), (120.0, tip)), 1))
    assert bool(told) == bool(said) and re.match(said, told)


def test_a_body_that_bends_towards_the_camera_is_told_so():
    """What turns within its own width in the first frame does not bend in the picture's plane: no hint mends that."""
    looked: Any = SimpleNamespace(refusal="no_fit: the line that fits is folded, 26 mm from the clamp")
    told = advice.film_lacks(Trials(NO_FILM, pointed_at(((108.0, 30.0), (132.0, 30.0)), (120.0, 200.0)), 1, first=looked))
    assert "turns there within its own width, as one does that bends towards the camera" in told


def test_a_base_that_turns_is_told_by_its_turn():
    """A link held by fingers: it stays where it is and turns, and the arm with it."""
    link = cv2.GaussianBlur(np.random.default_rng(3).uniform(0, 255, (260, 240, 3)), (0, 0), 4.0)
    link = np.clip(4 * (link - 128) + 128, 0, 255)

    def colours(scale):
        for k in range(30):
            shape = np.zeros((260, 240), np.uint8)
            cv2.rectangle(shape, (96, 0), (144, 40), 255, -1)
            cv2.line(shape, (120, 40), (120, 200), 255, 24)
            turn = cv2.getRotationMatrix2D((120, 40), k * 40 / 29, 1.0)
            there = cv2.warpAffine(shape, turn, (240, 260))[..., None] > 0
            yield k / 30, np.where(there, cv2.warpAffine(link, turn, (240, 260)), 120.0).astype(np.uint8)

    source: Any = SimpleNamespace(size=(240, 260), colours=colours)
    said = advice.base_moved(source, pointed_at(((108.0, 40.0), (132.0, 40.0)), (120.0, 200.0)), 30 * ["no_fit"])
    assert re.match("what holds the tube has turned in the picture, by some 1[5-9] degrees in frame 1[1-4]:", said)


def test_a_base_is_told_from_where_the_view_was_lost_at_once():
    """A hand's camera drifts, which is followed, until the wall is another one: from one frame to the next the base is 30 px off."""
    blurred = (cv2.GaussianBlur(np.random.default_rng(k).uniform(0, 255, (260, 320, 3)), (0, 0), 2.0) for k in (1, 2))
    walls = [np.clip(4 * (wall - 128) + 128, 0, 255).astype(np.uint8) for wall in blurred]
    base = np.random.default_rng(3).integers(0, 255, (30, 60, 3), dtype=np.uint8)

    def colours(scale):
        for k in range(30):
            picture = walls[k >= 22].copy()
            picture[:, 60:180] = 120
            picture[10:40, 90:150] = base
            cv2.line(picture, (120, 40), (120, 200), (220, 225, 215), 24, cv2.LINE_AA)
            moved = np.array([[1.0, 0, 40 * k / 29], [0, 1, 0]])
            yield k / 30, cv2.warpAffine(picture, moved, (240, 260), borderMode=cv2.BORDER_REFLECT)

    source: Any = SimpleNamespace(size=(240, 260), colours=colours)
    said = advice.base_moved(source, pointed_at(((108.0, 40.0), (132.0, 40.0)), (120.0, 200.0)), 22 * [""] + 8 * ["no_fit"])
    assert re.match(r"what holds the tube has moved in the picture, by 3\d px in frame 22: .* the film to its first 22 frames", said)


@pytest.mark.parametrize("half", [6, 12])
def test_a_body_that_swings_in_a_clamp_that_rests_is_no_base_that_turns(half):
    """What lies before the clamp is the body: with it in the patch, it looked as if what holds it had turned."""

    def colours(scale):
        for k in range(30):
            picture = np.full((260, 240, 3), 120, np.uint8)
            cv2.rectangle(picture, (120 - 2 * half, 0), (120 + 2 * half, 40), (60, 60, 150), -1)
            heading = np.radians(80 * np.sin(2 * np.pi * k / 15)) * np.clip(np.arange(60) / 3, 0, 1)
            line = np.array([120, 40]) + np.cumsum(np.column_stack([np.sin(heading), np.cos(heading)]), axis=0) * 160 / 60
            cv2.polylines(picture, [np.round(16 * line).astype(np.int32)], False, (220, 225, 215), 2 * half, cv2.LINE_AA, 4)
            noise = np.random.default_rng(k).normal(0, 3, picture.shape)
            yield k / 30, np.clip(cv2.resize(picture + noise, None, fx=scale, fy=scale), 0, 255).astype(np.uint8)

    source: Any = SimpleNamespace(size=(240, 260), colours=colours)
    assert advice.base_moved(source, pointed_at(((120.0 - half, 40.0), (120.0 + half, 40.0)), (120.0, 200.0)), 30 * ["no_fit"]) == ""


def test_a_base_that_moves_by_less_than_people_point_is_not_the_cause():
    """Of a stem 4 px wide it was said that what holds it had moved by 1 px: no frame is refused for that."""

    def colours(scale):
        for k in range(30):
            picture = np.full((260, 240, 3), 120, np.uint8)
            moved = np.array([[1.0, 0, 2.0 * k / 29], [0, 1, 0]])
            cv2.rectangle(picture, (100, 10), (140, 40), (40, 40, 200), -1)
            cv2.line(picture, (120, 40), (120, 200), (220, 225, 215), 4, cv2.LINE_AA)
            yield k / 30, cv2.resize(cv2.warpAffine(picture, moved, (240, 260), borderValue=(120, 120, 120)), None, fx=scale, fy=scale)

    source: Any = SimpleNamespace(size=(240, 260), colours=colours)
    assert advice.base_moved(source, pointed_at(((118.0, 40.0), (122.0, 40.0)), (120.0, 200.0)), 30 * ["no_fit"]) == ""
