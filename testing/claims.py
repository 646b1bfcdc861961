"""What a critique's probabilities claim of a campaign whose physics is known, and how often such claims are right."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any

#: Of the second plant: law, the effect of the catalogue that it is a form of, and the range of its amplitude.
LAWS: dict[str, tuple[tuple[str, ...], float, float]] = {
    "soften_capped": (("mullins",), 0.05, 0.35),
    "soften_root": (("mullins",), 0.03, 0.15),
    "spot": (("stiffness_profile",), 0.2, 0.7),
    "stepped": (("stiffness_profile",), 0.03, 0.25),
    "play": (("hysteresis",), 1e-4, 2e-3),
    "stribeck": (("coulomb",), 5e-5, 1e-3),
    "spectrum": (("maxwell", "maxwell_2"), 0.005, 0.06),
    "stiffer_abs": (("nonlinear_stiffness",), 0.03, 0.3),
    "damping_root": (("nonlinear_damping",), 0.1, 1.0),
    "payload": (("payload",), 2e-4, 3e-3),
    "tilt": (("gravity_tilt",), 0.02, 0.2),
    "curl_root": (("rest_curvature", "rest_curvature_profile"), 0.03, 0.4),
    "line": (("pressure_lag",), 0.05, 0.4),
    "latency": (("time_offset",), 0.005, 0.1),
    "stiffer_pressure": (("pressure_stiffening",), 2e-7, 2e-6),
    "drag": (("drag",), 200.0, 2000.0),
    "clamp": (("base_rotation",), 0.03, 0.6),
    "damping_stepped": (("damping_profile",), 0.3, 0.8),
}
#: Edges of the reliability table: finer where a claim is strong.
EDGES = (0.0, 0.1, 0.5, 0.9, 1.0)
Line = dict[str, Any]
Claim = tuple[str, float, bool]


def claims(line: Line) -> list[Claim]:
    """What one campaign's diagnosis claims: names, their probability, and whether one of them is really there.

    A tie is one claim, and so are the effects that a hidden law is a form of; what was hidden and never refitted has the
    probability 0.
    """
    said: dict[str, float] = line["probability"]
    mates = {name: tuple(tie) for tie in line["tied"] for name in tie}
    used, out = set[str](), list[Claim]()
    for group in _hidden(line):
        members = dict.fromkeys(mate for one in group for mate in mates.get(one, (one,)))
        used |= set(members)
        out.append((" or ".join(members), max(said.get(one, 0.0) for one in members), True))
    for name in said:
        members = mates.get(name, (name,))
        if not used & set(members):
            used |= set(members)
            out.append((" or ".join(members), said[name], False))
    return out


def _hidden(line: Line) -> list[tuple[str, ...]]:
    """For each law that was hidden the effects that it may be called."""
    if line["plant"] == "other":
        return [LAWS[law][0] for law in line["hidden"] if law in LAWS]
    return [(name,) for name in line["right"]]


def calibration_error(found: Sequence[Claim]) -> float:
    """Expected calibration error: mean over the bins of |mean probability - share of right ones|, weighted by their claims."""
    rows = [rows for _, _, rows in bins(found) if rows]
    return sum(abs(sum(p - right for _, p, right in row)) for row in rows) / len(found)


def brier(found: Sequence[Claim]) -> float:
    """Mean squared difference of probability and truth (Brier 1950, doi:10.1175/1520-0493(1950)078<0001:VOFEIT>2.0.CO;2)."""
    return sum((p - right) ** 2 for _, p, right in found) / len(found)


def bins(found: Sequence[Claim]) -> Iterator[tuple[float, float, list[Claim]]]:
    for low, high in pairwise(EDGES):
        yield low, high, [one for one in found if low <= one[1] < high or (high == EDGES[-1] and one[1] == high)]
