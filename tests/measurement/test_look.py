"""Ends that nothing but their looks tells: of the body's own colour, beside what has it, too."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from rfea_vision.vision.body.gone import led_to
from rfea_vision.vision.body.look import AT_END, EndLook, as_long
from rfea_vision.vision.body.model import SeenBody
from rfea_vision.vision.body.shown import Shown
from tests.measurement.test_gone import FOOT, HALF, RUBBER, WALL, follower_of, middle_of
from tests.measurement.test_gone import drawn as with_body

CAP = 24  # px to either side: twice as far as the body goes


def drawn(line: np.ndarray, thing: tuple[int, int, int, int], seed: int) -> np.ndarray:
    """A straight, smooth body, what holds it, and a thing of its own colour (left, top, right, bottom); other noise in each."""
    picture = np.full((240, 240, 3), WALL, dtype=float)
    for left, top, right, bottom in ((150, 30, 200, 90), (round(line[-1, 0]), 60 - int(HALF), 151, 60 + int(HALF)), thing):
        picture[top:bottom, left:right] = RUBBER
    noise = np.random.default_rng(seed).normal(0, 2, picture.shape)
    return np.clip(cv2.GaussianBlur(picture, (0, 0), 0.8) + noise, 0, 255).astype(np.uint8)


def capped(line: np.ndarray, seed: int) -> np.ndarray:
    """It ends in a plate."""
    end = round(line[-1, 0])
    return drawn(line, (end, 60 - CAP, end + 14, 60 + CAP), seed)


def endless(line: np.ndarray, seed: int) -> np.ndarray:
    """It goes on in its own width."""
    return drawn(line, (20, 60 - int(HALF), 151, 60 + int(HALF)), seed)


@pytest.mark.parametrize("frames", [10, 20])
@pytest.mark.parametrize("grown", [0.25, -0.2])
def test_a_smooth_body_that_grows_is_followed_to_the_cap_at_its_end(grown, frames):
    """Nothing told how long it was: its line stayed as long, up to two half widths off, and was sure of it to a fifth of one."""
    follower, off = follower_of(middle_of(0.0, 100.0)), np.inf
    for k in range(frames + 2):
        line = middle_of(0.0, 100.0 * (1.0 + grown * max(k - 1, 0) / frames))
        assert follower.next(capped(line, k), 0.1 * k) == "", k
        off = float(np.linalg.norm(follower.body.points[-1] - line[-1]))
    assert off < 0.5 * HALF
    assert off < 2.0 * follower.work.numbers["tip_variance"][0] ** 0.5 * follower.px_per_mm


def looked(draw=capped, beyond: float = 0.0) -> tuple[EndLook, np.ndarray, SeenBody]:
    """The look of an end, a picture in which its body has grown by so many px, and the body as it was."""
    line = middle_of(0.0, 100.0)
    follower = follower_of(line)
    assert follower.next(draw(line, 0), 0.0) == ""
    grown = Shown(draw(middle_of(0.0, 100.0 + beyond), 1))
    return follower.look, grown.lab(grown.whole), follower.body


@pytest.mark.parametrize("beyond", [-8.0, 5.0, 12.0])
def test_a_look_finds_its_end_where_that_is(beyond):
    look, lab, body = looked(capped, beyond)
    spread = np.diag([1.0, 100.0])
    moved, known = look.found(lab, body, spread)
    assert moved == pytest.approx([0.0, beyond], abs=0.1 * HALF)
    assert known[1, 1] < 3.0 and known[0, 0] < 1.1


def test_an_end_that_looks_alike_all_along_is_known_no_better_than_it_was_foretold():
    look, lab, body = looked(endless)
    spread = np.diag([1.0, 9.0])
    moved, known = look.found(lab, body, spread)
    assert np.abs(moved[1]) < 1.0
    assert known[1, 1] > 0.8 * spread[1, 1]


def test_what_goes_with_the_end_is_led_along():
    """To all that the look tells, and no farther; the clamp, which does not go with it, stays."""
    _, _, body = looked()
    spread = 1e-6 * np.eye(25)
    spread += AT_END.T @ np.diag([4.0, 9.0]) @ AT_END
    led, known = led_to(body, spread, AT_END, np.array([1.0, 2.0]), np.diag([0.5, 0.2]))
    moved = led.points[-1] - body.points[-1]
    assert [moved @ body.normals[-1], moved @ body.tangents[-1]] == pytest.approx([1.0, 2.0], abs=1e-6)
    assert AT_END @ known @ AT_END.T == pytest.approx(np.diag([0.5, 0.2]), abs=1e-6)
    assert led.points[0] == pytest.approx(body.points[0], abs=1e-3)


def test_the_look_is_that_of_the_first_frame():
    look, lab, body = looked()
    assert np.abs(EndLook.of(lab, body).colours - look.colours).mean() < 4.0


GAPS = (0.12, 0.3, 0.42, 0.63, 0.8)  # of the length, where the blocks of a printed finger end


def printed(line: np.ndarray, seed: int, beyond: float = 0.0) -> np.ndarray:
    """A finger of blocks, dark between them, and so many px of another thing that looks like it beyond its end."""
    tangent = (line[-1] - line[-2]) / np.linalg.norm(line[-1] - line[-2])
    longer = np.vstack([line, line[-1] + np.outer(np.linspace(0.5, beyond, 8) if beyond else [], tangent)])
    picture = with_body(longer, np.full(len(longer), HALF)).astype(float)
    for gap in GAPS:
        ahead = np.gradient(line, axis=0)[round(64 * gap)]
        ahead /= np.linalg.norm(ahead)
        aside = HALF * np.array([-ahead[1], ahead[0]])
        corners = line[round(64 * gap)] + np.array([0.9 * aside - 3 * ahead, 0.9 * aside + 3 * ahead, 3 * ahead, -3 * ahead])
        cv2.fillPoly(picture, [np.round(16 * corners).astype(np.int32)], (120, 120, 120), cv2.LINE_AA, 4)
    noise = np.random.default_rng(seed).normal(0, 2, picture.shape)
    return np.clip(cv2.GaussianBlur(picture, (0, 0), 0.6) + noise, 0, 255).astype(np.uint8)


@pytest.mark.parametrize(("draw", "told"), [(printed, True), (endless, False)])
@pytest.mark.parametrize("share", [1.0, 1.08, 0.9])
def test_skin_says_how_long_its_body_is_where_it_shows_something(draw, told, share):
    line = middle_of(0.0, 100.0)
    follower = follower_of(line)
    assert follower.next(draw(line, 0), 0.0) == ""
    seen = Shown(draw(line, 1), 1)
    longer = FOOT + share * (follower.body.points - FOOT)
    found = as_long(seen.lab(seen.whole), replace(follower.body, points=longer), follower.skin.colours, follower.first.length)
    assert found.told == (told and share == 1.0)
    assert found.another == pytest.approx(100.0 * (1.0 - share) if told else 0.0, abs=2.0)
    assert found.likeliest.length == pytest.approx(100.0 if told else 100.0 * share, abs=2.0)


@pytest.mark.parametrize("speed", [0.8, 1.5, 3.0])
def test_a_finger_that_grows_into_its_image_in_a_table_says_how_little_its_end_is_known(speed):
    """Its end is seen as clearly as any; its blocks are where they were. It was up to 39 px off, and sure of it to 10."""
    follower, read = follower_of(middle_of(0.0, 110.0)), 0
    for k in range(16):
        line = middle_of(0.02 * k, 110.0)
        if follower.next(printed(line, k, max(0.0, (k - 2) * speed)), 0.1 * k) == "":
            read += 1
            off = float(np.linalg.norm(follower.body.points[-1] - line[-1]))
            assert off < 2.0 * follower.work.numbers["tip_variance"][0] ** 0.5 * follower.px_per_mm, k
    assert read > 8


def test_what_lies_beyond_an_end_that_the_skin_tells_is_not_the_body():
    """A hose of its colour is put to its end: it was refused from there on, for the body went on beyond its line."""
    follower = follower_of(middle_of(0.0, 110.0))
    for k in range(8):
        line = middle_of(0.02 * k, 110.0)
        assert follower.next(printed(line, k, 40.0 if k > 2 else 0.0), 0.1 * k) == "", k
        assert np.linalg.norm(follower.body.points[-1] - line[-1]) < 0.3 * HALF, k
