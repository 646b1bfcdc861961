"""Photos as people take them: wide lenses, cameras held upright, boards misnamed, all from one direction."""

import shutil

import cv2
import numpy as np
import pytest
import yaml
from campaign.campaigns import write_campaign

from rfea_vision.calibration.board import Board
from rfea_vision.calibration.calibrate import calibrate
from rfea_vision.calibration.corners import find_corners
from rfea_vision.calibration.noise import slow_variance
from rfea_vision.calibration.photos import read_photo
from rfea_vision.calibration.placing import place_in_plane
from rfea_vision.calibration.projection import perturbed_cameras, pixels_to_plane_mm, unproject
from rfea_vision.calibration.storage import load_calibration, save_ros
from rfea_vision.campaign.check import check_campaign
from rfea_vision.errors import DataError
from testing.board_photos import RayCamera, photo, poses, texture_of

BOARD = Board("checkerboard", (9, 6), 0.012)
CHARUCO = Board("charuco", (9, 6), 0.012, 0.009, "DICT_5X5_100")
WIDE = RayCamera(
    (420, 300), np.array([[195.0, 0, 211], [0, 195.5, 148], [0, 0, 1]]), np.array([-0.02, 0.006, -0.004, 0.001]), True
)
PLAIN = RayCamera(
    (420, 300), np.array([[430.0, 0, 211], [0, 430.5, 148], [0, 0, 1]]), np.array([-0.15, 0.05, 0, 0, 0.0])
)
PLANE_POSE = cv2.Rodrigues(np.array([0.04, -0.03, 0.02]))[0], np.array([-50.0, -30.0, 150.0])


def taken(folder, camera, count, *, board=BOARD, turn_rad=0.5, distance=(200, 300), seed=0):
    """Photos on disk, and the plane photo."""
    texture, rng = texture_of(board), np.random.default_rng(seed)
    files = []
    for k, pose in enumerate(poses(camera, board, count, seed, distance=distance, turn_rad=turn_rad)):
        files.append(folder / f"board_{k:02d}.png")
        cv2.imwrite(str(files[-1]), photo(camera, board, texture, *pose, rng))
    scale = 1.0 if camera.fisheye else 1.7
    plane = folder / "plane.png"
    cv2.imwrite(str(plane), photo(camera, board, texture, PLANE_POSE[0], PLANE_POSE[1] * [1, 1, scale], rng))
    return files, plane


@pytest.fixture(scope="module")
def six(tmp_path_factory):
    """Six photos by the plain camera, and the plane photo; fewer of them are the photos that fewer would have been."""
    return taken(tmp_path_factory.mktemp("six"), PLAIN, 6)


@pytest.mark.study
def test_a_wide_lens_is_taken_for_what_it_is(tmp_path):
    files, plane = taken(tmp_path, WIDE, 11, distance=(90, 190), seed=3)
    calibration = calibrate(files, plane, BOARD, tube_length_mm=155.0)
    assert calibration.model == "fisheye"
    places = np.array([[0.0, 0.0], [60, 40], [-40, 60], [110, -20], [-60, 0]])
    pixels = WIDE.project(places, *PLANE_POSE)
    found = pixels_to_plane_mm(calibration, pixels)
    error = (found - found[0] - places * [1, -1])[1:]
    moved = np.array([unproject(camera, pixels) - found for camera in perturbed_cameras(calibration)])
    sigma = np.sqrt(np.sum((moved - moved[:, :1]) ** 2, axis=0))[1:]
    assert np.abs(error).max() < 0.05
    assert np.sqrt(np.mean((error / sigma) ** 2)) < 2.5
    region = calibration.quality["region"]
    assert region["sigma_percent_of_length"] == pytest.approx(100 * region["sigma_mm"] / 155.0)
    assert region["sigma_worst_mm"] >= region["sigma_mm"] > 0


@pytest.mark.parametrize("board", [BOARD, CHARUCO], ids=lambda board: board.kind)
def test_a_corner_is_found_to_a_hundredth_of_a_pixel(board, tmp_path):
    """Also where the board is level in the picture and every corner lies differently within its pixel."""
    rng, texture = np.random.default_rng(1), texture_of(board)
    for turn in (np.array([0.0, 0.0, 0.004]), np.array([0.3, 0.2, 0.3])):
        pose = cv2.Rodrigues(turn)[0], np.array([-50.0, -30.0, 230.0])
        view = find_corners(tmp_path / "x.png", photo(PLAIN, board, texture, *pose, rng), board)
        off = view.pixels - PLAIN.project(view.board_mm, *pose)
        if np.abs(off).max() > 3:  # a checkerboard has no names: numbered from the other end
            off = view.pixels[::-1] - PLAIN.project(view.board_mm, *pose)
        # Of a ChArUco board only the margin between square and marker, 3 px wide here, can be used.
        assert np.sqrt(np.mean(off**2)) < (0.012 if board is BOARD else 0.03)
        assert np.abs(off.mean(axis=0)).max() < (0.004 if board is BOARD else 0.015)


