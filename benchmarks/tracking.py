"""Tracking: accuracy against the Cramer-Rao bound, honesty of the intervals, speed against decoding alone, memory."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np

from rfea_vision.artefacts import Actuator
from rfea_vision.calibration.board import Board
from rfea_vision.calibration.calibrate import calibrate
from rfea_vision.readers.video import open_video
from rfea_vision.vision import track_frames
from rfea_vision.vision.curve import COEFFICIENTS, WIDTH_COEFFICIENTS, basis_matrix
from testing.scenes import Lens, Look, Shape, bending, board_pictures, film, picture, plane_picture, shape
from testing.sources import memory_source, true_calibration
from testing.thinning import thinned

NOISE = 3.0
POSTURES = (3.0, 45.0, 110.0)
REPEATS = 60
SCENES = 30
PAIRS = 12  # turns of decoding and tracking


def row(name: str, value: float, unit: str, target: str, met: bool, against: str) -> dict[str, Any]:
    return {
        "name": name,
        "value": round(float(value), 5),
        "unit": unit,
        "target": target,
        "met": bool(met),
        "against": against,
    }


def even_nodes(line: np.ndarray, count: int = 33) -> np.ndarray:
    lengths = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    places = np.linspace(0, lengths[-1], count)
    return np.column_stack([np.interp(places, lengths, line[:, k]) for k in (0, 1)])


def deformed(base: Shape, shift: np.ndarray, widen: np.ndarray, longer: float) -> Shape:
    """The same tube with its centre line moved along its normals, its edges apart, and its end farther out (mm)."""
    normal = np.column_stack([np.cos(base.phi), -np.sin(base.phi)])
    along = np.column_stack([-np.sin(base.phi), -np.cos(base.phi)])
    stretch = np.zeros(len(base.phi))
    stretch[-1] = longer

    class Moved(Shape):
        def _offset(self, by: float) -> np.ndarray:
            side = (by - self.radius_mm) / self.radius_mm
            return base.hinge + (by + shift + side * widen)[:, None] * normal + stretch[:, None] * along

    return Moved(base.hinge, base.phi, base.radius_mm)


def bound(base: Shape, lens: Lens, look: Look) -> tuple[np.ndarray, float]:
    """Cramer-Rao bound on the rendered edges: standard deviation of the nodes across (33,) and of the tip along, in mm.

    The unknowns are those that any tracker with this spline has: shift and half width along the tube, and the end.
    The derivative of the picture to each is taken by rendering it twice, without noise or rounding.
    """

    def clean(shift: np.ndarray, widen: np.ndarray, longer: float) -> np.ndarray:
        exact = _unrounded(deformed(base, shift, widen, longer), lens, look)
        return exact

    u = np.linspace(0, 1, len(base.phi))
    shifts, widths = basis_matrix(u, COEFFICIENTS), basis_matrix(u, WIDTH_COEFFICIENTS)
    nothing, step = np.zeros(len(u)), 0.02
    columns = []
    for k in range(COEFFICIENTS):
        columns.append((clean(step * shifts[:, k], nothing, 0) - clean(-step * shifts[:, k], nothing, 0)).ravel())
    for k in range(WIDTH_COEFFICIENTS):
        columns.append((clean(nothing, step * widths[:, k], 0) - clean(nothing, -step * widths[:, k], 0)).ravel())
    columns.append((clean(nothing, nothing, step) - clean(nothing, nothing, -step)).ravel())
    jacobian = np.stack(columns, axis=1) / (2 * step)
    information = jacobian.T @ jacobian / (look.noise**2 + 1 / 12)
    covariance = np.linalg.pinv(information, rcond=1e-12, hermitian=True)
    nodes = basis_matrix(np.linspace(0, 1, 33), COEFFICIENTS)
    across = np.sqrt(np.einsum("ri,ij,rj->r", nodes, covariance[:COEFFICIENTS, :COEFFICIENTS], nodes))
    return across, float(np.sqrt(covariance[-1, -1]))


class _NoNoise:
    @staticmethod
    def normal(_mean: float, _sigma: float, size: Any) -> np.ndarray:
        return np.zeros(size)


def _unrounded(drawn: Shape, lens: Lens, look: Look) -> np.ndarray:
    return picture(drawn, lens, look, _NoNoise(), rounded=False)  # pyright: ignore[reportArgumentType]


def accuracy() -> list[dict[str, Any]]:
    """Bias and scatter in the image plane, uncompressed, against the bound."""
    lens, look = Lens(), Look(noise=NOISE)
    calibration = true_calibration(lens)
    biases, ratios, tip_biases, tip_ratios = [], [], [], []
    for angle in POSTURES:
        base = shape(angle)
        rng = np.random.default_rng(int(angle))
        pictures = [picture(base, lens, look, rng) for _ in range(REPEATS)]
        track = track_frames(memory_source(pictures, np.arange(REPEATS) / 240), calibration, Actuator())
        data = track.dataset
        origin = np.array([data.attrs["clamp_plane_x_mm"], data.attrs["clamp_plane_y_mm"]])
        px = data.attrs["px_per_mm"]
        truth = even_nodes(base.centre)
        phi = np.interp(np.linspace(0, 1, 33), np.linspace(0, 1, len(base.phi)), base.phi)
        normal = np.column_stack([np.cos(phi), -np.sin(phi)])
        along = np.array([-np.sin(phi[-1]), -np.cos(phi[-1])])
        off = np.sum((data["midline"].values + origin - truth) * normal, axis=-1)[3:]
        end = ((data["tip"].values + origin - base.tip) @ along)[3:]
        across, axial = bound(base, lens, look)
        biases.append(np.sqrt(np.mean(off.mean(axis=0) ** 2)) * px)
        ratios.append(np.sqrt(np.mean(off.var(axis=0)) / np.mean(across**2)))
        tip_biases.append(np.hypot(end.mean(), off[:, -1].mean()) * px)
        tip_ratios.append(np.sqrt((end.var() + off[:, -1].var()) / (axial**2 + across[-1] ** 2)))
    said = (
        f"720 x 1280, noise {NOISE:g} grey levels, uncompressed, postures of 3, 45 and 110 deg, {REPEATS} frames each"
    )
    return [
        row("midline, bias in the image plane", max(biases), "px", "< 0.02", max(biases) < 0.02, said),
        row("midline, scatter over Cramer-Rao bound", max(ratios), "1", "<= 1.3", max(ratios) <= 1.3, said),
        row("tip, bias in the image plane", max(tip_biases), "px", "< 0.02", max(tip_biases) < 0.02, said),
        row("tip, scatter over Cramer-Rao bound", max(tip_ratios), "1", "<= 1.3", max(tip_ratios) <= 1.3, said),
    ]


def encode(path: Path, pictures: list[np.ndarray], options: dict[str, str], rate: int = 240) -> None:
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=rate)
        stream.height, stream.width = pictures[0].shape
        stream.pix_fmt, stream.options = "yuv420p", {"preset": "medium", **options}
        for number, image in enumerate(pictures):
            frame = av.VideoFrame.from_ndarray(image, format="gray").reformat(format="yuv420p")
            frame.pts, frame.time_base = number, Fraction(1, rate)
            for packet in stream.encode(frame):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)


def calibrated(lens: Lens, folder: Path, seed: int) -> Any:
    """Calibrate from rendered photos."""
    files = []
    for k, image in enumerate(board_pictures(lens, 12, seed)):
        files.append(folder / f"board_{seed}_{k:02d}.png")
        cv2.imwrite(str(files[-1]), image)
    plane = folder / f"plane_{seed}.png"
    cv2.imwrite(str(plane), plane_picture(lens, seed))
    return calibrate(files, plane, Board("checkerboard", (9, 6), 0.012))


def compressed(folder: Path) -> list[dict[str, Any]]:
    """The whole chain in mm, through two encoders; and speed on the same files."""
    lens = Lens()
    calibration = calibrated(lens, folder, 1)
    pictures, _, shapes = film(lens, Look(noise=1.5), bending(np.arange(120) / 240))
    tips = np.array([s.tip for s in shapes])
    rows = []
    for name, options in (("qp 18", {"qp": "18"}), ("crf 18", {"crf": "18"})):
        path = folder / f"{name.replace(' ', '')}.mp4"
        encode(path, pictures, options)
        data = track_frames(open_video(path), calibration, Actuator()).dataset
        error = data["tip"].values - tips
        rms = np.sqrt(np.nanmean(np.sum(error**2, axis=1)))
        lost = int(np.sum(data["valid"].values == 0))
        said = (
            f"calibrated from 12 rendered photos; {path.stat().st_size / 120 / 1000:.0f} kB a frame; {lost} frames lost"
        )
        rows.append(row(f"tip, whole chain, H.264 {name}", rms, "mm", "<= 0.06", rms <= 0.06 and lost == 0, said))
    return rows + speed(folder, calibration, pictures)


def speed(folder: Path, calibration: Any, pictures: list[np.ndarray]) -> list[dict[str, Any]]:
    """Frames per second, and the share of decoding alone, on the same file in the same run, at both rates.

    A shared machine is fast at one moment and slow at the next: decoding and tracking take turns, and each share is that of
    a neighbouring pair; reported is the median.
    """
    there_and_back = [*pictures, *pictures[::-1]]
    count = 8 * len(there_and_back)  # eight seconds: the search in the first frame is a small part
    track_frames(open_video(folder / "crf18.mp4"), calibration, Actuator())  # compile
    rows = []
    for name, options in (("crf 18", {"crf": "18"}), ("qp 18", {"qp": "18"})):
        path = folder / f"long_{name.replace(' ', '')}.mp4"
        encode(path, there_and_back * 8, options)
        decoding, tracking = [], []
        for _ in range(PAIRS):
            begun = time.perf_counter()
            assert sum(1 for _ in open_video(path)) == count
            decoding.append(count / (time.perf_counter() - begun))
            begun = time.perf_counter()
            track_frames(open_video(path), calibration, Actuator())
            tracking.append(count / (time.perf_counter() - begun))
        rate, share = float(np.median(tracking)), float(np.median(np.array(tracking) / np.array(decoding)))
        said = f"720 x 1280, {name}, {count} frames; decoding alone {np.median(decoding):.0f} frames/s; {PAIRS} turns"
        if name == "crf 18":
            rows.append(row("tracking speed", rate, "frames/s", ">= 480", rate >= 480, said))
        rows.append(row(f"tracking over decoding alone, {name}", share, "1", ">= 0.7", share >= 0.7, said))
    begun = time.perf_counter()
    for image in pictures[:40]:
        _, mask = cv2.threshold(cv2.GaussianBlur(image, (5, 5), 0), 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
        outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        filled = cv2.drawContours(np.zeros_like(mask), [max(outlines, key=cv2.contourArea)], -1, 1, -1)
        thinned(filled.astype(bool))
    plain = 40 / (time.perf_counter() - begun)
    recipe = "the usual recipe, no sub-pixel edges"
    rows.append(row("findContours and thinning, without decoding", plain, "frames/s", "none", True, recipe))
    return [*rows, *memory()]


MEMORY_CODE = """
import sys
from dataclasses import dataclass, replace
from itertools import cycle, islice
from pathlib import Path
import numpy as np
from benchmarks.tracking import Actuator, Lens, Look, bending, film, memory_source, track_frames, true_calibration
from testing.sources import MemorySource

