"""Counts of how often the critique's probabilities were right, and the document made of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from benchmarks.probable_campaigns import LAWS

DOCUMENT = Path(__file__).parent.parent / "docs" / "probabilities.md"
#: Edges of the reliability table: finer where a claim is strong.
EDGES = (0.0, 0.1, 0.5, 0.9, 1.0)
SURE = 0.9
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
    rows = [rows for _, _, rows in _bins(found) if rows]
    return sum(abs(sum(p - right for _, p, right in row)) for row in rows) / len(found)


def brier(found: Sequence[Claim]) -> float:
    """Mean squared difference of probability and truth (Brier 1950, doi:10.1175/1520-0493(1950)078<0001:VOFEIT>2.0.CO;2)."""
    return sum((p - right) ** 2 for _, p, right in found) / len(found)


def _bins(found: Sequence[Claim]) -> Iterator[tuple[float, float, list[Claim]]]:
    for low, high in pairwise(EDGES):
        yield low, high, [one for one in found if low <= one[1] < high or (high == EDGES[-1] and one[1] == high)]


def document(lines: Sequence[Line]) -> str:
    """The whole page."""
    parts = [
        "# Probabilities, counted\n",
        "Written by `python -m benchmarks.probabilities --tables` from `benchmarks/probabilities/results.jsonl` and nothing else.\n",
        f"{len(lines)} campaigns: far too few to call a probability calibrated. The one free number of the rule (n_s in\n"
        "[critique.md](critique.md)) was chosen on the campaigns of `calibration.jsonl` (`--sweep`), not on these. The second plant\n"
        "(`other`) shares no code with\n"
        "model or twin, and its laws have other forms than the catalogue's. A row speaks for the commit that it was run with.\n",
    ]
    for commit, plant in dict.fromkeys((line["commit"], line["plant"]) for line in lines):
        own = [line for line in lines if (line["commit"], line["plant"]) == (commit, plant)]
        parts.append(_section(f"Plant `{plant}` at {commit}", own))
    return "\n".join(parts)


def _section(title: str, lines: Sequence[Line]) -> str:
    done = [line for line in lines if "error" not in line]
    each = {line["key"]: claims(line) for line in done}
    found = [one for own in each.values() for one in own]
    out = [f"## {title}\n", "| campaign | hidden | named | verdict |", "|---|---|---|---|"]
    for line in lines:
        hidden = ", ".join(f"{name} {value:g}" for name, value in line.get("hidden", {}).items()) or "nothing"
        named = ", ".join(f"{one} ({line['probability'][one]:.2f})" for one in line.get("named", ())) or "-"
        out.append(f"| {line['key']} | {hidden} | {named} | {line.get('verdict') or line['error']} |")
    if not found:
        return "\n".join([*out, ""])
    out += ["\n| probability | claims | mean probability | right |", "|---|---|---|---|"]
    for low, high, rows in _bins(found):
        mean = f"{sum(p for _, p, _ in rows) / len(rows):.3f}" if rows else "-"
        out.append(f"| {low:g} to {high:g} | {len(rows)} | {mean} | {sum(right for *_, right in rows)} |")
    wrong = [
        f"{name} ({p:.3f}) in {key}" for key, own in each.items() for name, p, right in own if p > SURE and not right
    ]
    out.append(
        f"\nExpected calibration error {calibration_error(found):.3f}, Brier score {brier(found):.3f}, over {len(found)} claims.\n"
        f"Wrong names above {SURE:g}: {len(wrong)}{': ' + '; '.join(wrong) if wrong else ''}. "
        f"Hidden and not named: {sum(right and p < 0.5 for _, p, right in found)}.\n"
    )
    return "\n".join(out)


__all__ = ["DOCUMENT", "brier", "calibration_error", "claims", "document"]
