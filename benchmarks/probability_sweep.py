"""What another n_s would have said of campaigns that were run: all sets that were refitted stand in their lines."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.optimize import minimize

from benchmarks.probability_tables import SURE
from rfea_vision.critique.rule import RULE, Rule
from rfea_vision.effects.catalogue import catalogue
from testing.claims import Claim, brier, calibration_error, claims

TRIED = (2, 3, 4, 5, 6, 8, 10, 14)


def probabilities(line: dict[str, Any], rule: Rule) -> dict[str, float]:
    """Of every effect of one campaign: that it, or a member of its tie, is there, as this rule weighs the refits."""
    count = rule.count(line["independent"])
    weights = []
    for item in line["sets"]:
        roles = dict.fromkeys(item["excess"], "train") | {list(item["excess"])[-1]: "validate"}  # the last run judges
        price = rule.price(len(item["effects"]), len(catalogue()))
        weights.append(rule.evidence(item["excess"], roles, line["room"], count) - price)
    each = rule.posterior(weights)
    mates = {name: set(tie) for tie in line["tied"] for name in tie}
    found = {name for item in line["sets"] for name in item["effects"]}
    return {
        name: rule.told(
            sum(p for item, p in zip(line["sets"], each, strict=True) if mates.get(name, {name}) & set(item["effects"]))
        )
        for name in found
    }


def sweep(lines: Sequence[dict[str, Any]]) -> str:
    """A table of n_s: calibration error, Brier score, names, wrong ones, and what was hidden and found."""
    out = [
        "| n_s | calibration error | Brier | named | wrong | above 0.9 | wrong | hidden | found |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for count in TRIED:
        rule = Rule(independent=count)
        rows: list[Claim] = [
            one
            for line in lines
            if "sets" in line
            for one in claims({**line, "probability": probabilities(line, rule)})
        ]
        named, sure = [r for r in rows if r[1] >= rule.likely], [r for r in rows if r[1] > SURE]
        hidden = [r for r in rows if r[2]]
        figures = [
            f"{count}", f"{calibration_error(rows):.3f}", f"{brier(rows):.3f}", f"{len(named)}", f"{sum(not r[2] for r in named)}",
            f"{len(sure)}", f"{sum(not r[2] for r in sure)}", f"{len(hidden)}", f"{sum(r[1] >= rule.likely for r in hidden)}",
        ]  # fmt: skip
        out.append("| " + " | ".join(figures) + " |")
    outside, unseen = shares(lines)
    return "\n".join(
        [
            *out,
            f"\nShares of most likelihood at n_s = {RULE.independent:g}: outside {outside:.3f}, unseen {unseen:.3f}.",
        ]
    )


def shares(lines: Sequence[dict[str, Any]]) -> tuple[float, float]:
    """Share of strong claims that a cause outside of the catalogue makes, and of hidden effects among those nothing speaks for.

    Those under which the effects that were refitted, right and wrong, are most likely.
    """
    bare = Rule(outside=0.0, unseen=0.0)
    found = [
        one for line in lines if "sets" in line for one in claims({**line, "probability": probabilities(line, bare)})
    ]
    given = np.array([p for _, p, _ in found if p > 0])
    right = np.array([r for _, p, r in found if p > 0])

    def surprise(shares: np.ndarray) -> float:
        told = np.clip(shares[1] + (1 - shares.sum()) * given, 1e-6, 1 - 1e-6)
        return -float(np.sum(np.log(np.where(right, told, 1 - told))))

    best = minimize(surprise, [0.05, 0.02], method="Nelder-Mead").x
    return float(best[0]), float(best[1])
