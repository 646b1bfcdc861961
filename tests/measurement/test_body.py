"""The whole body in films as phones take them: colour, ruled paper, glare, tape, marks, swelling, compression."""

import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from rfea_vision.artefacts import Actuator, Hints
from rfea_vision.calibration.scale import scaled_by_distance
from rfea_vision.errors import DataError
from rfea_vision.readers.video import FolderSource, open_video
from rfea_vision.vision import track_frames
from rfea_vision.vision.body.follower import BodyFollower
from rfea_vision.vision.derive.rows import Rows
from rfea_vision.vision.follow.follower import Follower
from rfea_vision.vision.scene import make_scene
from rfea_vision.vision.track import follow_body, too_few, too_late
from testing.phone import Arm, Room, clear_scene, film, scene

SMALL = Room(size=(240, 260), px_per_mm=2.2, clamp=(120.0, 40.0), ruled=6.0, clutter=3, seed=4)
LEFT = -np.concatenate([np.linspace(0.05, 0.9, 20), np.linspace(0.9, 0.3, 12)])


def tracked(path, truth, *, aside=(0.0, 0.0), **more):
    source = open_video(path)
    x, y = np.mean(truth.clamp_px, axis=0)
    ruler = [[x, y], [x + 50 * truth.px_per_mm, y]]
    one, other = ((px + aside[0], py + aside[1]) for px, py in truth.clamp_px)
    clamp = one, other
    hints = Hints(clamp=clamp, tip=(truth.tip_px[0] + aside[0], truth.tip_px[1] + aside[1]), **more)
    arm = truth.arm
    actuator = Actuator(outer_radius=arm.half_width / 1e3, inner_radius=arm.half_width / 2e3, length=arm.length / 1e3)
    calibration = scaled_by_distance(source.size, ruler, 50.0)
    return track_frames(source, calibration, actuator, hints=hints, vertical="image")


@pytest.mark.parametrize(
    "arm",
    [
        Arm(opacity=0.7, glare=0.3, marks=3, tape_end=5.0, swell=0.25),
        Arm(rgb=(60.0, 60.0, 65.0), taper=0.4, bellows=7, swell=0.1, ragged=1.0),
    ],
)
def test_a_film_that_edges_cannot_read_is_read_by_the_body(arm, tmp_path):
    truth = film(tmp_path / "film.mp4", arm, SMALL, LEFT)
    track = tracked(tmp_path / "film.mp4", truth)
    assert track.dataset.attrs["followed_by"] == "body"
    assert track.valid.mean() >= 0.95, track.dataset["reason_detail"].values
    off = track.dataset["tip"].values - truth.tip_mm
    swing = np.ptp(truth.tip_mm, axis=0).max()
    assert np.sqrt(np.nanmean(np.sum(off**2, axis=1))) < 0.03 * swing
    assert np.nanmean(np.abs(off / track.dataset["tip_sigma"].values) < 2.0) > 0.9
    if arm.marks:  # what its inextensible side would say is off by 0.05
        full = np.abs(LEFT) / np.abs(LEFT).max()
        drawn = (1 + arm.stretch * full) / (1 + arm.stretch * full[0]) - 1
        off = track.dataset["marker_elongation"].values - drawn[:, None]
        # The last stretch ends under tape of the paper's colour: it is known to no better than a tenth, and left out.
        assert np.isfinite(off).mean() > 0.8 and np.sqrt(np.nanmean(off**2)) < 0.012
        known = track.dataset["marker_elongation_sigma"].values
        assert np.mean((np.abs(off) < 1.96 * known)[np.isfinite(off)]) > 0.95
        assert np.sqrt(np.nanmean((off / known)[:, :-4] ** 2)) > 0.25  # no wider than need be, up to the last mark
    width = track.dataset["width"].values
    assert abs(width[:4, -3].mean() / width[:4, 2].mean() - (1 - 0.9 * arm.taper)) < 0.15


