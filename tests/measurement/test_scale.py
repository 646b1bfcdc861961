"""Millimetres without a board, and hints that act."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from rfea_vision.artefacts import Actuator, Hints
from rfea_vision.calibration.projection import pixels_to_plane_mm
from rfea_vision.calibration.region import place_covariance_mm2
from rfea_vision.calibration.scale import scaled_by_distance, scaled_by_places
from rfea_vision.calibration.storage import load_calibration, save_calibration
from rfea_vision.campaign import load_campaign
from rfea_vision.campaign.scaling import calibrated_by_scale
from rfea_vision.errors import DataError, InputError
from rfea_vision.vision import track_frames
from testing.scenes import Look, film
from testing.sources import memory_source, true_calibration

SIZE = (1280, 720)
CORNERS = np.array([[0.0, 0.0], [180.0, 0.0], [180.0, 120.0], [0.0, 120.0]])


def camera_at(tilt_rad: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A camera of 1000 px focal length, tilted, and the four corners of a sheet in its picture."""
    matrix = np.array([[1000.0, 0, 639.5], [0, 1000.0, 359.5], [0, 0, 1]])
    rotation = cv2.Rodrigues(np.array([tilt_rad, 0.5 * tilt_rad, 0.0]))[0] @ np.diag([1.0, -1.0, -1.0])
    translation = np.array([-90.0, 60.0, 400.0])
    pixels = cv2.projectPoints(
        np.column_stack([CORNERS, np.zeros(4)]), cv2.Rodrigues(rotation)[0], translation, matrix, None
    )[0][:, 0]
    return matrix, pixels, np.column_stack([rotation[:, :2], translation])


def test_a_distance_sets_the_scale_and_its_error_covers_what_is_assumed():
    """A camera that is tilted by 2 degrees: what a square view makes of it is off by no more than is said."""
    _, pixels, _ = camera_at(np.radians(2.0))
    calibration = scaled_by_distance(SIZE, pixels[:2], 180.0)
    places = pixels_to_plane_mm(calibration, pixels)
    assert abs(np.linalg.norm(places[1] - places[0]) - 180.0) < 1e-6
    off = (places[2] - places[0]) - (CORNERS[2] - CORNERS[0])
    sigma = np.sqrt(np.diagonal(place_covariance_mm2(calibration, places[2:3], places[0])[0]))
    assert np.all(np.abs(off) < 3 * sigma)
    assert np.all(sigma < 0.05 * 180.0)