@pytest.mark.study
def test_photos_from_one_direction_only_are_said_to_be_so(tmp_path):
    files, plane = taken(tmp_path, PLAIN, 7, turn_rad=0.0)
    warnings = " ".join(calibrate(files, plane, BOARD).quality["warnings"])
    assert "nearly the same direction" in warnings and "turned by 20 to 40 deg" in warnings


def test_the_right_number_of_corners_is_named(six):
    files, plane = six
    with pytest.raises(DataError, match=r"inner_corners: \[7, 5\] fits 0 of 4 photos, but 4 of them show 9 x 6"):
        calibrate(files[:4], plane, Board("checkerboard", (7, 5), 0.012))


def test_squares_that_were_counted_for_corners_are_named(six):
    refused = find_corners(six[0][0], cv2.imread(str(six[0][0]), cv2.IMREAD_GRAYSCALE), Board("checkerboard", (10, 7), 0.012))
    assert refused.reason.endswith("inner_corners are those between squares, one fewer than squares each way")


def test_a_photo_for_the_lens_is_none_of_the_plane(six, tmp_path):
    """Its copy is named by its name, and one that is turned as they are is doubted."""
    files, plane = six
    folder = write_campaign(tmp_path / "tube-A")
    with (folder / "campaign.yaml").open("a") as file:
        file.write("camera:\n  board: {kind: checkerboard, inner_corners: [9, 6], square: 12 mm}\n")
        file.write(f"  photos: {files[0].parent}/board_0[012].png\n  plane: plane.png\n")
    shutil.copy(files[1], folder / "plane.png")
    said = [problem.message for problem in check_campaign(folder, trust=True).problems if problem.key == "camera.plane"]
    assert said == ["plane.png is board_01.png once more; photograph the board lying in the plane in which the tube moves"]
    lens = calibrate(files[:3], None, BOARD)
    turned = max((place_in_plane(lens, file, BOARD) for file in files), key=lambda found: found.plane_tilt_deg)
    assert turned.plane_tilt_deg > 20 and "did it lie in the plane in which the tube moves?" in turned.quality["warnings"][-1]
    assert place_in_plane(lens, plane, BOARD).quality["warnings"] == lens.quality["warnings"]


def test_a_part_of_the_board_is_not_taken_for_it(six):
    files, plane = six
    with pytest.raises(DataError, match=r"inner_corners: \[6, 5\] is a part of .* show 9 x 6 .* write \[9, 6\]"):
        calibrate(files[:3], plane, Board("checkerboard", (6, 5), 0.012))


def test_three_photos_do_and_say_that_they_are_few(six):
    files, plane = six
    calibration = calibrate(files[:3], plane, BOARD)
    assert calibration.camera_matrix[0, 0] == pytest.approx(430.0, rel=0.01)
    assert "3 photos are few" in calibration.quality["warnings"][-1]


def _with_orientation(data: bytes, orientation: int) -> bytes:
    """A JPEG file with the EXIF remark on how to show it."""
    entry = b"\x01\x12\x00\x03\x00\x00\x00\x01" + orientation.to_bytes(2, "big") + b"\x00\x00"
    tiff = b"MM\x00\x2a\x00\x00\x00\x08\x00\x01" + entry + b"\x00\x00\x00\x00"
    block = b"Exif\x00\x00" + tiff
    return data[:2] + b"\xff\xe1" + (len(block) + 2).to_bytes(2, "big") + block + data[2:]


@pytest.mark.parametrize("orientation", range(1, 9))
def test_the_remark_on_orientation_is_understood(orientation, tmp_path):
    picture = np.random.default_rng(0).integers(0, 255, (24, 40), dtype=np.uint8)
    path = tmp_path / "a.jpg"
    path.write_bytes(_with_orientation(cv2.imencode(".jpg", picture)[1].tobytes(), orientation))
    found = read_photo(path)
    assert found.sensor.shape == (24, 40)
    np.testing.assert_array_equal(found.shown(), cv2.imread(str(path), cv2.IMREAD_GRAYSCALE))