def test_an_arm_that_swings_is_not_folded_into_its_clamp(tmp_path):
    """Flow on smooth rubber before a still wall says that it slid along itself by a tenth of its length."""
    arm, room, bends = scene(24)
    truth = film(tmp_path / "film.mp4", arm, room, bends[:15])
    track = tracked(tmp_path / "film.mp4", truth)
    assert track.valid.all(), track.dataset["reason_detail"].values
    off = np.linalg.norm(track.dataset["tip"].values - truth.tip_mm, axis=1)
    assert off.max() < 0.05 * np.ptp(truth.tip_mm, axis=0).max()


@pytest.mark.study
def test_clear_silicone_before_a_cable_on_ruled_paper(tmp_path):
    """A translucent arm of nearly the paper's colour, which swells and swings across a cable that shows through it."""
    arm, room, bends = clear_scene(0)
    truth = film(tmp_path / "film.mp4", arm, room, bends[:136:2])
    track = tracked(tmp_path / "film.mp4", truth)
    assert track.valid.mean() >= 0.95, track.dataset["reason_detail"].values
    off = track.dataset["tip"].values - truth.tip_mm
    assert np.sqrt(np.nanmean(np.sum(off**2, axis=1))) < 0.05 * np.ptp(truth.tip_mm, axis=0).max()
    assert np.nanmean(np.abs(off / track.dataset["tip_sigma"].values) < 2.0) > 0.9


def test_key_points_and_masks_of_another_program_are_where_the_fit_begins(tmp_path):
    """An arm that jumps from frame to frame farther than any flow follows: with points, or masks, it is found."""
    arm = Arm(rgb=(90.0, 150.0, 120.0), marks=3)
    jumps = np.array([0.05, 0.05, 1.0, -0.6, 0.8, -1.0, 0.4, 1.0])
    truth = film(tmp_path / "film.mp4", arm, SMALL, jumps)
    rng = np.random.default_rng(0)
    points = truth.centre_px[:, ::8] + rng.normal(0, 2.0, (len(jumps), 9, 2))
    table = np.column_stack([np.arange(len(jumps)), points.reshape(len(jumps), -1)])
    header = ",".join(["frame", *(f"{axis}{k}" for k in range(9) for axis in "xy")])
    np.savetxt(tmp_path / "points.csv", table, delimiter=",", header=header, comments="")
    (tmp_path / "masks").mkdir()
    for number, line in enumerate(truth.centre_px):
        mask = np.zeros(SMALL.size[::-1], dtype=np.uint8)
        cv2.polylines(mask, [np.round(line).astype(np.int32)], False, 255, round(2 * arm.half_width * SMALL.px_per_mm))
        cv2.imwrite(str(tmp_path / "masks" / f"{number:03d}.png"), mask)
    swing = np.ptp(truth.tip_mm, axis=0).max()
    # The masks are drawn with round ends, half a width longer than the arm: so far off the tip may be, if it says so.
    for more, share in (({"keypoints": tmp_path / "points.csv"}, 0.02), ({"masks": tmp_path / "masks"}, 0.08)):
        track = tracked(tmp_path / "film.mp4", truth, **more)
        assert track.valid.all(), track.dataset["reason_detail"].values
        off = np.linalg.norm(track.dataset["tip"].values - truth.tip_mm, axis=1)
        assert off.max() < share * swing
        assert np.all(off < 2 * np.linalg.norm(track.dataset["tip_sigma"].values, axis=1))


def test_the_line_does_not_slide_along_smooth_rubber(tmp_path):
    """The end leaves the picture and comes back: the line stays in its clamp, and ends where the arm does."""
    arm = Arm(length=80.0, rgb=(60.0, 60.0, 65.0), texture=1.0, tape_end=6.0, ragged=1.2, swell=0.07)
    there_and_back = np.concatenate([np.linspace(0.05, 1.6, 16), np.linspace(1.6, 0.05, 16)])
    truth = film(tmp_path / "film.mp4", arm, Room(size=(230, 260), px_per_mm=2.2, clamp=(110.0, 40.0)), there_and_back)
    track = tracked(tmp_path / "film.mp4", truth)
    off = np.linalg.norm(track.dataset["tip"].values - truth.tip_mm, axis=1)
    assert track.valid[-10:].all() and not track.valid[15:17].any()
    assert set(track.dataset["reason"].values[12:20][~track.valid[12:20]]) == {"touches_border"}
    assert track.valid.sum() >= 24
    assert "film a wider view" in track.dataset.attrs["advice"]
    assert np.nanmax(off) < 5.0  # mm, of 80: twelve encodings of the film gave 1.0 to 3.6


