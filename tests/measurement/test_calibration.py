"""Calibration against rendered photos of a known lens."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from rfea_vision.artefacts.lenses import LENSES
from rfea_vision.calibration.board import Board
from rfea_vision.calibration.bundle import Lens, first_lens, project_board
from rfea_vision.calibration.calibrate import calibrate
from rfea_vision.calibration.corners import BoardView
from rfea_vision.calibration.projection import (
    pack_camera,
    perturbed_cameras,
    pixels_to_plane_mm,
    plane_mm_to_pixels,
    project,
    unproject,
)
from rfea_vision.calibration.storage import load_calibration, save_calibration
from rfea_vision.errors import DataError, InputError


def test_lens_and_plane_are_found_within_their_errors(calibrated, small_lens):
    _, _, _, calibration = calibrated
    sigma = np.sqrt(np.diag(calibration.intrinsics_covariance))[:4]
    true = small_lens.matrix
    found = calibration.camera_matrix
    for k, (row, column) in enumerate([(0, 0), (1, 1), (0, 2), (1, 2)]):
        assert abs(found[row, column] - true[row, column]) < 4 * sigma[k] + 0.05
    assert calibration.model == "brown5"
    assert calibration.rms_px < 0.08
    # Distances on the plane: the origin of the board is not the rig's, so differences count.
    rig = np.array([[0.0, 0.0], [-100.0, -60.0], [-20.0, -150.0], [10.0, -80.0]])
    plane = pixels_to_plane_mm(calibration, small_lens.project(rig))
    np.testing.assert_allclose(plane - plane[0], rig, atol=0.15)
    tilt = np.degrees(np.arccos(small_lens.rotation[2, 2]))
    assert abs(calibration.plane_tilt_deg - tilt) < 0.2


def test_the_lens_from_which_the_search_begins_is_the_same_to_the_last_bit_every_time():
    """OpenCV's threads add up the photos in any order: of eight first lenses some four differed, and all that follows with them."""
    rng, lens = np.random.default_rng(5), Lens("brown5", np.array([[500.0, 0, 320], [0, 501, 240], [0, 0, 1]]), np.zeros(5))
    flat = np.stack(np.meshgrid(np.arange(9) * 12.0, np.arange(6) * 12.0), axis=-1).reshape(-1, 2)
    views = []
    for turn in rng.uniform(-0.5, 0.5, (14, 3)):
        pixels = project_board(lens, np.eye(3), np.array([-40.0, -30.0, 220.0]), flat, turn)[0]
        views.append(BoardView(Path("photo.png"), flat, pixels + rng.normal(0, 0.05, pixels.shape)))
    threads = cv2.getNumThreads()
    found = {first_lens(views, (640, 480), "brown5").vector.tobytes() for _ in range(8)}
    assert len(found) == 1 and cv2.getNumThreads() == threads


def test_pixels_and_millimetres_are_inverse(calibrated):
    calibration = calibrated[3]
    grid = np.stack(np.meshgrid(np.linspace(5, 350, 6), np.linspace(5, 630, 6)), axis=-1)
    np.testing.assert_allclose(plane_mm_to_pixels(calibration, pixels_to_plane_mm(calibration, grid)), grid, atol=1e-6)


def test_projection_agrees_with_opencv(calibrated):
    calibration = calibrated[3]
    points = np.array([[0.0, 0.0], [-80.0, 20.0], [30.0, -120.0]])
    world = np.column_stack([points, np.zeros(3)])
    vector = cv2.Rodrigues(calibration.plane_rotation)[0]
    expected, _ = cv2.projectPoints(
        world, vector, calibration.plane_translation_mm, calibration.camera_matrix, calibration.distortion
    )
    np.testing.assert_allclose(plane_mm_to_pixels(calibration, points), expected[:, 0], atol=1e-9)


