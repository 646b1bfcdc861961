"""A column that is the tension of a tendon, told by its header: a log in newtons, where none in a unit of pressure is."""

from __future__ import annotations

from collections.abc import Sequence

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
