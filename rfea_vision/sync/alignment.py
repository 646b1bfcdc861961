"""What aligning two clocks gives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rfea_vision.arrays import FloatArray


@dataclass(frozen=True)
class Alignment:
    """Log clock minus camera clock, and how sure that is.

    `explained` is the share of the pressure that the motion explains, `curve` that share over offsets (offset_s, share), of
    `align_by_motion` alone; without arguments a clock that is known.
    """

    offset_s: float
    offset_stderr_s: float = 0.0
    drift_ppm: float = 0.0
    drift_stderr_ppm: float = 0.0
    explained: float = 1.0
    curve: tuple[FloatArray, FloatArray] = (np.empty(0), np.empty(0))
    note: str = ""

    @property
    def attributes(self) -> dict[str, float]:
        """What a recording says of it."""
        return {
            "offset_s": self.offset_s,
            "offset_stderr_s": self.offset_stderr_s,
            "drift_ppm": self.drift_ppm,
            "drift_stderr_ppm": self.drift_stderr_ppm,
            "sync_explained": self.explained,
        }
