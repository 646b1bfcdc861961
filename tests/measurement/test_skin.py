"""The skin of a body: what light does to it, and what its material does."""

import cv2
import numpy as np
import pytest

from rfea_vision.vision.body.model import STATIONS, SeenBody
from rfea_vision.vision.body.skin import Skin

from .test_gone import HALF, WALL, follower_of, middle_of

LIGHT = np.array([0.0, -1.0])  # from above


def shaded(line: np.ndarray, spots: float = 0.0, slant: float = 0.8) -> np.ndarray:
    """A picture (240, 240, 3) of a round body with a round end, under a lamp above it that stands out of the picture's plane.

    `spots` grey levels of a pattern lie on it, and `slant` rad is by how much the lamp stands above rather than before it.
    """
    pixels = np.dstack(np.meshgrid(np.arange(240.0), np.arange(240.0))).reshape(-1, 2)
    steps = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    middle = line[steps < steps[-1] - HALF + 1e-9]  # of what rolls along the line: it reaches to its end
    apart = np.linalg.norm(pixels[:, None] - middle, axis=2)
    near = apart.argmin(axis=1)
    off = (pixels - middle[near]) / HALF
    out = np.minimum(np.linalg.norm(off, axis=1), 1.0)
    lit = np.sqrt(1.0 - out**2) * np.cos(slant) + np.sin(slant) * off @ LIGHT
    tangents = np.gradient(middle, axis=0)
    aside = off[:, 1] * tangents[near, 0] - off[:, 0] * tangents[near, 1]
    pattern = spots * np.sin(steps[near] / 3.0) * np.sin(4.0 * aside / np.linalg.norm(tangents[near], axis=1))
    grey = 110.0 + 90.0 * np.maximum(lit, 0.0) + pattern
    cover = np.clip(HALF - apart.min(axis=1) + 0.5, 0.0, 1.0)[:, None]
    picture = (cover * grey[:, None] * [0.92, 0.97, 1.0] + (1.0 - cover) * np.array(WALL)).reshape(240, 240, 3)
    picture[30:91, 150:201] = (180, 90, 40)
    noise = np.random.default_rng(0).normal(0, 2, picture.shape)
    return np.clip(cv2.GaussianBlur(picture, (0, 0), 0.8) + noise, 0, 255).astype(np.uint8)


def body_on(line: np.ndarray) -> SeenBody:
    return SeenBody(line, np.full(STATIONS, HALF), np.ones((STATIONS, 2, 3)), np.ones((STATIONS, 2, 2, 3)))


def lab_of(picture: np.ndarray) -> np.ndarray:
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2LAB), dtype=np.uint8)


@pytest.mark.parametrize("aside", [0.0, 1.0])
@pytest.mark.parametrize("turned", [0.0, 0.4])
def test_skin_tells_where_its_body_is_and_not_where_the_light_comes_from(aside, turned):
    """It told a twentieth of how far a body had gone aside that had turned by 0.4 rad under its lamp."""
    line = middle_of(0.3, 110.0)
    body = body_on(line)
    skin = Skin.of(lab_of(shaded(line, 40.0, 0.2)), body)
    information, pull, _ = skin.matched(lab_of(shaded(line + np.array([0.0, aside]), 40.0, 0.2 + turned)), body, np.ones(STATIONS))
    inner = slice(8, STATIONS - 16)  # between the clamp's block and the round end
    found = pull[inner, 0].sum() / information[inner, 0].sum()
    assert abs(found - aside * body.normals[inner, 1].mean()) < 0.3, "the slopes that count are less by those of noise"


def test_a_fat_round_end_that_turns_under_a_lamp_is_followed_along_its_middle():
    """Its shading stayed where the lamp was, and its face was taken for an edge: it was off by 0.40 half widths."""
    follower, off = follower_of(middle_of(0.0, 60.0)), 0.0
    for k in range(60):
        line = middle_of(-0.03 * k, 60.0)
        assert follower.next(shaded(line), 0.05 * k) == "", k
        off = max(off, float(np.linalg.norm(follower.body.points[-1] - line[-1])) / HALF)
    assert off < 0.33