def test_uncertainty_grows_away_from_the_photos(calibrated):
    calibration = calibrated[3]
    pixels = np.array([[180.0, 320.0], [2.0, 637.0]])
    here = pixels_to_plane_mm(calibration, pixels)
    moved = np.array([unproject(camera, pixels) - here for camera in perturbed_cameras(calibration)])
    middle, corner = np.sum(moved**2, axis=(0, 2))
    assert 0 < middle < corner
    halves = calibration.quality["cross_validation"]
    assert halves["ratio"] < 3 and halves["inflation"] == 1.0
    # of 2.6 times what is expected it was said that it is "the same within its uncertainty"
    assert "chance alone puts them as far apart in" in halves["sentence"] and "so nothing is scaled up" in halves["sentence"]


def test_board_offset_moves_the_plane(calibrated):
    photos, plane, board, calibration = calibrated
    nearer = calibrate(photos, plane, board, board_offset_mm=5.0)
    away = np.linalg.norm(nearer.plane_translation_mm) - np.linalg.norm(calibration.plane_translation_mm)
    # The printed face lies 5 mm in front of the axis, so the plane of motion lies farther from the camera.
    assert 3.5 < away < 5.5


def test_file_opens_elsewhere_and_comes_back(calibrated, tmp_path):
    calibration = calibrated[3]
    path = tmp_path / "camera.yaml"
    save_calibration(path, calibration)
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    np.testing.assert_allclose(storage.getNode("camera_matrix").mat(), calibration.camera_matrix)
    assert int(storage.getNode("image_width").real()) == calibration.image_width
    storage.release()
    back = load_calibration(path)
    np.testing.assert_allclose(back.distortion, calibration.distortion)
    np.testing.assert_allclose(back.joint_covariance, calibration.joint_covariance)
    assert back.photos == calibration.photos
    assert back.quality["lens_reason"] == calibration.quality["lens_reason"]


def test_a_ros_file_is_read(tmp_path):
    path = tmp_path / "ros.yaml"
    matrix = {"rows": 3, "cols": 3, "data": [900.0, 0, 320, 0, 905, 240, 0, 0, 1]}
    distortion = {"rows": 1, "cols": 5, "data": [-0.2, 0.1, 0, 0, 0]}
    text = yaml.safe_dump(
        {
            "image_width": 640,
            "image_height": 480,
            "camera_matrix": matrix,
            "distortion_model": "plumb_bob",
            "distortion_coefficients": distortion,
        }
    )
    path.write_text(text)
    calibration = load_calibration(path)
    assert calibration.camera_matrix[0, 0] == 900
    assert calibration.model == "brown5"
    with pytest.raises(InputError, match=r"camera\.plane"):
        pixels_to_plane_mm(calibration, np.zeros(2))


def test_bad_photos_are_named_with_the_reason(calibrated, tmp_path):
    photos, plane, board, _ = calibrated
    good = cv2.imread(str(photos[0]), 0)
    bad = {
        "small.png": cv2.resize(good, None, fx=0.5, fy=0.5),
        "blurred.png": cv2.GaussianBlur(good, (0, 0), 6),
        "empty.png": np.full_like(good, 90),
    }
    for name, picture in bad.items():
        cv2.imwrite(str(tmp_path / name), picture)
    calibration = calibrate([*photos, *(tmp_path / name for name in bad)], plane, board)
    reasons = {p["file"]: p["reason"] for p in calibration.photos if not p["used"]}
    assert set(reasons) == set(bad)
    assert "another size" in reasons["small.png"]
    assert "blurred" in reasons["blurred.png"]
    assert "no board" in reasons["empty.png"]


def test_too_few_photos_and_wrong_plane_are_errors(calibrated, tmp_path):
    photos, plane, board, _ = calibrated
    with pytest.raises(DataError, match="3 are needed"):
        calibrate(photos[:2], plane, board)
    small = tmp_path / "plane.png"
    cv2.imwrite(str(small), cv2.resize(cv2.imread(str(plane)), None, fx=0.5, fy=0.5))
    with pytest.raises(InputError, match=r"camera\.plane"):
        calibrate(photos, small, board)
    with pytest.raises(InputError, match=r"camera\.lens"):
        calibrate(photos, plane, board, lens="wide")


