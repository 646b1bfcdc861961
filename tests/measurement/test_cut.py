"""A first frame that the hints' own lines miss: the way through what is cut out of the picture."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from rfea_vision.artefacts import Actuator, Hints
from rfea_vision.calibration.scale import scaled_by_distance
from rfea_vision.vision.body.begin import Pointed
from rfea_vision.vision.body.cut import through_cut_out
from rfea_vision.vision.body.first import Begun, held_near
from rfea_vision.vision.body.follower import BodyFollower
from rfea_vision.vision.body.model import SHARES, STATIONS
from rfea_vision.vision.scene import make_scene

from .test_gone import HALF as HALF_PX
from .test_gone import RUBBER, WALL, drawn, follower_of, middle_of

HALF, TURN = 9.0, np.linspace(0.0, 0.9 * np.pi, 200)


def curled(wall: int = 60) -> tuple[np.ndarray, np.ndarray]:
    """CIELAB of a pale body that curls by nearly half a turn before a dark wall, and its centre line (200, 2) px."""
    line = np.array([160.0, 200.0]) + np.column_stack([70.0 * (np.cos(TURN) - 1.0), -70.0 * np.sin(TURN)])
    rgb = np.full((320, 300, 3), wall, dtype=np.uint8)
    rgb[:, ::7] += 12
    cv2.polylines(rgb, [np.round(16 * line).astype(np.int32)], False, (215, 210, 190), round(2 * HALF), cv2.LINE_AA, 4)
    rgb[210:] = wall  # its clamp
    return np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2LAB)), line


@pytest.mark.parametrize("enlarged", [1, 3])
def test_the_way_keeps_to_the_middle_of_a_curl(enlarged):
    picture, line = curled()
    picture = np.asarray(cv2.resize(picture, None, fx=enlarged, fy=enlarged))
    clamp = enlarged * np.array([[151.0, 199.0], [169.0, 199.0]])
    hinted = np.array([clamp.mean(axis=0), enlarged * line[-1]])
    way = through_cut_out(picture, Pointed(clamp, hinted, enlarged * HALF, enlarged * 200.0))
    assert way is not None
    off = np.linalg.norm(way[:, None] / enlarged - line, axis=2).min(axis=1)
    assert off.max() < 0.5 * HALF and np.linalg.norm(way[32] / enlarged - line[100]) < 1.5 * HALF


def test_no_colour_of_a_grey_picture_is_impossible(monkeypatch):
    """A grey level that neither the body's nor the wall's colours had was infinitely unlike both, and cut anywhere, for seconds."""
    picture = np.full((320, 300, 3), 128, dtype=np.uint8)
    picture[..., 0] = np.random.default_rng(0).normal(65.0, 3.0, picture.shape[:2]).astype(np.uint8)
    cv2.line(picture, (60, 60), (60, 250), (225, 128, 128), round(2 * HALF))  # another tube
    cv2.rectangle(picture, (30, 20), (90, 60), (22, 128, 128), -1)
    likely, cut = [], cv2.grabCut

    def watched(seen, mask, box, wall, body, turns, mode):
        if mode == cv2.GC_EVAL_FREEZE_MODEL:
            likely.extend(likelihoods(model[0], seen.reshape(-1, 3).astype(float)) for model in (wall, body))
        return cut(seen, mask, box, wall, body, turns, mode)

    monkeypatch.setattr(cv2, "grabCut", watched)
    bare = np.array([[160.0, 80.0], [160.0, 240.0]])  # both pointed at beside all tubes
    assert through_cut_out(picture, Pointed(bare[0] + np.outer([-HALF, HALF], [1.0, 0.0]), bare, HALF, 160.0)) is not None
    assert len(likely) >= 2 and min(found.min() for found in likely) > 1e-15


def likelihoods(model: np.ndarray, colours: np.ndarray) -> np.ndarray:
    """Of colours (n, 3) under one of GrabCut's models (65,): (n,)."""
    found = np.zeros(len(colours))
    for share, mean, covariance in zip(model[:5], model[5:20].reshape(5, 3), model[20:].reshape(5, 3, 3), strict=True):
        off = colours - mean
        distance = np.einsum("ni,ij,nj->n", off, np.linalg.inv(covariance), off)
        found += share * np.exp(-0.5 * distance) / np.sqrt(np.linalg.det(covariance))
    return found


