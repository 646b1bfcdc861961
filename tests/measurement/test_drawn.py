"""Drawn films: the same from the same seed, and their truth lies where the pictures show it."""

from __future__ import annotations

from dataclasses import replace

import av
import cv2
import numpy as np
import pytest

from testing.drawn import Scene, Stage, draw, film, summary
from testing.drawn.light import to_linear
from testing.drawn.things import passing

SEEDS = range(1000, 1010)


@pytest.fixture(scope="module")
def scenes() -> list[Scene]:
    return [draw(seed) for seed in SEEDS]


def along(
    picture: np.ndarray, start: np.ndarray, direction: np.ndarray, reach_px: float
) -> tuple[np.ndarray, np.ndarray]:
    """Distances (n,) px from a point on a line through it, and the picture there (n,)."""
    away = np.arange(-reach_px, reach_px, 0.1)
    x, y = (start[:, None] + direction[:, None] * away).astype(np.float32)
    return away, cv2.remap(picture, x[None], y[None], cv2.INTER_LINEAR)[0]


def last_fall(away: np.ndarray, values: np.ndarray, level: float) -> float:
    """Where values fall below a level for the last time."""
    k = np.flatnonzero((values[:-1] >= level) & (values[1:] < level))[-1]
    return float(np.interp(-level, -values[k : k + 2], away[k : k + 2]))


def directions(line: np.ndarray, at: int) -> tuple[np.ndarray, np.ndarray]:
    ahead = line[at] - line[at - 1]
    ahead = ahead / np.hypot(*ahead)
    return ahead, np.array([-ahead[1], ahead[0]])


def test_same_bytes_of_the_same_seed(tmp_path):
    for name in ("one.mp4", "two.mp4"):
        truth = film(tmp_path / name, replace(draw(1004), frames=5))
    assert (tmp_path / "one.mp4").read_bytes() == (tmp_path / "two.mp4").read_bytes()
    assert truth.centre_px.shape == (5, 65, 2)
    assert len(truth.times_s) == len(truth.visible) == 5


def test_ends_are_drawn_where_they_are_said_to_be(scenes):
    """Half of the coverage is lost within 0.3 px of the line's last point, in all kinds and poses."""
    seen = set()
    for scene in scenes:
        stage = Stage(scene)
        for frame in (0, scene.frames // 2):
            if not stage.visible(frame):
                continue
            line = stage.centre(frame)
            away, cover = along(stage.picture(frame, cover=True), line[-1], directions(line, -1)[0], 6)
            assert abs(last_fall(away, cover, 0.5 * cover[0])) < 0.3, summary(scene)
            seen.add(scene.body.kind)
    assert len(seen) >= 5


def test_lines_lie_midway_between_edges(scenes):
    checked = 0
    for scene in scenes:
        if scene.body.left is not np.ones_like or scene.body.right is not np.ones_like:
            continue  # an outline with folds or chambers is not as wide on both sides everywhere
        stage, frame = Stage(scene), scene.frames // 3
        line, cover = stage.centre(frame), stage.picture(frame, cover=True)
        away, across = along(cover, line[40], directions(line, 40)[1], 1.5 * scene.place.half_width_px + 3)
        right, left = last_fall(away, across, 0.5), last_fall(away, across[::-1], 0.5)
        assert abs(right - left) < 0.5, summary(scene)
        checked += 1
    assert checked >= 3


def test_a_film_shows_its_end_where_its_truth_says(tmp_path):
    """Decoded, in linear light, a white body before black ends within a pixel of the truth, and at the clamp's edges, too."""
    simple = (s for s in map(draw, range(1000, 1040)) if s.body.left is np.ones_like and s.body.right is np.ones_like)
    scene = next(s for s in simple if s.body.end.shape == "square")
    scene = replace(
        scene, frames=3, room="black cloth", colour=np.full(3, 0.7), body=replace(scene.body, marks=(), cap=None, opacity=1.0),
        light=replace(scene.light, shadow_px=None, lamps=(), ambient=1.0, flicker=0), attached=replace(scene.attached, name="nothing"),
        camera=replace(scene.camera, noise=0.5, crf=20, jpeg=None, contrast=0.0),
    )  # fmt: skip
    truth = film(tmp_path / "film.mp4", scene)
    with av.open(str(tmp_path / "film.mp4")) as container:
        frames = [f.to_ndarray(format="rgb24") for f in container.decode(video=0)]
    assert len(frames) == 3
    linear = to_linear(frames[0][..., 1].astype(np.float32) / 255)
    line = truth.centre_px[0]
    away, light = along(linear, line[-1], directions(line, -1)[0], 8)
    assert abs(last_fall(away, light, (light[:20].mean() + light[-20:].mean()) / 2)) < 0.7
    assert truth.tip_px == pytest.approx(line[-1])
    edges = np.array(truth.clamp_px)
    assert np.hypot(*(edges.mean(axis=0) - line[0])) < 0.3
    assert np.hypot(*(edges[1] - edges[0])) / 2 == pytest.approx(truth.half_width_px, rel=0.1)


def test_an_end_behind_a_hand_is_not_visible(scenes):
    scene = scenes[0]
    tip = scene.pose(8).line[-1]
    hand = passing(np.random.default_rng(1), scene.camera.shape, tip[None], 20, 10.0)
    hand = replace(hand, name="hand", first=3, last=13, thick_px=14.0)
    stage = Stage(replace(scene, passing=hand))
    assert [stage.visible(k) for k in (2, 8, 14)] == [True, False, True]


def test_every_seed_is_another_film(scenes):
    lines = [summary(scene) for scene in scenes]
    assert len(set(lines)) == len(lines)
    assert all("\n" not in line and line.startswith(str(seed)) for seed, line in zip(SEEDS, lines, strict=True))
    assert len({scene.body.kind for scene in scenes}) > 4
    assert len({scene.room for scene in scenes}) > 4


def test_ends_of_a_shaken_film_are_those_of_a_camera_that_stands(tmp_path):
    """What its hand turns is none of the body's motion: by a long arm it had been counted as 4 px of error."""
    scene = replace(draw(1070), frames=12)
    truth, camera = film(tmp_path / "film.mp4", scene), scene.camera
    assert camera.shake is not None and np.abs(camera.shake[:, 2]).max() > 0.01
    for frame in range(12):
        seen = camera.moved(frame) @ [*truth.ends_px[frame], 1.0]
        assert seen[:2] == pytest.approx(truth.centre_px[frame, -1], abs=1e-6)