def test_copies_of_a_moving_arm_are_said_and_do_not_count_against_a_film():
    """Every other picture of a moving arm was written twice; once it rests, equal pictures are measured like all others."""
    calibration = scaled_by_distance((160, 200), [[0, 0], [100, 0]], 50.0)
    actuator = Actuator(outer_radius=0.005, inner_radius=0.002, length=0.06)
    hints = Hints(clamp=((70.0, 30.0), (90.0, 30.0)), tip=(80.0, 150.0))
    follower = BodyFollower(make_scene(calibration, actuator, "image", hints, (160, 200)), 1.0)
    rows = Rows(9, 4)
    t = np.linspace(0, 1, 60)
    bends, light = [0, 4, 4, 8, 8, 12, 12, 12, 12, 12], [0, 0, 0, 0, 0, 0, 0, 9, 5, 5]
    for frame, bend in enumerate(bends):
        line = np.column_stack([80.0 + bend * t**2, 30.0 + 120.0 * t])
        picture = np.full((200, 160, 3), 220, dtype=np.uint8)
        cv2.polylines(picture, [np.round(line * 16).astype(np.int32)], False, (60, 160, 90), 19, cv2.LINE_AA, 4)
        picture[:8, :8] -= np.uint8(light[frame])  # a lamp in the corner
        rows.append(float(frame), follower.next(picture, float(frame)), follower)
    assert [reason == "duplicate" for reason in rows.reasons] == [False, *[False, True] * 3, *[False] * 3]
    assert rows.good == 7 and rows.share == 1.0
    assert follower.good == rows.good, "one that knows of fewer has begun anew, and rows before that do not count"


def test_edges_are_given_up_once_they_must_be_and_not_later_for_what_they_missed_before():
    """Of 31 frames 6 may be missed; a film of 160 frames that misses ten of them is read by its edges to the end."""
    assert [too_few(10, 10 - missed, 0) for missed in (0, 6, 7, 10)] == [False, False, True, True]
    assert [too_few(31, 31 - missed, 0) for missed in (6, 7)] == [False, True]
    assert not too_few(49, 42, 0) and not too_few(160, 150, 0) and too_few(160, 120, 0)
    assert not too_few(40, 20, 20), "copies do not count"


def test_a_film_whose_body_is_lost_ends_before_its_end(monkeypatch):
    """When the rest cannot make half of it, also of a container that does not say how many frames it has; or lost for long."""
    assert [too_late(done, 9, 0, 100, lost=done - 9) for done in (59, 60)] == [False, True]
    assert not too_late(359, 120, 0, 9000, lost=239) and too_late(361, 120, 0, 9000, lost=241)
    assert not too_late(1300, 1000, 0, 9000, lost=300), "it was seen for longer"

    def lost(self, *_):
        self.good, self.missed = 1, self.missed + 1
        return "no_tube"

    times = tuple(np.arange(40.0))
    source = FolderSource(Path("film"), (160, 200), None, 1.0, (), times)
    blank = np.zeros((200, 160, 3), dtype=np.uint8)
    monkeypatch.setattr(BodyFollower, "next", lost)
    monkeypatch.setattr(BodyFollower, "looked_at", lambda *_: (np.zeros((1, 2)), np.inf))
    monkeypatch.setattr(FolderSource, "colours", lambda *_: ((time, blank) for time in times))
    actuator = Actuator(outer_radius=0.005, inner_radius=0.002, length=0.06)
    hints = Hints(clamp=((70.0, 30.0), (90.0, 30.0)), tip=(80.0, 150.0))
    scene = make_scene(scaled_by_distance((160, 200), [[0, 0], [100, 0]], 50.0), actuator, "image", hints, (160, 200))
    assert len(follow_body(source, scene, None, Rows(9, 4), None)[1]) == 21


def test_edges_that_find_nothing_where_it_was_pointed_at_leave_the_film_to_the_body(monkeypatch, tmp_path):
    """After the first frame, in which it was pointed at, not after seven."""
    looked = []
    monkeypatch.setattr(Follower, "next", lambda *_: looked.append(1) or "no_tube")
    truth = film(tmp_path / "film.mp4", Arm(), SMALL, LEFT[:5])
    assert tracked(tmp_path / "film.mp4", truth).dataset.attrs["followed_by"] == "body"
    assert len(looked) == 1