def test_photos_with_the_camera_held_upright_and_level_are_one_camera(six, tmp_path):
    """The sensor's pixels are alike; the files differ in the remark on how to show them."""
    files, plane = six
    level = calibrate(files, plane, BOARD)
    turned = []
    for k, file in enumerate([*files, plane]):
        picture = cv2.imread(str(file), 0)
        data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 98])[1].tobytes()
        turned.append(tmp_path / f"{file.stem}.jpg")
        turned[-1].write_bytes(_with_orientation(data, 6 if k % 2 == 0 else 1))  # the plane photo is upright
    upright = calibrate(turned[:-1], turned[-1], BOARD)
    assert (upright.image_width, upright.image_height) == (300, 420)
    assert all(record["used"] for record in upright.photos)
    assert upright.camera_matrix[0, 0] == pytest.approx(level.camera_matrix[1, 1], rel=2e-3)
    assert upright.camera_matrix[1, 2] == pytest.approx(level.camera_matrix[0, 2], abs=1.0)


def test_a_bent_board_widens_the_uncertainty_and_pixel_phase_does_not():
    rng = np.random.default_rng(0)
    corners = BOARD.corners_mm
    poses_of = [rng.normal(size=(108, 6)) for _ in range(8)]
    noise = [rng.normal(0, 1, (54, 2)) for _ in range(8)]
    x = (corners[:, 0] - corners[:, 0].mean()) / corners[:, 0].max()
    alternating = np.where((np.arange(54) % 9 + np.arange(54) // 9) % 2, 1.0, -1.0)[:, None]
    plain = slow_variance([corners] * 8, noise, poses_of, 9, 1.0)
    bent = slow_variance([corners] * 8, [e + 8 * (x**2)[:, None] for e in noise], poses_of, 9, 1.0)
    phase = slow_variance([corners] * 8, [e + alternating for e in noise], poses_of, 9, 1.0)
    assert plain == pytest.approx(1.0, abs=0.35)
    assert bent > 3 * plain
    assert phase == pytest.approx(plain, rel=0.25)


def test_a_ros_file_is_written_and_read_back(calibrated, tmp_path):
    calibration = calibrated[3]
    path = tmp_path / "camera_info.yaml"
    save_ros(path, calibration)
    record = yaml.safe_load(path.read_text())
    assert record["distortion_model"] == "plumb_bob"
    assert record["projection_matrix"]["cols"] == 4 and len(record["distortion_coefficients"]["data"]) == 5
    back = load_calibration(path)
    np.testing.assert_allclose(back.camera_matrix, calibration.camera_matrix)
    np.testing.assert_allclose(back.distortion, calibration.distortion)


def test_files_of_other_tools_are_read(tmp_path, shared_data):
    message = {"width": 640, "height": 480, "distortion_model": "equidistant", "d": [0.01, 0, 0, 0]}
    ros2 = tmp_path / "ros2.yaml"
    ros2.write_text(yaml.safe_dump(message | {"k": [300.0, 0, 320, 0, 301, 240, 0, 0, 1]}))
    assert load_calibration(ros2).model == "fisheye"
    assert load_calibration(ros2).camera_matrix[1, 1] == 301
    xml = tmp_path / "opencv.xml"
    storage = cv2.FileStorage(str(xml), cv2.FILE_STORAGE_WRITE)
    for name, value in (
        ("image_width", 640),
        ("image_height", 480),
        ("Camera_Matrix", np.array([[500.0, 0, 320], [0, 501, 240], [0, 0, 1]])),
    ):
        storage.write(name, value)
    storage.write("Distortion_Coefficients", np.array([[-0.1, 0.02, 0, 0, 0]]))
    storage.release()
    assert load_calibration(xml).distortion[0] == -0.1
    stereo = load_with_size(shared_data / "boards-640x480" / "intrinsics.yml", tmp_path)
    assert stereo.camera_matrix[0, 0] == pytest.approx(533, abs=10)


def load_with_size(path, folder):
    """OpenCV's stereo sample writes no picture size: add it, as the error message asks."""
    from rfea_vision.errors import InputError

    with pytest.raises(InputError, match="image_width is missing"):
        load_calibration(path)
    text = path.read_text()
    head, rest = text.split("\n", 1)
    copy = folder / "sized.yml"
    copy.write_text(f"{head}\n" + rest.replace("---\n", "---\nimage_width: 640\nimage_height: 480\n", 1))
    return load_calibration(copy)
