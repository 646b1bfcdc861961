"""The camera: where it stands and how it shakes, how long it looks, what its lens and its sensor add."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

Rng = np.random.Generator
SIZES = (
    (480, 640),
    (640, 480),
    (540, 960),
    (960, 540),
    (600, 800),
    (848, 480),
    (480, 848),
    (720, 1280),
    (1280, 720),
)  # width, height
SHARES = (0.13, 0.13, 0.11, 0.13, 0.09, 0.1, 0.09, 0.1, 0.12)


@dataclass(frozen=True)
class Camera:
    """Figures of a camera; `shake` is none, or (x, y, rad) per frame."""

    size: tuple[int, int]  # width, height
    rate_Hz: float
    exposed: float  # of the time between frames
    defocus_px: float
    noise: float  # of sRGB's 255, in a middle tone
    grain_px: float  # how wide the noise's spots are: phones smooth it
    crf: int
    jpeg: int | None  # quality, where the pictures were compressed one by one before
    tilt: np.ndarray  # (2,) 1/px: what is slightly out of the picture's plane
    shake: np.ndarray | None
    contrast: float  # of the curve that phones lay over their pictures

    @property
    def shape(self) -> tuple[int, int]:
        return self.size[1], self.size[0]

    def plane(self, about: np.ndarray) -> np.ndarray:
        """The view (3, 3) of the body's plane by a camera that stands, true to scale at `about` (2,) px."""
        to, back = np.eye(3), np.eye(3)
        to[:2, 2], back[:2, 2] = about, -np.asarray(about)
        middle = np.eye(3)
        middle[2, :2] = self.tilt
        return to @ middle @ back

    def moved(self, frame: int) -> np.ndarray:
        """What a shaken camera makes (3, 3) of a picture that a standing one sees."""
        view = np.eye(3)
        if self.shake is not None:
            x, y, turn = self.shake[frame]
            middle = np.array(self.size) / 2
            view[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
            view[:2, 2] = middle - view[:2, :2] @ middle + [x, y]
        return view


def _shaken(rng: Rng, count: int) -> np.ndarray:
    """A hand's tremble and drift (n, 3), none at first."""
    steps = rng.normal(size=(count + 40, 3)) * [1, 1, 0.002]
    kernel = np.hanning(int(rng.integers(8, 24)))
    smooth = np.column_stack([np.convolve(s, kernel / kernel.sum(), mode="same") for s in steps.T])[20:-20]
    smooth = smooth / np.abs(smooth[:, :2]).max() * rng.uniform(1.0, 7.0)
    return smooth - smooth[0]


def picture_size(rng: Rng) -> tuple[int, int]:
    return SIZES[int(rng.choice(len(SIZES), p=np.array(SHARES) / sum(SHARES)))]


def camera(rng: Rng, count: int) -> Camera:
    kept = rng.random() < 0.25
    return Camera(
        size=picture_size(rng),
        rate_Hz=float(rng.choice([30, 25, 24, 60, 15], p=[0.6, 0.15, 0.05, 0.15, 0.05])),
        exposed=rng.uniform(0.05, 0.65),
        defocus_px=float(rng.choice([rng.uniform(0.35, 0.9), rng.uniform(0.9, 1.8)], p=[0.8, 0.2])),
        noise=float(np.exp(rng.uniform(np.log(0.6), np.log(5.0)))),
        grain_px=rng.uniform(0.3, 0.9),
        crf=int(rng.integers(20, 31)),
        jpeg=int(rng.integers(70, 95)) if kept else None,
        tilt=rng.normal(0, 7e-5, 2),
        shake=_shaken(rng, count) if rng.random() < 0.12 else None,
        contrast=rng.uniform(0.1, 0.8),
    )


class Noise:
    """Noise of a sensor: some sheets drawn once, of which each frame takes another part."""

    def __init__(self, camera: Camera, rng: Rng) -> None:
        h, w = camera.shape
        sheet = rng.standard_normal((h + 96, w + 96, 3), np.float32)
        sheet = cv2.GaussianBlur(sheet, (0, 0), camera.grain_px) if camera.grain_px > 0.35 else sheet
        common = sheet.mean(axis=2, keepdims=True)
        sheet = 0.6 * sheet + 0.8 * common
        self.sheet = sheet * (camera.noise / sheet.std())
        self.shape, self.rng = (h, w), rng

    def add(self, picture: np.ndarray) -> None:
        """To sRGB (h, w, 3), more where it is dark, as a screen shows it."""
        y, x = self.rng.integers(0, 96, 2)
        part = self.sheet[y : y + self.shape[0], x : x + self.shape[1]]
        picture += part if self.rng.random() < 0.5 else -part
