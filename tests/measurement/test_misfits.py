"""Real board photos, spoilt in the ways that people spoil them: left out and named, and the lens is as before."""

import cv2
import numpy as np
import pytest

from rfea_vision.calibration.board import Board
from rfea_vision.calibration.calibrate import calibrate
from rfea_vision.errors import DataError

BOARD = Board("checkerboard", (9, 6), 0.025)
Y, X = np.mgrid[:480, :640].astype(np.float32)
SPOILT = {
    "left03": (lambda grey: np.rot90(grey, 2), "turned by half against the others"),
    "left05": (lambda grey: np.rot90(grey), "480 x 640 px, the others have 640 x 480: turned by a quarter"),
    "left08": (lambda grey: cv2.remap(grey, X + 6 * np.sin(Y / 80), Y, cv2.INTER_LINEAR), "fits far worse than"),
    "left11": (lambda grey: cv2.resize(grey[36:-36, 48:-48], (640, 480)), "zoom, focus or camera were others"),
    "left12": (lambda grey: cv2.GaussianBlur(grey, (0, 0), 6.0), "blurred: its edges rise over"),
    "left13": (lambda grey: (0.03 * grey).astype(np.uint8), "too dark"),
}


@pytest.fixture(scope="module")
def board_photos(shared_data):
    files = sorted((shared_data / "boards-640x480").glob("left*.jpg"))
    return {file.stem: cv2.imread(str(file), cv2.IMREAD_GRAYSCALE) for file in files if "left10" not in file.name}


def written(folder, pictures):
    files = [folder / f"{name}.png" for name in pictures]
    for file, picture in zip(files, pictures.values(), strict=True):
        cv2.imwrite(str(file), picture)
    return files


@pytest.mark.study
def test_spoilt_photos_are_left_out_and_named(board_photos, tmp_path):
    pictures = {name: SPOILT[name][0](grey) if name in SPOILT else grey for name, grey in board_photos.items()}
    pictures["left99"] = board_photos["left01"]
    found = calibrate(written(tmp_path, pictures), None, BOARD)
    reasons = {record["file"][:6]: record["reason"] for record in found.photos if not record["used"]}
    assert set(reasons) == {*SPOILT, "left99"}
    for name, (_, said) in SPOILT.items():
        assert said in reasons[name]
    assert reasons["left99"] == "the same picture as left01.png"
    matrix, sigma = found.camera_matrix, np.sqrt(np.diag(found.intrinsics_covariance))
    off = np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]]) - [532.8, 532.9, 342.5, 233.9]
    assert np.all(np.abs(off) < 3.5 * sigma[:4])


def test_photos_of_another_zoom_do_not_pull_the_lens(board_photos, tmp_path):
    zoomed = list(board_photos)[-5:]
    pictures = {name: SPOILT["left11"][0](grey) if name in zoomed else grey for name, grey in board_photos.items()}
    found = calibrate(written(tmp_path, pictures), None, BOARD, lens="brown5")
    assert sorted(record["file"][:6] for record in found.photos if not record["used"]) == zoomed
    assert found.camera_matrix[0, 0] == pytest.approx(533, abs=4)


def test_a_plane_photo_that_is_turned_is_refused(board_photos, tmp_path):
    photos = written(tmp_path, board_photos)
    plane = tmp_path / "plane.png"
    cv2.imwrite(str(plane), np.rot90(board_photos["left09"], 2))
    with pytest.raises(DataError, match=r"camera\.plane: turned by half against camera\.photos; turn it back"):
        calibrate(photos, plane, BOARD, lens="brown5")


def test_a_plane_board_that_is_bent_is_doubted(board_photos, tmp_path):
    photos = written(tmp_path, board_photos)
    plane = tmp_path / "plane.png"
    cv2.imwrite(str(plane), SPOILT["left08"][0](board_photos["left01"]))
    warnings = calibrate(photos, plane, BOARD, lens="brown5").quality["warnings"]
    assert any(said.startswith("plane.png fits far worse than the others") for said in warnings)
