"""How the functions of this room are compiled."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from numba import njit

from rfea_vision.loops import forget_stale_loops

forget_stale_loops(Path(__file__).parent)

_OPTIONS: dict[str, Any] = {
    "cache": True,
    "nogil": True,
    "error_model": "numpy",
    "fastmath": {"contract", "reassoc", "nsz", "arcp"},  # what leaves infinities and NaN alone
}
compiled = njit(**_OPTIONS)

# These make no arrays, so that none need be counted in and out: in short loops the counting takes longer than the
# arithmetic. What they write to is given to them.
_LEAN: dict[str, Any] = _OPTIONS | {"_nrt": False}
lean = njit(**_LEAN)
inlined = njit(**_LEAN, forceinline=True)

# A number that stands in a call by itself is a type of its own to the compiler: a function called with 0 here and with a variable
# there is compiled twice. Where that costs a second, the call says `np.int64(0)`.


@lean
def put_rows(target, source):
    """Write a matrix into another of its shape; `target[:] = source` takes seconds to compile, for its error message."""
    for i in range(source.shape[0]):
        for j in range(source.shape[1]):
            target[i, j] = source[i, j]
