"""Counts of how often the critique's probabilities were right, and the document made of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from testing.claims import Line, bins, brier, calibration_error, claims

DOCUMENT = Path(__file__).parent.parent / "docs" / "probabilities.md"
SURE = 0.9


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
    for low, high, rows in bins(found):
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
