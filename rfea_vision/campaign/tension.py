"""The tension of a tendon: a column told by its header, in newtons where none is in a unit of pressure, and what is odd in it."""

from __future__ import annotations

from collections.abc import Sequence

from rfea_vision.arrays import FloatArray
from rfea_vision.campaign.sensors import of_standstill
from rfea_vision.readers.columns import said_unit
from rfea_vision.readers.kinds.base import Table

#: What nobody can guess of a body that a tendon bends: half its thickness stands in place of the lever until it is measured.
TENDON = {"kind": "rod", "tendon": "4 mm"}
TENDON_WHY = "the log is a force: how far from the body's middle the tendon runs, and what is bent (a rod, a rectangle); measure yours"
#: What has no meaning for a body without a bore.
OF_A_TUBE = ("inner_radius", "fluid_density")


def tension_of(table: Table, measured: Sequence[str], called: Sequence[str]) -> tuple[str, str] | None:
    """The column among those `measured` that is a force, and why; None where none is. Those `called` so go before others in newtons."""
    by_unit = [name for name in measured if said_unit(table, name, "N") is not None]
    found = [name for name in called if name in by_unit] or by_unit
    if not found:
        return None
    others = f"; there are also {', '.join(found[1:4])}: of several tendons, make this a list" * (len(found) > 1)
    return found[0], f"its header names a force: the tension of a tendon?{others}"


def of_tension(tension_N: FloatArray) -> list[str]:
    """Doubt the tension of a tendon (rows,): it pulls, and changes."""
    lowest, highest = float(tension_N.min()), float(tension_N.max())
    if lowest == highest:
        return ["is flat: nothing can be synchronised or fitted on it; is it the right column?"]
    if -lowest > max(highest, 0.0):
        return ["is below zero where it is largest, and a tendon only pulls; is its sign turned in the log?"]
    return of_standstill(tension_N, "N")
