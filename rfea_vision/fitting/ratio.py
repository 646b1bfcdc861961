"""Runs that tell only the ratio of stiffness and lever: whether they do, and the sentence that says so."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rfea_vision.fitting.observed import Observed
from rfea_vision.fitting.refit import Fitted
from rfea_vision.fitting.uncertainty import uncertainty_of

#: A lever that the data tell no better than to this share is not told by them: its bounds are 25 % apart.
LOOSE_SHARE = 0.1


def only_ratio(fitted: Fitted, items: Sequence[Observed]) -> bool:
    """Whether the runs tell no more than the ratio of stiffness and lever: the lever's standard error is a tenth of it."""
    names = fitted.coordinates.names
    if not {"k_ref", "r_hyd"} <= set(names):
        return False
    found = uncertainty_of(fitted.solution, items)
    at = names.index("r_hyd")
    size = fitted.coordinates.matrix[6, at] * np.sqrt(found.covariance[at, at]) / fitted.par[6]
    return bool(found.undetermined[at] or size > LOOSE_SHARE)


def about_ratio(parameters: Mapping[str, tuple[float, float | None]], lever: float) -> str:
    """The sentence on a lever that was held because only the ratio is told; values with their 95 % half widths, SI."""
    value, half = parameters["k_ref"]
    within = "" if half is None else f" ± {half / lever:.2g}"
    return (
        f"k / r_hyd: these runs tell only the ratio, k_ref / r_hyd = {value / lever:.4g}{within} N/rad (95 %); r_hyd was held at "
        f"{lever * 1e3:.3g} mm, and k and b go with it."
    )
