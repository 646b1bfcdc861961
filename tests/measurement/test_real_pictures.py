"""Pictures made by others: board photos, a tube, a strip, worms."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.interpolate import splev, splprep

from rfea_vision.artefacts import Actuator, Hints
from rfea_vision.calibration.board import Board
from rfea_vision.calibration.calibrate import calibrate
from rfea_vision.calibration.scale import scaled_by_distance
from rfea_vision.errors import DataError
from rfea_vision.readers.video import open_video
from rfea_vision.vision import track_frames
from rfea_vision.vision.body.begin import smooth_line
from rfea_vision.vision.body.ways import middle_way
from rfea_vision.vision.find.begin import beside
from testing.sources import memory_source

from .rebent import rebent_film


def test_board_photos_of_1280_x_720(shared_data: Path):
    photos = sorted((shared_data / "boards-1280x720" / "camera_cal").glob("*.jpg"))
    calibration = calibrate(photos, None, Board("checkerboard", (9, 6), 0.025))
    used = [p for p in calibration.photos if p["used"]]
    refused = {p["file"]: p["reason"] for p in calibration.photos if not p["used"]}
    assert len(photos) == 20 and len(used) == 17
    assert set(refused) == {"calibration1.jpg", "calibration4.jpg", "calibration5.jpg"}
    assert all("incomplete" in reason for reason in refused.values())
    fx, fy = calibration.camera_matrix[0, 0], calibration.camera_matrix[1, 1]
    cx, cy = calibration.camera_matrix[0, 2], calibration.camera_matrix[1, 2]
    assert abs(fx - 1157) < 6 and abs(fy - 1151) < 6
    assert abs(cx - 670) < 8 and abs(cy - 388) < 8


def test_board_photos_of_640_x_480(shared_data: Path):
    photos = [p for p in sorted((shared_data / "boards-640x480").glob("left*.jpg")) if "left10" not in p.name]
    calibration = calibrate(photos, None, Board("checkerboard", (9, 6), 0.025))
    matrix = calibration.camera_matrix
    found = [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]]
    sigma = np.sqrt(np.diag(calibration.intrinsics_covariance))[:4]
    assert sum(p["used"] for p in calibration.photos) == 13
    np.testing.assert_allclose(found, [532.8, 532.9, 342.5, 233.9], atol=1.0)
    assert np.all(np.abs(np.array(found) - [532.8, 532.9, 342.5, 233.9]) < 3 * sigma)
    assert 0.15 < calibration.rms_px < 0.2


def test_photos_of_two_cameras_are_told_apart_by_size(shared_data: Path):
    photos = [*sorted((shared_data / "boards-640x480").glob("left0*.jpg"))[:5]]
    photos += [shared_data / "boards-1280x720" / "camera_cal" / "calibration2.jpg"]
    calibration = calibrate(photos, None, Board("checkerboard", (9, 6), 0.025))
    refused = [p for p in calibration.photos if not p["used"]]
    assert len(refused) == 1
    assert "another size: 1280 x 720 px" in refused[0]["reason"]


def test_the_bending_tube_goes_through_the_tracker(shared_data: Path):
    """The photograph as a film of three frames, its clamp, tip and three points of it pointed at: the author's angle."""
    picture = cv2.imread(str(shared_data / "bending-tube-photo" / "img" / "source" / "P070.JPG"))
    small = cv2.resize(picture, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
    grey = cv2.cvtColor(small, cv2.COLOR_BGR2GRAY)
    noise = np.random.default_rng(0).normal(0, 2, (3, *grey.shape))
    frames = [np.clip(grey + layer, 0, 255).astype(np.uint8) for layer in noise]
    # 0.2 mm to a pixel: a length that fits the tube's diameter; the author gives no scale
    calibration = scaled_by_distance((grey.shape[1], grey.shape[0]), [[100, 100], [600, 100]], 100.0)
    actuator = Actuator(outer_radius=5e-3, inner_radius=3e-3, length=94.5e-3)
    line = ((545, 430), (430, 372), (310, 425))
    hints = Hints(clamp=((525, 503), (575, 503)), tip=(221, 514), centre_line=line)
    source = memory_source(frames, [0.0, 0.04, 0.08])
    track = track_frames(source, calibration, actuator, hints=hints, vertical="image")
    assert track.valid.all()
    last = np.diff(track.dataset["midline"].values[:, [-4, -1]], axis=1)[:, 0]
    from_upright = np.degrees(np.arccos(last[:, 1] / np.linalg.norm(last, axis=1)))  # the tube stands in its clamp
    assert np.abs(from_upright - 136.0).max() < 5.0


def test_the_bending_tube_is_followed_through_a_film(shared_data: Path, tmp_path: Path):
    """The photographed tube, cut out and bent back and forth before its own wall: its skin, its threads, its blue end."""
    picture = cv2.imread(str(shared_data / "bending-tube-photo" / "img" / "source" / "P070.JPG"))
    small = cv2.resize(picture, (500, 374), interpolation=cv2.INTER_AREA)
    centre = [(549, 512), (548, 480), (543, 440), (528, 408), (500, 382), (470, 371), (430, 370), (390, 376)]
    centre += [(350, 392), (318, 416), (290, 443), (262, 472), (240, 496), (222, 514)]  # by hand, at twice the size
    spline, _ = splprep(0.5 * np.array(centre, dtype=float).T, s=1.0)
    dense = np.array(splev(np.linspace(0, 1, 2000), spline)).T
    line = dense[np.searchsorted(_along(dense), np.linspace(0, 1, 400)).clip(0, len(dense) - 1)]
    bends = 0.625 + 0.375 * np.cos(np.linspace(0, 2 * np.pi, 30))
    lines = rebent_film(tmp_path / "film.mp4", small, line, np.full(400, 12.5), bends)
    source = open_video(tmp_path / "film.mp4")
    calibration = scaled_by_distance(source.size, [[50, 50], [300, 50]], 100.0)
    length = 0.4e-3 * np.linalg.norm(np.diff(line, axis=0), axis=1).sum()
    hints = Hints(clamp=((262.5, 254.0), (287.0, 254.0)), tip=(112.0, 256.0))
    actuator = Actuator(outer_radius=5e-3, inner_radius=3e-3, length=float(length))
    track = track_frames(source, calibration, actuator, hints=hints, vertical="image")
    truth = (lines[:, -1] - lines[:, 0]) * [0.4, -0.4]
    off = np.linalg.norm(track.dataset["tip"].values - truth, axis=1)
    assert track.valid.mean() >= 0.95
    assert np.sqrt(np.nanmean(off**2)) < 0.02 * np.ptp(truth, axis=0).max()
    assert np.mean(off[track.valid] < 2.5 * track.dataset["tip_sigma"].values.max(axis=1)[track.valid]) > 0.95


def _along(line: np.ndarray) -> np.ndarray:
    steps = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    return steps / steps[-1]


def test_worms_go_through_the_tracker(shared_data: Path):
    """Single pictures as still films: head, tail and three points of the worm pointed at. Where it answers, it lies on it."""
    h5py = pytest.importorskip("h5py")
    folder = shared_data / "worm-midlines" / "datasets" / "sample_data"
    with h5py.File(folder / "features.h5") as file:
        skeletons, widths = file["skeletons"][:], file["width"][:]
    open_ones = np.flatnonzero(~np.isnan(skeletons).any(axis=(1, 2)))
    gaps = []
    for number in np.random.default_rng(1).choice(open_ones, 6, replace=False):
        grey = cv2.copyMakeBorder(cv2.imread(str(folder / f"{number:05d}.png"), 0), *[6] * 4, cv2.BORDER_REPLICATE)
        large = cv2.resize(grey, None, fx=4, fy=4, interpolation=cv2.INTER_CUBIC)
        line, half = (skeletons[number] + 6.5) * 4 - 0.5, 2.0 * widths[number]
        along = line[6] - line[2]
        across = half[4] * np.array([-along[1], along[0]]) / np.linalg.norm(along)
        points = [tuple(map(float, line[k])) for k in (14, 26, 38)]
        ends = tuple(map(float, line[4] - across)), tuple(map(float, line[4] + across))
        hints = Hints(clamp=ends, tip=(float(line[-3, 0]), float(line[-3, 1])), centre_line=tuple(points))  # pyright: ignore
        length = np.linalg.norm(np.diff(line[4:-2], axis=0), axis=1).sum()
        radius = 1e-4 * float(np.median(half[4:-4]))  # 10 px are called 1 mm
        actuator = Actuator(outer_radius=radius, inner_radius=radius / 2, length=1e-4 * float(length))
        calibration = scaled_by_distance((large.shape[1], large.shape[0]), [[10, 10], [110, 10]], 10.0)
        noise = np.random.default_rng(0).normal(0, 2, (2, *large.shape))
        frames = [np.clip(large + layer, 0, 255).astype(np.uint8) for layer in noise]
        try:
            source = memory_source(frames, [0.0, 0.04])
            track = track_frames(source, calibration, actuator, hints=hints, vertical="image")
        except DataError:
            continue
        found = track.dataset["midline"].values[0] * [10, -10] + line[4]
        gaps.append(np.median(np.linalg.norm(found[:, None] - line[None], axis=-1).min(axis=1)) / 4)
    assert len(gaps) >= 5
    assert max(gaps) < 1.0  # px of the pictures; the worms are 9.5 px wide


def test_the_bent_strip_is_read_where_it_was_drawn(shared_data: Path):
    """Its lit edge, 18 px wide, runs along its own dim face: the line through five points drawn on it is found between them, too."""
    folder = shared_data / "bent-strip-photo" / "test"
    picture = cv2.imread(str(folder / "test_image.jpg"), cv2.IMREAD_GRAYSCALE)
    reference = np.load(folder / "test_results_decoded.npz")
    line = [0.0, 200.9] + np.column_stack([reference["x_m"], -reference["y_m"]]) / 0.1101e-3
    across = np.array([-0.28, 0.96]) * 9.0
    points = tuple((float(x), float(y)) for x, y in line[[12, 24, 36, -1]])
    ends = tuple(map(float, line[3] - across)), tuple(map(float, line[3] + across))
    hints = Hints(clamp=ends, tip=points[-1], centre_line=points[:-1])  # pyright: ignore[reportArgumentType]
    calibration = scaled_by_distance((picture.shape[1], picture.shape[0]), [[100, 100], [600, 100]], 55.05)
    actuator = Actuator(outer_radius=1e-3, inner_radius=0.5e-3, length=0.235)
    noise = np.random.default_rng(0).normal(0, 2, (2, *picture.shape))
    frames = [np.clip(picture + layer, 0, 255).astype(np.uint8) for layer in noise]
    track = track_frames(
        memory_source(frames, [0.0, 0.04]), calibration, actuator, hints=hints, vertical="image"
    ).dataset
    assert track["valid"].values.tolist() == [1, 1]
    clamp = np.array([track.attrs["clamp_px_x"], track.attrs["clamp_px_y"]])
    found = clamp + track["midline"].values * [1, -1] * track.attrs["px_per_mm"]
    gaps = np.array([[beside(line, point) for point in own] for own in found])
    assert np.median(gaps) < 1.5 and np.all(gaps < 9.0)  # px: the strip reaches 9 to either side of its middle
    assert np.all(gaps < 3.0 * track["midline_sigma"].values * track.attrs["px_per_mm"])
    assert np.all(np.linalg.norm(found[:, -1] - line[-1], axis=1) < 9.0)


def test_the_way_through_a_mask_of_a_worm_is_its_published_midline(shared_data: Path):
    h5py = pytest.importorskip("h5py")
    folder, gaps = shared_data / "worm-midlines" / "datasets" / "sample_data", []
    with h5py.File(folder / "features.h5") as file:
        skeletons = file["skeletons"][:]
    for number in range(0, 1000, 25):
        published = skeletons[number]
        if np.isnan(published).any():  # it is coiled
            continue
        soft = cv2.GaussianBlur(cv2.imread(str(folder / f"{number:05d}.png"), cv2.IMREAD_GRAYSCALE), (0, 0), 1.0)
        _, mask = cv2.threshold(soft, 0, 1, cv2.THRESH_BINARY_INV | cv2.THRESH_OTSU)
        places = np.argwhere(mask)
        row, column = places[np.argmin(np.linalg.norm(places[:, ::-1] - published[0], axis=1))].tolist()
        way = middle_way(np.asarray(mask, dtype=np.uint8), (row, column), 4.7)
        assert way is not None
        gaps.append(np.median(np.linalg.norm(smooth_line(way)[:, None] - published[None], axis=-1).min(axis=1)))
    assert len(gaps) > 20
    assert np.median(gaps) <= 1.0
    assert np.max(gaps) <= 1.5
