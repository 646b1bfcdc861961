"""Pictures lie where they should: exact coverage, true time stamps, a board that gives the camera back."""

from __future__ import annotations

from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from rfea_vision.twin import TwinOptions
from rfea_vision.twin.coverage import coverage
from rfea_vision.twin.draw import build_plant, posture_at
from rfea_vision.twin.renderer import Scenery, blurred, frames, tube_outline_mm
from rfea_vision.twin.studio import CheckerBoard, Studio, board_poses, photograph, write_video


def rectangle(left: float, top: float, right: float, bottom: float) -> np.ndarray:
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom]])


@pytest.mark.parametrize("blur_px", [0.0, 0.8])
def test_edges_of_a_rectangle_lie_within_a_hundredth_of_a_pixel(blur_px: float) -> None:
    random = np.random.default_rng(1)
    for _ in range(20):
        left, top = random.uniform(10, 20, 2)
        right, bottom = random.uniform(40, 50, 2)
        picture = coverage([rectangle(left, top, right, bottom)], 0, 0, 64, 64)
        picture = blurred(picture, blur_px) if blur_px else picture
        across, down = picture[30], picture[:, 30]
        # an edge is where the light up to the middle of the rectangle has been gathered
        assert 30.5 - across[:31].sum() == pytest.approx(left, abs=0.01)
        assert 30.5 + across[31:].sum() == pytest.approx(right, abs=0.01)
        assert 30.5 - down[:31].sum() == pytest.approx(top, abs=0.01)
        assert 30.5 + down[31:].sum() == pytest.approx(bottom, abs=0.01)


def test_a_turned_rectangle_keeps_area_and_centre_and_direction_does_not_matter() -> None:
    angle = 0.6
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    corners = rectangle(-9, -4, 9, 4) @ turn.T + [25.3, 21.8]
    picture = coverage([corners], 0, 0, 50, 45)
    assert picture.sum() == pytest.approx(18 * 8, abs=1e-3)
    y, x = np.mgrid[:45, :50]
    centre = [(picture * x).sum() / picture.sum(), (picture * y).sum() / picture.sum()]
    assert centre == pytest.approx([25.3, 21.8], abs=2e-3)
    assert np.allclose(picture, coverage([corners[::-1]], 0, 0, 50, 45), atol=1e-6)


def test_a_polygon_beyond_the_window_is_cut_and_not_moved() -> None:
    whole = coverage([rectangle(-30.3, -7.7, 41.2, 22.9)], -40, -20, 100, 60)
    part = coverage([rectangle(-30.3, -7.7, 41.2, 22.9)], 0, 0, 30, 20)
    assert np.allclose(part, whole[20:40, 40:70], atol=1e-6)


@pytest.fixture(scope="module")
def studio() -> Studio:
    options = TwinOptions(seed=5, joints=16, frame_size=(180, 320), dark_tube=True, photos=12)
    plant, _ = build_plant(options)
    motion = plant.run(lambda time: np.full_like(time, 1.5e5), 0.0, 0.02)
    return Studio(options, [posture_at(plant, motion, np.linspace(0.0, 0.02, 4))])


def test_tube_in_the_picture_has_its_width_and_place(studio: Studio) -> None:
    options = studio.options
    plant, _ = build_plant(options)
    motion = plant.run(lambda time: np.full_like(time, 0.0), 0.0, 0.02)
    posture = posture_at(plant, motion, np.array([0.0]))
    plain = Scenery(200.0, 200.0, 40.0, 40.0, np.ones((320, 180), np.float32), studio.scene.clamp_mm, 0.8, 0.0)
    picture = next(frames(studio.camera, plain, posture, np.random.default_rng(0), np.zeros(1))).astype(float)
    dark = (200.0 - picture) / 160.0
    row = 200
    edges = studio.camera.project_plane(tube_outline_mm(posture, 3.0))[0]
    count = edges.shape[0] // 2
    places = [np.interp(row, side[:, 1], side[:, 0]) for side in (edges[:count], edges[count:][::-1])]
    columns = np.arange(180)
    assert dark[row].sum() == pytest.approx(abs(places[0] - places[1]), abs=0.03)  # grey levels are whole numbers
    assert (dark[row] * columns).sum() / dark[row].sum() == pytest.approx(np.mean(places), abs=0.02)


def test_camera_agrees_with_opencv(studio: Studio) -> None:
    points = np.random.default_rng(2).uniform([-100, -160], [20, 10], (50, 2))
    space = np.column_stack([points, np.zeros(50)])
    camera = studio.camera
    rotation, _ = cv2.Rodrigues(camera.rotation)
    expected, _ = cv2.projectPoints(space, rotation, camera.translation, camera.matrix, camera.distortion)
    assert camera.project_plane(points) == pytest.approx(expected[:, 0], abs=1e-6)


def test_boards_vary_and_are_wholly_in_the_picture(studio: Studio) -> None:
    board = CheckerBoard(9, 6, 9.0)
    poses = board_poses(studio.camera, board, 12, np.random.default_rng(3))
    sheets = np.array([pose(board.outline()) for pose in poses])
    assert sheets.min() > 0
    assert np.all(sheets.max(axis=(0, 1)) < [180, 320])
    assert np.ptp(sheets.mean(axis=1)[:, 1]) > 60
    picture = photograph(studio.scene, poses[0], board, (180, 320), np.random.default_rng(4))
    assert picture.shape == (320, 180)


def test_corners_of_a_photographed_board_lie_where_they_were_put() -> None:
    options = TwinOptions(seed=6, joints=16, frame_size=(720, 1280))
    plant, _ = build_plant(options)
    motion = plant.run(lambda time: np.full_like(time, 1.5e5), 0.0, 0.02)
    studio = Studio(options, [posture_at(plant, motion, np.array([0.0]))])
    pose = board_poses(studio.camera, studio.board, 1, np.random.default_rng(3))[0]
    picture = photograph(studio.scene, pose, studio.board, (720, 1280), np.random.default_rng(4))
    found, corners = cv2.findChessboardCornersSB(picture, (9, 6), flags=cv2.CALIB_CB_ACCURACY)
    assert found
    grid = np.array([[x, y] for y in range(6) for x in range(9)]) * studio.board.square_mm
    error = min(np.abs(corners.reshape(-1, 2) - pose(order)).max() for order in (grid, grid[::-1]))
    assert error < 0.15


def test_video_has_true_time_stamps_and_size(tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    pictures = [random.integers(0, 255, (64, 48), dtype=np.uint8) for _ in range(9)]
    write_video(tmp_path / "a.mp4", iter(pictures), np.arange(len(pictures)) / 240.0, (48, 64), 10)
    with av.open(str(tmp_path / "a.mp4")) as container:
        decoded = list(container.decode(video=0))
    assert [frame.time for frame in decoded] == pytest.approx(np.arange(9) / 240)
    assert (decoded[0].width, decoded[0].height) == (48, 64)
    assert np.abs(decoded[4].to_ndarray(format="gray").astype(float) - pictures[4]).mean() < 4
