"""What a person points at in a film, beside what is known of the rig: told before a frame is followed."""

from __future__ import annotations

import numpy as np

from rfea_vision.artefacts.measurement import Hints

#: Of the way from clamp to tip, by which the tip lies above where gravity points down: a tube that hangs and bends by 90 deg has none.
_UPWARDS = 0.5


def of_hints(hints: Hints, gravity_deg: float | None) -> list[tuple[str, str]]:
    """Doubt hints of clamp and tip where the tube hangs and the tip is pointed at above: the key under `camera`, and why."""
    if hints.clamp is None or hints.tip is None or gravity_deg != 0.0:
        return []
    way = np.asarray(hints.tip, dtype=float) - np.mean(hints.clamp, axis=0)
    if -way[1] <= _UPWARDS * np.linalg.norm(way):
        return []
    return [
        (
            "clamp",
            f"lies {-way[1]:.0f} px below camera.tip in the picture, and the tube hangs; are the two swapped? If it stands, write rig: "
            "{gravity: up}; of a film upside down turn it and the photos of the board by half a turn",
        )
    ]