class Long(MemorySource):
    def frames(self, start_frame=0):
        for number, picture in enumerate(islice(cycle(self.pictures), self.frame_count)):
            yield number / 240, picture

lens = Lens().scaled(0.5)
pictures, _, _ = film(lens, Look(), bending(np.arange(40) / 240))
there_and_back = [*pictures, *pictures[::-1]]
track_frames(Long(Path("long"), lens.size, int(sys.argv[1]), None, tuple(there_and_back)), true_calibration(lens), Actuator())
# VmHWM, not ru_maxrss: the latter keeps the peak of the process that started this one
lines = Path("/proc/self/status").read_text().splitlines()
print(next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) / 1024)
"""


def memory() -> list[dict[str, Any]]:
    """Largest resident memory of a process of its own, on a short and on a long recording."""
    used = []
    for frames in (400, 20_000):
        command = [sys.executable, "-c", MEMORY_CODE, str(frames)]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        used.append(float(done.stdout.split()[-1]))
    per_frame = 1024 * (used[1] - used[0]) / 19_600
    said = f"{used[0]:.0f} MB for 400 frames, {used[1]:.0f} MB for 20,000: {per_frame:.1f} kB a frame, the track itself"
    return [row("memory while tracking 20,000 frames", used[1], "MB", "< 600", used[1] < 600, said)]


def honesty(folder: Path) -> list[dict[str, Any]]:
    """Do the 95 % intervals contain the truth, over independently calibrated scenes?"""
    rng = np.random.default_rng(5)
    inside: dict[str, list[np.ndarray]] = {"tip": [], "angle": [], "elongation": []}
    joints = np.linspace(0, 1, 17)
    for scene in range(SCENES):
        lens = Lens().scaled(0.5)
        calibration = calibrated(lens, folder, 100 + scene)
        angles = rng.uniform(5, 120) + np.linspace(0, 25, 8)
        pictures, times, shapes = film(
            lens, Look(noise=NOISE), angles, rate_Hz=120, seed=scene, taper=rng.uniform(-0.5, 0.5)
        )
        data = track_frames(memory_source(pictures, times), calibration, Actuator()).dataset
        tip = data["tip"].values - np.array([s.tip for s in shapes])
        angle = data["bend_angle"].values - np.array([s.bend_deg for s in shapes])
        truth = [4.0 * np.diff(np.interp(joints, np.linspace(0, 1, len(s.phi)), s.phi)) / (155 / 16) for s in shapes]
        inside["tip"].append(np.abs(tip) < 1.96 * data["tip_sigma"].values)
        inside["angle"].append(np.abs(angle) < 1.96 * data["bend_angle_sigma"].values)
        inside["elongation"].append(np.abs(data["elongation"].values - truth) < 1.96 * data["elongation_sigma"].values)
    rows = []
    for name, hits in inside.items():
        share = float(np.mean([np.mean(h) for h in hits]))
        said = f"{SCENES} scenes, each with its own 12 photos and noise, 360 x 640"
        rows.append(
            row(
                f"95 % interval of {name} contains the truth",
                100 * share,
                "%",
                "92 to 98",
                92 <= 100 * share <= 98,
                said,
            )
        )
    return rows


def run() -> list[dict[str, Any]]:
    """Every row of this group."""
    cv2.setNumThreads(1)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        return [*accuracy(), *compressed(folder), *honesty(folder)]