def reach_of(kind: str, seed: int, paper_mm: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Error (2,) of a tip as seen from its clamp, mm, and its standard error: a camera as it is assumed to be set up, at random.

    What tells the scale is printed on paper, `paper_mm` behind the plane of motion.
    """
    rng = np.random.default_rng(seed)
    focal = 0.8 * SIZE[0] * np.exp(0.25 * rng.normal())
    turn, depth = np.radians(3.0) * np.array([*rng.normal(size=2), 0.0]), focal / 4.0
    matrix = np.array([[focal, 0, 639.5], [0, focal, 359.5], [0, 0, 1]])
    pose = cv2.Rodrigues(cv2.Rodrigues(turn)[0] @ np.diag([1.0, -1.0, -1.0]))[0], np.array([0.0, 0.0, depth])
    lens = np.array([0.03 * rng.normal(), 0, 0, 0, 0])

    def seen(places, behind=0.0):
        return cv2.projectPoints(np.column_stack([places, np.full(len(places), behind)]), *pose, matrix, lens)[0][:, 0]

    behind = 0.005 * depth * rng.normal() - paper_mm
    if kind == "ruler below":
        places = np.array([[-50.0, -80.0], [50.0, -80.0]])
        read = places + np.outer([0.0, 0.5 * rng.normal()], [1.0, 0.0])
        calibration = scaled_by_distance(SIZE, seen(read, behind) + 1.5 * rng.normal(size=(2, 2)), 100.0, behind_mm=paper_mm)
    else:
        places = np.array([[-140.0, 80.0], [140.0, 80.0], [140.0, -80.0], [-140.0, -80.0]])
        read = places + 0.5 * rng.normal(size=places.shape)
        pixels = seen(read, behind) + 1.5 * rng.normal(size=places.shape)
        calibration = scaled_by_places(SIZE, pixels, places, behind_mm=paper_mm)
    tube = np.array([[0.0, 80.0], [60.0, -10.0]])
    clamp, tip = pixels_to_plane_mm(calibration, seen(tube))
    variance = place_covariance_mm2(calibration, tip[None], clamp)[0]
    return tip - clamp - (tube[1] - tube[0]), np.sqrt(np.diagonal(variance))


@pytest.mark.parametrize("paper_mm", [0.0, 15.0])
@pytest.mark.parametrize("kind", ["ruler below", "four places"])
def test_the_error_of_a_scale_without_a_board_is_what_is_said(kind, paper_mm):
    """A ruler tells the scale where it lies: a camera that is tilted sees another one at the tube. Of places, a lens that bends lines
    moves the pose. Their errors were 2.2 and 1.6 times what was said. Of marks on paper behind the tube they
    had been so much larger that what lies nearer to the camera is seen so much larger, and nothing could be said of it."""
    off, sigma = (np.array(part) for part in zip(*(reach_of(kind, seed, paper_mm) for seed in range(300)), strict=True))
    assert 0.8 < np.sqrt(np.mean((off / sigma) ** 2)) < 1.3
    assert 0.88 < np.mean(np.abs(off) < 1.96 * sigma) < 0.99


def test_places_seen_from_far_aside_are_not_turned_over():
    """By 47 degrees: y was taken to be measured downwards, and the tube was mirrored."""
    pixels = np.array([[172.0, 180.0], [438.0, 26.0], [540.0, 907.0], [54.0, 588.0]])
    places = np.array([[-65.0, 90.0], [65.0, 90.0], [65.0, -90.0], [-65.0, -90.0]])
    calibration = scaled_by_places((480, 640), pixels, places)
    np.testing.assert_allclose(pixels_to_plane_mm(calibration, pixels), places, atol=3.0)


@pytest.mark.parametrize("downwards", [False, True])
def test_four_places_give_the_perspective(downwards):
    _, pixels, plane = camera_at(np.radians(20.0))
    places = CORNERS * ([1, -1] if downwards else [1, 1])
    calibration = scaled_by_places(SIZE, pixels, places)
    middle = plane @ np.array([90.0, 60.0, 1.0])
    seen = middle[:2] / middle[2] * 1000.0 + [639.5, 359.5]
    np.testing.assert_allclose(np.abs(pixels_to_plane_mm(calibration, seen)), [90.0, 60.0], atol=0.5)
    with pytest.raises(InputError, match="places"):
        scaled_by_places(SIZE, pixels, places[[0, 2, 1, 3]])


def test_a_plane_written_by_hand_has_an_uncertainty(tmp_path):
    calibration = scaled_by_distance(SIZE, [[100, 100], [900, 100]], 200.0)
    save_calibration(tmp_path / "camera.yaml", calibration)
    text = (tmp_path / "camera.yaml").read_text().split("plane_pose_covariance")
    rest = text[1][text[1].index("intrinsics_covariance") :]
    (tmp_path / "camera.yaml").write_text(text[0] + rest)
    loaded = load_calibration(tmp_path / "camera.yaml")
    sigma = place_covariance_mm2(loaded, np.array([[50.0, 0.0]]), np.zeros(2))
    assert np.all(np.isfinite(sigma)) and np.trace(sigma[0]) > 0


CAMPAIGN = """
format: rfea-experiment/1
actuator: {outer_radius: 4 mm, length: 155 mm}
camera:
  scale: {points: [[212, 80], [230, 640]], distance: 155 mm}
  clamp: [[200, 80], [224, 80]]
  centre_line: [[215, 300]]
  region: [100, 50, 300, 640]
  exclude: [[0, 0, 60, 60]]
  colour: '#7088a0'
video: {file: video.mp4}
"""


def test_hints_stand_in_the_file(tmp_path):
    (tmp_path / "video.mp4").write_bytes(b"")
    (tmp_path / "experiment.yaml").write_text(CAMPAIGN)
    experiment = load_campaign(tmp_path).experiments[0]
    assert experiment.camera is not None and experiment.camera.scale is not None
    assert experiment.camera.scale.distance == pytest.approx(0.155)
    hints = experiment.camera.hints
    assert hints.colour == (0x70, 0x88, 0xA0)
    assert hints.region == (100, 50, 300, 640) and hints.exclude == ((0, 0, 60, 60),)
    (tmp_path / "experiment.yaml").write_text(CAMPAIGN.replace("'#7088a0'", "reddish"))
    with pytest.raises(InputError, match=r"camera\.colour.*'#rrggbb'"):
        load_campaign(tmp_path)


def test_how_far_the_marks_lie_behind_stands_in_the_file(tmp_path):
    (tmp_path / "video.mp4").write_bytes(b"")

    def depth_mm(behind):
        (tmp_path / "experiment.yaml").write_text(CAMPAIGN.replace("distance: 155 mm", f"distance: 155 mm{behind}"))
        calibration = calibrated_by_scale(load_campaign(tmp_path).experiments[0].camera, SIZE, 155.0)
        return calibration.plane_translation_mm[2], calibration.quality["note"]

    (far, _), (near, note) = depth_mm(""), depth_mm(", behind: 12 mm")
    assert near == pytest.approx(far - 12.0) and "12 mm behind the plane of motion" in note
    with pytest.raises(InputError, match=r"camera\.scale\.behind: 900 mm lead to the camera"):
        depth_mm(", behind: 900 mm")
    (tmp_path / "experiment.yaml").write_text(CAMPAIGN.replace("  clamp:", "  board_offset: -12 mm\n  clamp:"))
    with pytest.raises(InputError, match=r"camera\.board_offset: is that of a board; of a scale write 'behind'"):
        load_campaign(tmp_path)


def test_of_two_tubes_the_one_that_was_pointed_at(small_lens):
    """The same tube twice, side by side: the hints say which, and hints beside a tube find none."""
    pictures, times, shapes = film(small_lens, Look(), [4.0] * 4)
    other, _, _ = film(
        replace(small_lens, translation=small_lens.translation - [28.0, 0.0, 0.0]), Look(), [4.0] * 4, seed=5
    )
    both = [np.maximum(a, b) for a, b in zip(pictures, other, strict=True)]
    calibration = true_calibration(small_lens)
    clamp = small_lens.project(np.array([[-4.0, -3.0], [4.0, -3.0]]))
    tip = small_lens.project(shapes[0].tip[None])[0]
    hints = Hints(clamp=tuple(map(tuple, clamp)), tip=tuple(tip))
    track = track_frames(memory_source(both, times), calibration, Actuator(length=0.152), hints=hints)
    error = track.dataset["tip"].values - (shapes[0].tip - [0.0, -3.0])
    assert track.valid.all() and np.abs(error).max() < 0.4
    aside = np.array([60.0, 0.0])
    far = Hints(clamp=tuple(map(tuple, clamp + aside)), tip=tuple(tip + aside))
    with pytest.raises(DataError, match=r"off_hints|no_tube|edge_lost"):
        track_frames(memory_source(pictures, times), calibration, Actuator(), hints=far)
