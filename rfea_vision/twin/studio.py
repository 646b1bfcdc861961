"""A session with the twin's camera: photos of a board, the board in the plane of motion, and a film of every run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts import bend_sign
from rfea_vision.campaign.specs import gravity_deg
from rfea_vision.files import whole_file
from rfea_vision.twin.camera import Camera, camera_over, turn
from rfea_vision.twin.coverage import coverage
from rfea_vision.twin.draw import Posture, camera_times, misread_plane
from rfea_vision.twin.options import TwinOptions
from rfea_vision.twin.renderer import Scenery, blurred, draw_scene, finely, frames
from rfea_vision.twin.stress import SLOW_MOTION_HZ, hose_mm, shadow_of, shown_frames, wall_pattern


@dataclass(frozen=True)
class CheckerBoard:
    """Inner corners per row and column, and the side of a square; the origin is the first inner corner."""

    columns: int
    rows: int
    square_mm: float

    def outline(self, margin: float = 0.75) -> FloatArray:
        """Corners of the white sheet, (4, 2) mm; `margin` in squares beyond the black ones, as boards are printed."""
        low = -(1 + margin) * self.square_mm
        right, bottom = (self.columns + margin) * self.square_mm, (self.rows + margin) * self.square_mm
        return np.array([[low, low], [right, low], [right, bottom], [low, bottom]])

    def black_squares(self) -> list[FloatArray]:
        """Outlines of the black squares, (4, 2) mm each."""
        side = self.square_mm
        unit = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
        return [
            (unit + np.array([column - 1, row - 1])) * side
            for row in range(self.rows + 1)
            for column in range(self.columns + 1)
            if (row + column) % 2 == 0
        ]


def photograph(
    scene: Scenery,
    project: Callable[[FloatArray], FloatArray],
    board: CheckerBoard,
    size: tuple[int, int],
    generator: np.random.Generator,
) -> NDArray[np.uint8]:
    """Picture (rows, columns) of a board; `project` maps points (m, 2) of its plane in mm to pixels."""
    width, height = size
    sheet = coverage([project(finely(board.outline()))], 0, 0, width, height)
    black = coverage([project(finely(square, 8)) for square in board.black_squares()], 0, 0, width, height)
    wall = 0.75 * scene.wall + 20
    sharp = (wall + (222.0 - wall) * sheet - 190.0 * black) * scene.light
    noise = scene.noise * generator.standard_normal((height, width))
    return np.clip(blurred(sharp.astype(np.float32), scene.blur_px) + noise + 0.5, 0, 255).astype(np.uint8)


def board_poses(
    camera: Camera, board: CheckerBoard, count: int, generator: np.random.Generator
) -> list[Callable[[FloatArray], FloatArray]]:
    """Draw poses that together fill the picture: near and far, tilted both ways, all of the board in view.

    Returns
    -------
    list
        Functions from the board's plane (mm) to pixels.
    """
    sheet = board.outline()
    middle = sheet.mean(axis=0)
    distance = float(camera.translation[2])
    poses: list[Callable[[FloatArray], FloatArray]] = []
    targets = [(x, y) for y in (0.24, 0.5, 0.76) for x in (0.35, 0.5, 0.65)]
    while len(poses) < count:
        target = np.array(targets[len(poses) % len(targets)]) + generator.uniform(-0.06, 0.06, 2)
        for _ in range(500):
            angles = np.radians(generator.uniform([-38, -38, -25], [38, 38, 25]))
            rotation = turn(*angles)
            depth = distance * generator.uniform(0.6, 1.15)
            pixel = target * [camera.width, camera.height]
            ray = np.linalg.solve(camera.matrix, [*pixel, 1.0])
            pose = replace(camera, rotation=rotation, translation=depth * ray - rotation[:, :2] @ middle)
            corners = pose.project_plane(sheet)
            if np.all(corners > 4) and np.all(corners < [camera.width - 5, camera.height - 5]):
                poses.append(pose.project_plane)
                break
            target = 0.9 * target + 0.05
    return poses


def write_video(
    path: Path, pictures: Iterator[NDArray[np.uint8]], times_s: FloatArray, size: tuple[int, int], qp: int
) -> None:
    """Encode grey pictures (rows, columns) as H.264 with exact time stamps (frames,) in s."""
    steps = np.diff(times_s)
    even = len(steps) == 0 or np.ptp(steps) < 1e-9
    rate = Fraction(1.0 / float(np.median(steps)) if len(steps) else 30.0).limit_denominator(1001)
    base = 1 / rate if even else Fraction(1, 90_000)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=rate)
        stream.width, stream.height = size
        stream.pix_fmt = "yuv420p"
        stream.time_base = base
        stream.codec_context.time_base = base
        stream.options = {"qp": str(qp), "preset": "medium", "threads": "2"}
        for picture, time in zip(pictures, times_s, strict=True):
            frame = av.VideoFrame.from_ndarray(picture, format="gray")
            frame.pts = round(time / float(base))
            frame.time_base = base
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


class Studio:
    """Camera, light and board of one campaign.

    Parameters
    ----------
    options : of the campaign
    postures : of every run; the camera is set up so that all of them are in the picture
    """

    def __init__(self, options: TwinOptions, postures: list[Posture]) -> None:
        self.options = options
        self.generator = np.random.default_rng([options.seed, 4])
        radius = 1e3 * options.actuator.outer_radius
        # The camera stands level: what points down in the frame of the rig points elsewhere in the picture.
        bends = options.actuator.bends
        angle = np.radians(gravity_deg(options.gravity, bends) or 0.0) * bend_sign(bends)
        self.level = turn(0.0, 0.0, angle)[:2, :2]  # from the rig's axes to camera-right and up
        nodes = np.concatenate([posture.line(np.linspace(0, 1, 33))[0].reshape(-1, 2) for posture in postures])
        nodes = nodes @ self.level.T
        room = 3.5 * radius
        clamp = np.array([[-2 * radius, 0.0], [2 * radius, 0.0]]) @ self.level.T
        self.lower = np.minimum(nodes.min(axis=0), clamp.min(axis=0)) - room
        self.upper = np.maximum(nodes.max(axis=0), clamp.max(axis=0)) + room
        wide, high = options.frame_size
        self.size = (max(wide, high), min(wide, high)) if options.scene.landscape else (wide, high)
        self.camera = camera_over(self.lower, self.upper, self.size, self.generator)
        self.camera = replace(self.camera, rotation=self.camera.rotation @ turn(0.0, 0.0, angle))
        self.scene = self._scene(radius)
        square = max(1.0, round(0.068 * float(self.upper[0] - self.lower[0])))
        self.board = CheckerBoard(9, 6, square)

    def _scene(self, radius_mm: float) -> Scenery:
        """Surfaces and light as drawn, then what makes them hard."""
        options, stress = self.options, self.options.scene
        dark = True if stress.dark else False if stress.light else options.dark_tube
        scene = draw_scene(self.camera, radius_mm, dark, options.image_noise, self.generator)
        generator = np.random.default_rng([options.seed, 7])
        width, height = self.size
        if stress.uneven:
            across = np.linspace(0.5, -0.5, width, dtype=np.float32) * generator.choice([-1.0, 1.0])
            scene = replace(scene, light=(scene.light * (1 + stress.uneven * across)).astype(np.float32))
        if stress.busy:
            scene = replace(scene, pattern=wall_pattern(width, height, stress.busy, generator))
        if stress.hose:
            scene = replace(scene, hose_mm=hose_mm(stress.hose, self.lower, self.upper, generator) @ self.level)
        if stress.highlight:
            towards = 1.0 if scene.wall > scene.tube else -1.0
            scene = replace(scene, highlight=scene.tube + towards * stress.highlight)
        shade = shadow_of(stress.shadow, width, height) if stress.shadow else None
        return replace(scene, stress=stress, shade=shade)

    def write_calibration(self, folder: Path) -> dict[str, object]:
        """Write the photos; return the campaign's ``camera`` section."""
        folder.mkdir()
        poses = board_poses(self.camera, self.board, self.options.photos, self.generator)
        for index, pose in enumerate(poses):
            self._write_photo(folder / f"board_{index + 1:02d}.jpg", pose)
        self._write_photo(folder / "plane.jpg", self._in_plane)
        return {
            "board": {
                "kind": "checkerboard",
                "inner_corners": [self.board.columns, self.board.rows],
                "square": f"{self.board.square_mm:g} mm",
            },
            "photos": "calibration/board_*.jpg",
            "plane": "calibration/plane.jpg",
            "vertical": "board",
        }

    def film(self, path: Path, posture: Posture, progress: Callable[[int], None]) -> None:
        """Film one run."""
        times = camera_times(self.options)
        shown = shown_frames(len(times), self.options.scene, self.options.seed)

        def counted() -> Iterator[NDArray[np.uint8]]:
            before: NDArray[np.uint8] | None = None
            for index, picture in enumerate(frames(self.camera, self.scene, posture, self.generator, times)):
                progress(index)
                before = picture if shown[index] == index or before is None else before
                yield before

        stamps = np.arange(len(times)) / SLOW_MOTION_HZ if self.options.scene.slow_motion else times
        with whole_file(path) as temporary:
            write_video(temporary, counted(), stamps, self.size, self.options.codec_qp)

    def _in_plane(self, points: FloatArray) -> FloatArray:
        """Pixels of the board lying in the plane of motion, rows level; a hidden error of the plane sits here."""
        centre = 0.5 * (self.lower + self.upper)
        middle = self.board.outline().mean(axis=0)
        believed = (centre + (points - middle) * [1.0, -1.0]) @ self.level
        true = believed
        for _ in range(8):  # undo the misreading: contracts fast, as its errors are small
            true = true + believed - misread_plane(true, self.options.hidden, self.options.actuator.mirror)
        return self.camera.project_plane(true)

    def _write_photo(self, path: Path, project: Callable[[FloatArray], FloatArray]) -> None:
        picture = photograph(self.scene, project, self.board, self.size, self.generator)
        done, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 93])
        if not done:
            raise OSError(f"{path}: the picture could not be encoded")
        path.write_bytes(data.tobytes())