def test_where_hints_allow_nothing_there_is_no_way():
    picture, _ = curled()
    nowhere = np.zeros(picture.shape[:2], dtype=bool)
    clamp, line = np.array([[-90.0, -99.0], [-70.0, -99.0]]), np.array([[-80.0, -99.0], [-50.0, -40.0]])
    assert through_cut_out(picture, Pointed(clamp, line, HALF, 300.0, allowed=nowhere)) is None


def test_an_outline_that_is_led_away_from_the_tip_is_held_there_at_first():
    """A body that curls before a plate of nearly its colour: its outline had followed the plate, two half widths astray."""
    line, plate = middle_of(1.5, 75.0), ((34, 64, 100, 110), (204, 219, 222))
    scene = follower_of(line).scene
    follower = BodyFollower(replace(scene, hints=replace(scene.hints, centre_line=())), 1.0)
    assert follower.next(drawn(line, np.full(65, HALF_PX), [plate]), 0.0) == ""
    assert np.linalg.norm(follower.body.points - line, axis=1).max() < 0.4 * HALF_PX


def test_a_held_end_takes_the_line_along_and_leaves_the_clamp():
    line = np.column_stack([np.linspace(0.0, 128.0, STATIONS), np.zeros(STATIONS)])
    astray = line + SHARES[:, None] * [0.0, 30.0]
    held = held_near(astray, line, 8.0, drawn=False)
    assert held[-1] == pytest.approx([128.0, 8.0]) and held[0] == pytest.approx([0.0, 0.0])
    assert held_near(held, line, 8.0, drawn=False) == pytest.approx(held)


def test_a_body_that_curls_behind_its_clamp_is_found():
    """Its tip lies on the clamp's other side, to which it does not leave: the line had gone there over the bare wall."""
    bend = np.linspace(0.0, 1.55 * np.pi, STATIONS)
    line = np.array([160.0, 150.0]) + 60.0 * np.column_stack([np.cos(bend) - 1.0, -np.sin(bend)])
    picture = np.full((300, 300, 3), WALL, dtype=np.uint8)
    cv2.polylines(picture, [np.round(16 * line).astype(np.int32)], False, RUBBER, round(2 * HALF), cv2.LINE_AA, 4)
    cv2.rectangle(picture, (130, 150), (190, 200), (190, 205, 210), -1)  # what holds it is nearly of its colour
    assert line[-1, 1] > 150.0, "behind it"
    radius_m = HALF / 2e3
    tube = Actuator(length=60.0 * bend[-1] / 2e3, outer_radius=radius_m, inner_radius=0.5 * radius_m)
    calibration = scaled_by_distance((300, 300), ((20.0, 290.0), (220.0, 290.0)), 100.0)
    hints = Hints(clamp=((160.0 - HALF, 150.0), (160.0 + HALF, 150.0)), tip=tuple(line[-1].tolist()))
    follower = BodyFollower(make_scene(calibration, tube, "image", hints, (300, 300)), 1.0)
    assert follower.next(picture, 0.0) == ""
    assert np.linalg.norm(follower.body.points - line, axis=1).max() < 0.6 * HALF
    assert follower.next(picture, 0.0) == "", "a body at rest"


@pytest.mark.parametrize(("others", "taken"), [([0.3, 0.02, 0.05, 0.08], 2), ([0.15, 0.09, 0.3, 0.2], 0), ([0.08, 0.1, 0.12, 0.07], 4)])
def test_an_outline_of_which_much_is_unseen_is_left_for_one_that_leaves_half_as_much(monkeypatch, others, taken):
    """Swollen silicone has an inner rim that a line keeps to; where none of the others is better, all is as it was before them."""
    line = middle_of(0.3, 100.0)
    scene = follower_of(line).scene
    follower = BodyFollower(replace(scene, hints=replace(scene.hints, centre_line=())), 1.0)
    fitted, tried = BodyFollower._begun_fit, list[tuple[float, Begun]]()

    def counted(self, lab, begun):
        fit = fitted(self, lab, begun)
        unseen = [0.17, *others, *[0.17] * 5][len(tried)]
        tried.append((unseen, begun))
        fit.seen = np.ones((STATIONS, 2), dtype=bool)
        fit.seen[: round(2 * unseen * STATIONS), 0] = False
        return fit

    monkeypatch.setattr(BodyFollower, "_begun_fit", counted)
    assert follower.next(drawn(line, np.full(65, HALF_PX)), 0.0) == ""
    assert len(tried) in (6, 10), "four that leave to the tip's side, four more if one that does not is cut out, and the best"
    assert tried[-1][1] is tried[taken][1]
