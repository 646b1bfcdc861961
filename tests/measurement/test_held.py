"""A body whose base is carried about, in a hand or by a robot, is followed from what is seen behind its clamp."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from rfea_vision.artefacts import Actuator, Correction, Hints
from rfea_vision.calibration.scale import scaled_by_distance
from rfea_vision.errors import DataError
from rfea_vision.readers.video import open_frames
from rfea_vision.vision import track_frames
from rfea_vision.vision.body.held import HeldView
from rfea_vision.vision.show.clip import in_frame
from tests.measurement.test_gone import FOOT, HALF, RUBBER, middle_of

FRAMES, SIZE = 36, (320, 280)
LINES = [middle_of(0.3 + 0.9 * np.sin(np.linspace(0.0, 2.0 * np.pi, FRAMES))[k], 110.0) for k in range(FRAMES)]


def pose_of(k: int) -> np.ndarray:
    """Map (2, 3) of the base in frame `k`: it goes by 70 and 90 px, and turns by 0.5 rad about the clamp."""
    share = k / (FRAMES - 1)
    turned = np.column_stack([cv2.getRotationMatrix2D(FOOT.tolist(), -np.rad2deg(0.5) * share, 1.0)[:, :2], [0.0, 0.0]])
    turned[:, 2] = FOOT - turned[:, :2] @ FOOT + np.array([70.0, 90.0]) * share
    return turned


def carried(k: int, *, rests: bool = False, things=(), screws=(200, 200, 200)) -> np.ndarray:
    """A picture of a block with screws, which holds the body before a wall that stays, and of `things` before it."""
    rng = np.random.default_rng(1)
    picture = np.full((*SIZE[::-1], 3), (60, 70, 66), np.uint8)
    for x, y in rng.integers(0, 300, (40, 2)).tolist():
        cv2.rectangle(picture, (x, y), (x + 14, y + 10), rng.integers(40, 110, 3).tolist(), -1)
    seen, line = np.zeros((*SIZE[::-1], 4), np.uint8), LINES[k]
    cv2.rectangle(seen, (150, 24), (204, 96), (70, 60, 160, 255), -1)
    for x, y in ((162, 34), (190, 40), (170, 60), (192, 74), (164, 86)):
        cv2.circle(seen, (x, y), 4, (*screws, 255), -1)
    heading = np.gradient(line, axis=0)
    normal = np.column_stack([-heading[:, 1], heading[:, 0]]) / np.linalg.norm(heading, axis=1, keepdims=True)
    outline = np.vstack([line + HALF * normal, (line - HALF * normal)[::-1]])
    cv2.fillPoly(seen, [np.round(16 * outline).astype(np.int32)], (*RUBBER, 255), cv2.LINE_AA, 4)
    seen = cv2.warpAffine(seen, pose_of(0 if rests else k), SIZE, flags=cv2.INTER_LINEAR)
    cover = seen[..., 3:] / 255.0
    picture = (seen[..., :3] * (seen[..., 3:] > 0) * cover + picture * (1.0 - cover)).astype(np.uint8)
    for (left, top, right, bottom), colour in things:
        cv2.rectangle(picture, (left, top), (right, bottom), colour, -1)
    noise = np.random.default_rng(k).normal(0, 2, picture.shape)
    return np.clip(cv2.GaussianBlur(picture, (0, 0), 0.8) + noise, 0, 255).astype(np.uint8)


def film(folder: Path, pictures: list[np.ndarray], gravity_deg: float | None = 0.0, corrections=()):
    folder.mkdir()
    for k, picture in enumerate(pictures):
        cv2.imwrite(str(folder / f"{k:02d}.png"), picture)
    points = tuple((float(x), float(y)) for x, y in LINES[0][[20, 44]])
    tip = (float(LINES[0][-1, 0]), float(LINES[0][-1, 1]))
    hints = Hints(clamp=((150.0, 48.0), (150.0, 72.0)), tip=tip, centre_line=points, corrections=corrections)
    actuator = Actuator(outer_radius=HALF / 1e3, inner_radius=HALF / 2e3, length=0.11)
    calibration = scaled_by_distance(SIZE, [[10, 10], [110, 10]], 100.0)
    return track_frames(open_frames(folder, None, 20.0), calibration, actuator, hints=hints, vertical="image", gravity_deg=gravity_deg)


def test_a_body_that_is_carried_about_is_measured_from_where_it_is_held(tmp_path):
    track = film(tmp_path / "frames", [carried(k) for k in range(FRAMES)])
    tip = np.array([(line[-1] - FOOT) * [1.0, -1.0] for line in LINES])
    off = track.dataset["tip"].values - tip
    assert track.valid.mean() >= 0.95
    assert np.sqrt(np.nanmean(np.sum(off**2, axis=1))) < 0.02 * np.ptp(tip, axis=0).max()
    assert np.nanmean(np.abs(off) < 1.96 * track.dataset["tip_sigma"].values) > 0.9
    assert "is carried about" in track.dataset.attrs["advice"] and "gravity is taken to pull" in track.dataset.attrs["advice"]
    shown = in_frame(track, (LINES[-1][[-1]] + 0.0), FRAMES - 1)  # where the film shows the end
    true = LINES[-1][-1] @ pose_of(FRAMES - 1)[:, :2].T + pose_of(FRAMES - 1)[:, 2]
    assert np.linalg.norm(shown[0] - true) < 2.0


def test_where_what_holds_it_is_hidden_nothing_is_measured(tmp_path):
    hidden = {14, 15, 16}
    pictures = [carried(k, things=[((150, 40, 300, 200), (150, 170, 210))] if k in hidden else ()) for k in range(FRAMES)]
    track = film(tmp_path / "frames", pictures, gravity_deg=None)
    assert "is carried about" in track.dataset.attrs["advice"] and "gravity" not in track.dataset.attrs["advice"]
    assert not track.valid[sorted(hidden)].any() and track.valid[22:].all()


@pytest.mark.parametrize("begins", [0, 12])
def test_where_what_holds_it_looks_otherwise_one_points_at_the_body_again(tmp_path, begins):
    """Its screws are taken out. From then on it is known by what is seen behind the first click, if that is at the clamp."""
    changed = 20
    pictures = [carried(k, screws=(200, 200, 200) if k < changed else (10, 10, 10)) for k in range(FRAMES)]
    pose = pose_of(changed)
    clicks = LINES[changed][np.linspace(begins, len(LINES[0]) - 1, 5).astype(int)] @ pose[:, :2].T + pose[:, 2]
    corrections = (Correction(changed, tuple((float(x), float(y)) for x, y in np.round(clicks))),)
    track = film(tmp_path / "frames", pictures, corrections=corrections)
    off = track.dataset["tip"].values - np.array([(line[-1] - FOOT) * [1.0, -1.0] for line in LINES])
    assert track.valid[:changed].all() and track.valid[changed:].all() == (begins == 0)
    known = track.dataset["tip_sigma"].values[track.valid]
    assert np.mean(np.abs(off[track.valid]) < 1.96 * known) > 0.9


@pytest.mark.parametrize("marked", [True, False])
def test_the_pose_of_what_holds_it_is_known_as_well_as_it_says(marked):
    """Between its edges a plain bar shows only how far it went across itself: along itself, that is not known, and is said."""
    bar = np.zeros((240, 320, 3), np.uint8)
    cv2.rectangle(bar, (0, 100), (320, 130), (150, 150, 150), -1)
    for x, y in ((170, 106), (185, 122), (200, 110)) if marked else ():
        cv2.circle(bar, (x, y), 4, (240, 240, 240), -1)
    view = HeldView(np.array([[150.0, 100.0], [150.0, 130.0]]), np.array([[150.0, 115.0], [60.0, 115.0]]), 15.0)
    rng = np.random.default_rng(0)
    for k in range(12):
        map_ = np.array([[1.0, 0.0, 2.0 * k], [0.0, 1.0, 1.5 * k]])
        seen = cv2.warpAffine(bar, map_, (320, 240), borderMode=cv2.BORDER_REPLICATE)
        view.look(np.clip(cv2.GaussianBlur(seen, (0, 0), 0.8) + rng.normal(0, 2, seen.shape), 0, 255).astype(np.uint8))
    foot = np.array([150.0, 115.0])
    off = view.moved[:, :2] @ foot + view.moved[:, 2] - foot - [22.0, 16.5]
    assert view.seen and np.all(np.abs(off) < 3.0 * view.stderr[:2] + 0.05)
    assert abs(off[1]) < 0.1 and (np.abs(off) < 0.2).all() == marked == (view.stderr[0] < 1.0)


def test_a_film_whose_base_rests_is_told_nothing_of_it(tmp_path):
    """A body that something else hides for half of the film stays refused, and its base is not said to be carried about."""
    things = [((40, 20, 149, 200), (40, 160, 60))]
    with pytest.raises(DataError) as said:
        film(tmp_path / "frames", [carried(k, rests=True, things=things if k > 10 else ()) for k in range(FRAMES)])
    assert "carried" not in str(said.value) and "has moved" not in str(said.value)