def test_charuco_boards_may_be_cut_off(tmp_path):
    board = Board("charuco", (8, 5), 0.02, 0.015, "DICT_5X5_100")
    flat = board.charuco().generateImage((1080, 720), marginSize=30)
    rng = np.random.default_rng(0)
    paths = []
    for k in range(8):
        a = rng.uniform(-0.12, 0.12, 8) * 400
        corners = np.float32([[0, 0], [1080, 0], [1080, 720], [0, 720]])
        shown = np.float32(
            [[-80, 60], [600, 80], [620, 420], [-60, 440]] if k == 0 else [[60, 60], [580, 60], [580, 420], [60, 420]]
        )
        warp = cv2.getPerspectiveTransform(corners, shown + np.float32(a.reshape(4, 2)) * (k > 0))
        picture = cv2.warpPerspective(flat, warp, (640, 480), flags=cv2.INTER_AREA, borderValue=128)
        paths.append(tmp_path / f"{k}.png")
        cv2.imwrite(str(paths[-1]), cv2.GaussianBlur(picture, (0, 0), 0.7))
    from rfea_vision.calibration.calibrate import find_views

    views, refused, size = find_views(paths, board, None)
    assert size == (640, 480)
    assert len(views) == 8 and not refused
    partial = next(v for v in views if v.file == paths[0])
    assert 8 <= len(partial.pixels) < 40


TRUE_COEFFICIENTS = {
    "brown5": [-0.25, 0.08, 1e-3, -5e-4, 0.01],
    "brown8": [-0.25, 0.08, 1e-3, -5e-4, 0.01, 0.02, -0.01, 0.0],
    "brown12": [-0.25, 0.08, 1e-3, -5e-4, 0.01, 0.02, -0.01, 0.0, 4e-3, -2e-3, -3e-3, 1e-3],
    "fisheye": [-0.02, 0.01, -0.004, 0.001],
}


@pytest.mark.parametrize("model", LENSES)
def test_every_lens_model_fits_points_made_with_it_and_is_the_same_compiled(model):
    from rfea_vision.calibration.bundle import Lens, project_board, solve_bundle
    from rfea_vision.calibration.corners import BoardView
    from rfea_vision.calibration.projection import lens_vector, pack_camera, project, rotation_matrix

    rng = np.random.default_rng(2)
    coefficients = np.array(TRUE_COEFFICIENTS[model])
    assert len(coefficients) == LENSES[model].coefficients
    lens = Lens(model, np.array([[520.0, 0, 640], [0, 522, 360], [0, 0, 1]]), coefficients)
    board = Board("checkerboard", (9, 6), 0.02)
    views = []
    while len(views) < 16:
        rotation = rotation_matrix(rng.uniform(-0.5, 0.5, 3))
        translation = np.array([rng.uniform(-150, 30), rng.uniform(-110, 10), rng.uniform(130, 260)])
        pixels = project_board(lens, rotation, translation, board.corners_mm)[0]
        if pixels.min() < 0 or np.any(pixels.max(axis=0) > [1280, 720]):
            continue
        compiled = project(pack_camera(model, lens_vector(lens.matrix, coefficients), rotation, translation), board.corners_mm)
        np.testing.assert_allclose(compiled, pixels, atol=1e-9)
        views.append(BoardView(None, board.corners_mm, pixels + rng.normal(0, 0.02, pixels.shape)))
    bundle = solve_bundle(views, (1280, 720), model, joint_view=0)
    assert bundle.sigma_px < 0.03
    sigma = np.sqrt(np.diag(bundle.lens_covariance))[:4]
    assert np.all(np.abs(bundle.lens.vector[:4] - lens.vector[:4]) < 5 * sigma + 0.02)


def test_nothing_is_seen_beyond_the_horizon():
    """A camera that looks along the plane: a pixel above the horizon is that of a place behind it, and of none before it."""
    tilt = np.radians(60.0)
    turned = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    camera = pack_camera("brown5", np.array([800.0, 800.0, 320.0, 240.0]), turned, np.array([0.0, 0.0, 500.0]))
    seen = project(camera, [[0.0, 50.0]])
    np.testing.assert_allclose(unproject(camera, seen), [[0.0, 50.0]], atol=1e-6)
    horizon = 240 + 800 * turned[1, 1] / turned[2, 1]
    beyond = unproject(camera, [[320.0, horizon + 50.0 * np.sign(horizon - seen[0, 1])]])
    assert np.isnan(beyond).all()
