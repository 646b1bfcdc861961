"""What moves in a film: a tube rests where it is held, and its tip goes farthest."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.lines import along, at, evenly, scaled
from rfea_vision.vision.find.locate import WIDTH_SCALED_PX, Path, find_paths, length_score

LEAST_SIDE_PX = 16  # of the smaller pictures
LOOKS = 24  # frames that are compared with the first, over all of a film
BRIGHTEST = 0.998  # of the pixels that are not brighter in the picture of what changes: glare and flicker are few
STATIONS, END = 40, 10  # places along a line, and how many of them are one of its ends
# What moves as a tube does changes at its tip by so many times what its clamp does, and what rests does. Of lines in the first frames
# of fifteen phone films of silicone arms those on an arm changed 2.3 to 11 times as much there, and most others less than twice.
MOVES = 2.0
# Lengths of the tube: a line that is longer runs on behind the clamp, and is cut there; of a shorter one so much is seen at least.
OVERLONG, LEAST_SEEN = 1.2, 0.5


@dataclass(frozen=True)
class Motion:
    """By how much each pixel of a film's first frame changes (h, w), over what most do; `scale` from the film's px to its own."""

    change: NDArray[np.float32]
    scale: float

    @classmethod
    def of(cls, frames: Iterable[tuple[float, NDArray[np.uint8]]], count: int, width_px: float) -> Motion:
        """What moves in the first `count` frames (h, w), for a tube of a width."""
        looked = {int(k) for k in np.linspace(0, count - 1, LOOKS + 1)}
        scale, first, changes = 1.0, None, []
        for number, (_, luma) in enumerate(frames):
            if number >= count:
                break
            if number not in looked:
                continue
            if first is None:  # by a scale that is wrong the tube may be wider than the picture
                scale = min(max(WIDTH_SCALED_PX / width_px, LEAST_SIDE_PX / min(luma.shape)), 1.0)
            small = cv2.resize(luma, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA).astype(np.float32)
            if first is None:
                first = small
            else:
                changes.append(np.abs(small - first))
        assert first is not None
        change = np.mean(changes, axis=0) if changes else np.zeros_like(first)
        return cls((change / max(float(np.median(change)), 1e-3)).astype(np.float32), scale)

    def along(self, line_px: FloatArray) -> FloatArray:
        """Change (STATIONS,) along a line (n, 2) px of the film, over what most of the picture does."""
        x, y = scaled(evenly(line_px, STATIONS), self.scale).astype(np.float32).T
        return cv2.remap(self.change, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).ravel().astype(float)

    def ribbons(self, width_px: float, length_px: float) -> list[Path]:
        """Lines of the tube's width in what changes: where the wall is no plainer than the tube, that shows it best."""
        picture = np.clip(255.0 * self.change / max(float(np.quantile(self.change, BRIGHTEST)), 1e-3), 0, 255).astype(np.uint8)
        paths = find_paths(picture, width_px * self.scale, length_px * self.scale)
        return [replace(path, points=scaled(path.points, 1.0 / self.scale)) for path in paths if path.polarity > 0]


def moving_lines(paths: Iterable[Path], motion: Motion, length_px: float) -> list[FloatArray]:
    """Lines (n, 2) px of those paths that move as a tube of a length does, from clamp to tip, the clearest first."""
    ranked = []
    for path in paths:
        share = float(along(path.points)[-1]) / length_px
        if share < LEAST_SEEN:
            continue
        seen = path.strength * length_score(share if share < OVERLONG else 1.0)
        for line in (as_long(points, length_px) for points in (path.points, path.points[::-1])):
            clamp, *_, tip = motion.along(line).reshape(-1, END).mean(axis=1)
            if tip > MOVES * max(clamp, 1.0) and np.all((line > 0.0) & (line * motion.scale < motion.change.shape[::-1])):
                ranked.append((seen * float(np.log(tip / max(clamp, 1.0))), line))
    return [line for _, line in sorted(ranked, key=lambda pair: -pair[0])]


def as_long(line_px: FloatArray, length_px: float) -> FloatArray:
    """A line (n, 2) px with the tube's length, from its tip back: at its clamp a line may run on, or fade before it."""
    lengths = along(line_px)
    if 1.0 / OVERLONG < lengths[-1] / length_px < OVERLONG:
        return line_px
    back = line_px[0] - at(line_px, np.array([0.3 * lengths[-1]]))[0]
    longer = np.vstack([line_px[0] + back * (length_px / np.linalg.norm(back)), line_px])
    return at(longer, along(longer)[-1] + length_px * np.linspace(-1.0, 0.0, STATIONS))
