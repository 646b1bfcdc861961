"""What other programs write of the body is read as they write it: key points of four trackers, masks of any depth and name."""

import csv

import cv2
import h5py
import numpy as np
import pytest

from rfea_vision.artefacts import Hints
from rfea_vision.errors import InputError
from rfea_vision.vision.body.guide import guide_of

CLAMP = np.array([[45.0, 20.0], [55.0, 20.0]])
FRAMES = np.array(
    [np.column_stack([50.0 + f * np.linspace(0, 1, 5) ** 2, np.linspace(20, 120, 5)]) for f in (0, 8, 20)]
)
ELSEWHERE = FRAMES + np.array([200.0, 0.0])


def deeplabcut(path):
    names = [(animal, f"p{k}") for animal in ("other", "arm") for k in range(5)]
    sure = [[0.9] * 10, [0.9] * 10, [0.9] * 7 + [0.1] + [0.9] * 2]
    with path.open("w", newline="") as stream:
        out = csv.writer(stream)
        for label, pick in (
            ("scorer", lambda _: "net"),
            ("individuals", lambda n: n[0]),
            ("bodyparts", lambda n: n[1]),
        ):
            out.writerow([label, *(pick(name) for name in names for _ in "xyl")])
        out.writerow(["coords", *("x", "y", "likelihood") * 10])
        for k, (away, arm) in enumerate(zip(ELSEWHERE, FRAMES, strict=True)):
            points = np.vstack([away, arm])
            out.writerow([k, *(v for p, s in zip(points, sure[k], strict=True) for v in (*p, s))])


def sleap(path):
    with h5py.File(path, "w") as file:
        file["tracks"] = FRAMES.transpose(2, 1, 0)[None]
        file["node_names"] = np.array([f"n{k}" for k in range(5)], dtype="S4")


def cotracker(path):
    np.save(path, FRAMES[None, :, ::-1])  # from the tip to the clamp


def plain(path):
    table = np.column_stack([np.arange(3), FRAMES.reshape(3, -1)])
    header = ",".join(["frame", *(f"{axis}{k}" for k in range(5) for axis in "xy")])
    np.savetxt(path, table, delimiter=",", header=header, comments="")


@pytest.mark.parametrize(
    ("write", "name"), [(deeplabcut, "a.csv"), (sleap, "a.h5"), (cotracker, "a.npy"), (plain, "a.csv")]
)
def test_key_points_of_trackers_are_read_from_the_clamp_on(write, name, tmp_path):
    write(tmp_path / name)
    guide = guide_of(Hints(keypoints=tmp_path / name), CLAMP)
    assert guide is not None
    assert guide(1) == pytest.approx(FRAMES[1])
    last = guide(2)  # of which DeepLabCut does not trust one point
    assert last == pytest.approx(np.delete(FRAMES[2], 2, axis=0) if write is deeplabcut else FRAMES[2])
    assert guide(3) is None


@pytest.mark.parametrize("light", [255, 1, 38])
def test_masks_of_any_depth_are_read_in_the_order_of_their_numbers(light, tmp_path):
    for number, line in zip((2, 9, 10), FRAMES, strict=True):
        mask = np.zeros((160, 100), dtype=np.uint8)
        cv2.polylines(mask, [np.round(line).astype(np.int32)], False, light, 11)
        cv2.imwrite(str(tmp_path / f"mask{number}.png"), mask)
    guide = guide_of(Hints(masks=tmp_path), CLAMP)
    assert guide is not None
    for number, line in enumerate(FRAMES):
        found = guide(number)
        assert found is not None
        assert abs(found[-1, 0] - line[-1, 0]) < 4.0 and found[0, 1] < 30.0


@pytest.mark.parametrize(
    ("name", "content"), [("a.csv", b"frame,x0,y0\n0,1,2\n"), ("a.npy", b"nothing"), ("b.csv", b"a,b\n1,2\n")]
)
def test_a_file_without_a_line_of_points_is_refused_by_its_name(name, content, tmp_path):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=rf"{name}.*camera\.keypoints"):
        guide_of(Hints(keypoints=tmp_path / name), CLAMP)
