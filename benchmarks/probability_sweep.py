"""What another n_s or f would have said of campaigns that were run: all sets that were refitted stand in their lines."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any

from benchmarks.probability_tables import SURE
from rfea_vision.critique.rule import RULE, Rule
from rfea_vision.effects.catalogue import catalogue
from testing.claims import Claim, brier, calibration_error, claims

TRIED = (4, 8, 12, 16, 24)
TRIED_FORMS = (0.0, 0.03, 0.05, 0.08)
#: Nothing speaks for an effect whose probability is below this.
FAINT = 0.02


def probabilities(line: dict[str, Any], rule: Rule) -> dict[str, float]:
    """Of every effect of one campaign: that it, or a member of its tie, is there, as this rule weighs the refits."""
    count = rule.count(line["independent"])
    weights = []
    whole = next(item["excess"] for item in line["sets"] if not item["effects"])
    for item in line["sets"]:
        roles = dict.fromkeys(item["excess"], "train") | {list(item["excess"])[-1]: "validate"}  # the last run judges
        price = rule.price(len(item["effects"]), len(catalogue()))
        weights.append(rule.evidence(item["excess"], whole, roles, line["room"], count) - price)
    each = rule.posterior(weights)
    mates = {name: set(tie) for tie in line["tied"] for name in tie}
    found = {name for item in line["sets"] for name in item["effects"]}
    imitated, out = imitated_effects(), {}
    for name in found:
        have = [mates.get(name, {name}) & set(item["effects"]) for item in line["sets"]]
        out[name] = rule.told((p, bool(own & imitated)) for own, p in zip(have, each, strict=True) if own)
    return out


def imitated_effects() -> set[str]:
    """Effects that a cause outside of the catalogue imitates, as their files say."""
    return {name for name, effect in catalogue().items() if effect.imitated_by}


def sweep(lines: Sequence[dict[str, Any]]) -> str:
    """A table of n_s and f: calibration error, Brier score, names, wrong ones, and what was hidden and found."""
    out = [
        "| n_s | f | calibration error | Brier | named | wrong | above 0.9 | wrong | hidden | found |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for count, form in product(TRIED, TRIED_FORMS):
        rule = Rule(independent=count, form=form)
        rows: list[Claim] = [
            one
            for line in lines
            if "sets" in line
            for one in claims({**line, "probability": probabilities(line, rule)})
        ]
        named, sure = [r for r in rows if r[1] >= rule.likely], [r for r in rows if r[1] > SURE]
        hidden = [r for r in rows if r[2]]
        figures = [
            f"{count}", f"{form:g}", f"{calibration_error(rows):.3f}", f"{brier(rows):.3f}",
            f"{len(named)}", f"{sum(not r[2] for r in named)}",
            f"{len(sure)}", f"{sum(not r[2] for r in sure)}", f"{len(hidden)}", f"{sum(r[1] >= rule.likely for r in hidden)}",
        ]  # fmt: skip
        out.append("| " + " | ".join(figures) + " |")
    outside, unseen = shares(lines)
    return "\n".join(
        [
            *out,
            f"\nAt n_s = {RULE.independent:g} and f = {RULE.form:g}, by Laplace's rule: outside {outside:.3f}, unseen {unseen:.3f}.",
        ]
    )


def shares(lines: Sequence[dict[str, Any]]) -> tuple[float, float]:
    """Share of wrong ones among strong claims, and of right ones among those that nothing speaks for, by Laplace's rule of succession.

    Of the effects that were refitted, as the bare rule weighs them, that leaves nothing to causes outside of the sets.
    """
    bare = Rule(outside=0.0, unseen=0.0, imitated=0.0)
    found = [
        one for line in lines if "sets" in line for one in claims({**line, "probability": probabilities(line, bare)})
    ]
    strong = [right for _, p, right in found if p > SURE]
    faint = [right for _, p, right in found if 0 < p < FAINT]
    return (len(strong) - sum(strong) + 1) / (len(strong) + 2), (sum(faint) + 1) / (len(faint) + 2)


def imitations(lines: Sequence[dict[str, Any]]) -> str:
    """How many claims above 0.9 of what a cause outside imitates were right, and what Laplace's rule makes of it."""
    found = [one for line in lines if "probability" in line for one in claims(line)]
    imitated = imitated_effects()
    strong = [right for names, p, right in found if p > SURE and imitated & set(names.split(" or "))]
    share = (len(strong) - sum(strong) + 1) / (len(strong) + 2)
    return f"Of what a cause outside imitates {sum(strong)} of {len(strong)} claims above {SURE:g} were right: imitated {share:.3f}."
