"""What a film itself says of clamp and tip: a tube rests where it is held, and moves most at its tip."""

import re
from dataclasses import replace

import cv2
import numpy as np
import pytest

from rfea_vision.artefacts import Actuator, Hints
from rfea_vision.calibration.scale import scaled_by_distance
from rfea_vision.errors import DataError
from rfea_vision.readers.video import open_frames
from rfea_vision.vision import track_frames
from rfea_vision.vision.find.begin import Scene
from rfea_vision.vision.find.locate import Path
from rfea_vision.vision.find.moving import Motion, moving_lines
from rfea_vision.vision.trials import _other_way

FOOT, LENGTH, WIDE, HEIGHT = np.array([120.0, 60.0]), 120.0, 240, 260


def middle_of(bend: float) -> np.ndarray:
    """Centre line (65, 2) px of an arm that hangs from `FOOT` and bends to the right by so many rad."""
    angle = bend * np.linspace(0, 1, 65)
    steps = np.column_stack([np.sin(angle), np.cos(angle)])[1:] * LENGTH / 64
    return FOOT + np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])


def shown(bend: float, rng: np.random.Generator) -> np.ndarray:
    """An arm that narrows from 22 to 12 px, of which the edges make no tube, before another like it that rests."""
    picture = np.full((HEIGHT, WIDE, 3), 200.0)
    for line in (middle_of(bend), middle_of(0.0) - [75, -10]):
        tangents = np.gradient(line, axis=0)
        normals = np.column_stack([-tangents[:, 1], tangents[:, 0]]) / np.linalg.norm(tangents, axis=1)[:, None]
        half = np.linspace(11, 6, 65)[:, None]
        outline = np.vstack([line + half * normals, (line - half * normals)[::-1]])
        cv2.fillPoly(picture, [np.round(16 * outline).astype(np.int32)], (170, 120, 90), cv2.LINE_AA, 4)
    cv2.rectangle(picture, (90, 30), (150, 60), (60, 60, 60), -1)
    return np.clip(cv2.GaussianBlur(picture, (0, 0), 0.8) + rng.normal(0, 2, picture.shape), 0, 255).astype(np.uint8)


@pytest.fixture(scope="module", params=[False, True], ids=["hangs", "stands"])
def filmed(request, tmp_path_factory):
    """A folder of pictures in which an arm bends and goes back, the truth of its first frame, and whether it stands."""
    folder, rng = tmp_path_factory.mktemp("film"), np.random.default_rng(3)
    bends = 0.2 + 0.9 * np.sin(np.linspace(0, np.pi, 30))
    for number, bend in enumerate(bends):
        picture = shown(bend, rng)
        cv2.imwrite(str(folder / f"{number:03d}.png"), picture[::-1] if request.param else picture)
    line = middle_of(bends[0])
    return folder, np.column_stack([line[:, 0], HEIGHT - 1 - line[:, 1]]) if request.param else line, request.param


@pytest.mark.parametrize(
    ("bends", "gravity_deg", "said"),
    [("left", 0.0, "{gravity: up}"), ("left", 180.0, "{gravity: down}"), ("left", 90.0, "{gravity: right}"),
     ("right", 90.0, "{gravity: left}"), ("right", -90.0, "{gravity: right}"), ("left", 30.0, "{gravity: {angle: 210 deg}}")],
)  # fmt: skip
def test_a_tube_that_leads_the_other_way_is_told_by_how_the_rig_is_said_to_stand(bends, gravity_deg, said):
    """One that lies, and leads to the other side than was written, was told to write that it stands."""
    scene = Scene(np.zeros(0), Actuator(bends=bends), np.array([0.0, -1.0]), 1.0, gravity_deg=gravity_deg)
    assert f"write rig: {said}" in _other_way(scene)
    assert _other_way(replace(scene, gravity_deg=None)) == ""


def test_a_film_without_hints_is_told_those_of_what_moves(filmed):
    """A resting twin is no measurement of the one that moves, and which end is held had been asked of gravity alone."""
    folder, line, stands = filmed
    source, calibration = open_frames(folder, None, 30.0), scaled_by_distance((WIDE, HEIGHT), [[0, 0], [100, 0]], 100.0)
    tube = Actuator(outer_radius=0.009, inner_radius=0.004, length=LENGTH / 1000, bends="left" if stands else "right")
    with pytest.raises(DataError, match="what was found rests, and another tube moves: point at the one that is meant") as refused:
        track_frames(source, calibration, tube, vertical="image")
    said = str(refused.value)
    assert ("leads upwards" in said) == stands
    one, other, tip = (np.array(place, dtype=float) for place in re.findall(r"\[([\d.]+), ([\d.]+)\]", said)[:3])
    assert np.linalg.norm(0.5 * (one + other) - line[0]) < 9.0
    assert np.linalg.norm(tip - line[-1]) < 9.0
    hints = Hints(clamp=(tuple(one), tuple(other)), tip=tuple(tip))
    assert track_frames(source, calibration, tube, vertical="image", hints=hints).valid.mean() > 0.95


def test_a_line_that_rests_is_none_and_one_that_runs_on_is_cut():
    """Behind the clamp of an arm another may go on in one line with it."""
    change = np.ones((100, 100), dtype=np.float32)
    change[60:] = np.linspace(1, 9, 40)[:, None]
    through = np.column_stack([np.full(90, 50.0), np.linspace(5, 95, 90)])
    resting, across = through - [0, 40], through[:, ::-1]
    moving = moving_lines([Path(path, 1, 1.0) for path in (resting, across, through[::-1])], Motion(change, 1.0), 45.0)
    assert len(moving) == 1
    short = np.column_stack([np.full(40, 50.0), np.linspace(5, 40, 40)])
    assert len(moving_lines([Path(short, 1, 1.0)], Motion(change[55:], 1.0), 35.0)) == 1
    assert moving_lines([Path(short, 1, 1.0)], Motion(change[55:], 1.0), 60.0) == []  # its clamp would be out of the picture


@pytest.mark.parametrize("width_px", [2.0, 18.0, 50_000.0])
def test_a_tube_that_is_wider_than_the_picture_by_its_scale_is_no_error(width_px):
    """Metres for millimetres had been typed."""
    frames = [(0.1 * k, np.full((48, 64), 40 * k, dtype=np.uint8)) for k in range(4)]
    motion = Motion.of(frames, 4, width_px)
    assert min(motion.change.shape) >= 16
    assert moving_lines(motion.ribbons(width_px, 5 * width_px), motion, 5 * width_px) == []