def decoy(picture: np.ndarray) -> None:
    """A second arm of the same colour, 70 px beside the first, that hangs still."""
    cv2.line(picture, (190, 30), (185, 215), (118.0, 140.0, 165.0), 26, cv2.LINE_AA)


@pytest.mark.usefixtures("unadvised")
@pytest.mark.parametrize(
    ("arm", "room", "aside"),
    [
        (Arm(), SMALL, (60.0, 10.0)),  # at the wall
        (Arm(), replace(SMALL, ruled=0.0, clutter=0), (20.0, 5.0)),  # on one edge of an arm that edges alone can read
        (Arm(), replace(SMALL, ruled=5.9), (-40.0, 0.0)),  # along ruled lines an arm's width apart
        (Arm(rgb=(118.0, 140.0, 165.0)), replace(SMALL, clutter=0, more=decoy), (30.0, 0.0)),  # between it and another
    ],
)
def test_hints_beside_the_arm_give_no_track(arm, room, aside, tmp_path):
    truth = film(tmp_path / "film.mp4", arm, room, LEFT[:5])
    with pytest.raises(DataError, match=r"edge_lost|no_tube|no_fit|occluded|touches_border|off_hints"):
        tracked(tmp_path / "film.mp4", truth, aside=aside)


def test_of_two_arms_the_one_that_was_pointed_at_is_followed(tmp_path):
    """The arm swings through the place of another of its colour, and back."""
    swing = np.concatenate([np.linspace(0.05, 0.7, 14), np.linspace(0.7, 0.1, 12)])
    truth = film(tmp_path / "film.mp4", Arm(rgb=(118.0, 140.0, 165.0)), replace(SMALL, more=decoy), swing)
    track = tracked(tmp_path / "film.mp4", truth)
    assert track.valid.mean() > 0.6
    off = np.linalg.norm(track.dataset["tip"].values - truth.tip_mm, axis=1)
    assert np.nanmax(off) < 8.0  # mm: less than the arm is wide, as far as encodings of the film may differ


def test_a_hint_is_tried_before_it_is_said(tmp_path):
    """Edges lose an arm that swells; where its clamp and its tip were in the first frame, the body is read throughout."""
    truth = film(tmp_path / "film.mp4", Arm(), SMALL, LEFT)
    source = open_video(tmp_path / "film.mp4")
    calibration = scaled_by_distance(source.size, [[20, 20], [130, 20]], 50.0)
    actuator = Actuator(outer_radius=0.006, inner_radius=0.003, length=0.09)
    track = track_frames(source, calibration, actuator, vertical="image")
    said = track.dataset.attrs["advice"]
    assert "tried, it reads 32 of the first 32 frames" in said
    clamp, tip = (
        re.findall(r"(\d+\.?\d*), (\d+\.?\d*)", part) for part in said.split("camera.clamp: ")[1].split("camera.tip")
    )
    pixels = np.array([*clamp[:2], tip[0]], dtype=float)
    assert np.linalg.norm(pixels[2] - truth.tip_px) < 5.0
    hints = Hints(clamp=(tuple(pixels[0]), tuple(pixels[1])), tip=tuple(pixels[2]))
    assert track_frames(source, calibration, actuator, hints=hints, vertical="image").valid.mean() >= 0.95


def test_what_covers_the_arm_is_called_so(tmp_path):
    """A hand over most of the arm in a few frames: they are refused, and the arm is found again behind it."""
    truth = film(tmp_path / "film.mp4", Arm(rgb=(90.0, 150.0, 120.0), marks=3), SMALL, LEFT, hand=(14, 17))
    track = tracked(tmp_path / "film.mp4", truth)
    assert not track.valid[14:17].any()
    assert track.valid[19:].all()
    assert set(track.dataset["reason"].values[14:17]) == {"occluded"}
    for said in track.dataset["reason_detail"].values[14:17]:
        assert re.match(r"something of another colour is in front of it, \d+ to \d+ mm", said)
