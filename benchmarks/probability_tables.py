"""Counts of how often the critique's probabilities were right, and the document made of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median

from rfea_vision.critique.rule import RULE
from testing.claims import Claim, Line, bins, brier, calibration_error, claims

DOCUMENT = Path(__file__).parent.parent / "docs" / "probabilities.md"
DIAGRAM = DOCUMENT.with_suffix(".svg")
SURE = 0.9
#: A held-out error that is near that of a fit told the truth.
NEAR = 1.3
#: A base model whose error is below this many floors leaves less than one floor of structure: nothing there to be found.
LEAST_FLOORS = 2**0.5
_CALIBRATED_ON = "156 earlier campaigns (`calibration.jsonl`: `--sweep`)"


def document(lines: Sequence[Line], source: str) -> str:
    """The whole page of the lines of a file of such a name."""
    done = [line for line in lines if "error" not in line]
    each = {line["key"]: claims(line) for line in done}
    commits = ", ".join(dict.fromkeys(line["commit"] for line in lines))
    parts = [
        "# Probabilities, counted\n",
        f"Written by `python -m benchmarks.probabilities --tables --to benchmarks/probabilities/{source}`, from that file and\n"
        "nothing else.\n",
        f"{len(lines)} campaigns at commit {commits}, drawn before the method was finished and run once. The free numbers of the\n"
        f"rule (in [critique.md](critique.md)) were chosen on {_CALIBRATED_ON}, not on these.\n"
        f"{_share(lines, 'twin')} are drawn from the twin, {_share(lines, 'other')} from a second plant (`other`) that shares no "
        "code with model or twin, and whose laws\n"
        "have other forms than the catalogue's. All that was hidden counts, also what is too weak to be seen. A `kink` is a weak\n"
        "ring, counted as outside of the catalogue though `stiffness_profile:spot` is its formula.\n",
        "![How often a probability was right](probabilities.svg)\n",
        _counts("Both plants", done, each),
        *(
            _counts(f"Plant `{plant}`", [line for line in done if line["plant"] == plant], each)
            for plant in _plants(lines)
        ),
        *(_campaigns(plant, [line for line in lines if line["plant"] == plant]) for plant in _plants(lines)),
    ]
    return "\n".join(parts)


def diagram(lines: Sequence[Line], path: Path = DIAGRAM) -> None:
    """The reliability diagram: share of right claims over their probability, with its 95 % interval (Wilson 1927)."""
    import matplotlib as mpl
    from matplotlib.figure import Figure
    from scipy.stats import binomtest

    found = [one for line in lines if "error" not in line for one in claims(line)]
    figure = Figure(figsize=(4.2, 3.6), layout="constrained")
    axes = figure.add_subplot(
        xlabel="probability that was claimed", ylabel="share that was right", xlim=(0, 1), ylim=(0, 1)
    )
    axes.plot([0, 1], [0, 1], color="0.6", linewidth=1)
    for _, _, rows in bins(found):
        if rows:
            right, mean = sum(one[2] for one in rows), sum(one[1] for one in rows) / len(rows)
            interval = binomtest(right, len(rows)).proportion_ci(method="wilson")
            axes.plot([mean, mean], [interval.low, interval.high], color="C0", linewidth=1)
            axes.plot(mean, right / len(rows), "o", color="C0")
            axes.annotate(f"{len(rows)}", (mean, right / len(rows)), (5, -10), textcoords="offset points", fontsize=8)
    with mpl.rc_context({"svg.hashsalt": "rfea"}):
        figure.savefig(path, metadata={"Date": None})


def _share(lines: Sequence[Line], plant: str) -> int:
    return sum(line["plant"] == plant for line in lines)


def _plants(lines: Sequence[Line]) -> list[str]:
    return list(dict.fromkeys(line["plant"] for line in lines))


def _counts(title: str, lines: Sequence[Line], each: Mapping[str, Sequence[Claim]]) -> str:
    """Reliability, and what was found, of some campaigns."""
    found = [one for line in lines for one in each[line["key"]]]
    out = [
        f"## {title}: {len(lines)} campaigns\n",
        "| probability | claims | mean probability | right |",
        "|---|---|---|---|",
    ]
    for low, high, rows in bins(found):
        mean = f"{sum(p for _, p, _ in rows) / len(rows):.3f}" if rows else "-"
        out.append(f"| {low:g} to {high:g} | {len(rows)} | {mean} | {sum(right for *_, right in rows)} |")
    sure = [one for one in found if one[1] > SURE]
    wrong = [
        f"{name} ({p:.3f}) in {line['key']}"
        for line in lines
        for name, p, right in each[line["key"]]
        if p > SURE and not right
    ]
    out.append(
        f"\nExpected calibration error {calibration_error(found):.3f}, Brier score {brier(found):.3f}, over {len(found)} claims.\n"
        f"Wrong names above {SURE:g}: {len(wrong)} of {len(sure)}{': ' + '; '.join(wrong) if wrong else ''}.\n"
    )
    every = [*found, *(one for line in lines for one in untried(line))]
    if len(every) > len(found):
        out.append(
            f"Over all effects on offer, those that nothing spoke for too: expected calibration error {calibration_error(every):.3f}, "
            f"Brier score {brier(every):.3f}, over {len(every)} claims.\n"
        )
    ratios = [line["named_error"] / line["told_error"] for line in lines if line.get("told_error")]
    if ratios:
        within = sum(ratio <= NEAR for ratio in ratios)
        out.append(
            f"The held-out error of what was named is within {NEAR:g} times that of a fit told the truth (in the laws of the "
            f"catalogue) in {within} of {len(ratios)}; median ratio {median(ratios):.3f}.\n"
        )
    out += [
        "| hidden | campaigns | hidden effects | named | where the base model leaves a floor or more | named | without which the "
        "true model leaves a floor or more | named | whose absence adds a floor or more to what the true model leaves | named |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for kind in ("single", "pair", "triple"):
        own = [line for line in lines if line["kind"] == kind]
        seen = [line for line in own if line["floors"] >= LEAST_FLOORS]
        parts = [[one for line in group for one in each[line["key"]]] for group in (own, seen)]
        parts += [[one for line in own for one in seen(line, each[line["key"]])] for seen in (seen_alone, seen_to_add)]
        figures = [
            f"{sum(right for *_, right in part)} | {sum(right and p >= 0.5 for _, p, right in part)}" for part in parts
        ]
        out.append(f"| {kind} | {len(own)} | {' | '.join(figures)} |")
    nothing = [line for line in lines if line["kind"] == "nothing"]
    outside = [line for line in lines if line["kind"] == "outside"]
    out.append(
        f"\nNothing hidden: {sum(line['verdict'] == 'complete' for line in nothing)} of {len(nothing)} called complete, "
        f"{sum(bool(line['named']) for line in nothing)} given a name. "
        f"Outside of the catalogue: {sum(bool(line['named']) for line in outside)} of {len(outside)} given a name.\n"
    )
    return "\n".join(out)


def seen_alone(line: Line, found: Sequence[Claim]) -> list[Claim]:
    """Of the claims, of which the first are about what was hidden, those about effects without which a floor or more is left."""
    return [one for one, floors in zip(found, line.get("without", ()), strict=False) if (floors or 0.0) >= LEAST_FLOORS]


def seen_to_add(line: Line, found: Sequence[Claim]) -> list[Claim]:
    """Of the same claims, those about effects without which the true model leaves a floor more than with them.

    Where the catalogue's law is not the hidden one, the true model leaves floors itself, and whatever is left out of it seems to.
    """
    left = max(1.0, line["told_error"] / line["floor"]) if "told_error" in line else 1.0
    floors = zip(found, line.get("without", ()), strict=False)
    return [one for one, without in floors if (without or 0.0) ** 2 - left**2 >= LEAST_FLOORS**2 - 1]


def untried(line: Line) -> list[Claim]:
    """Effects on offer that were never refitted, and are not there: those that are stand among the claims already."""
    return [(name, RULE.unseen, False) for name in line.get("untried", ()) if name not in line["right"]]


def _campaigns(plant: str, lines: Sequence[Line]) -> str:
    out = [f"## Campaigns of `{plant}`\n", "| campaign | hidden | floors | named | verdict |", "|---|---|---|---|---|"]
    for line in lines:
        hidden = ", ".join(f"{name} {value:g}" for name, value in line.get("hidden", {}).items()) or "nothing"
        named = ", ".join(f"{one} ({line['probability'][one]:.2f})" for one in line.get("named", ())) or "-"
        floors = f"{line['floors']:.1f}" if "floors" in line else "-"
        out.append(f"| {line['key']} | {hidden} | {floors} | {named} | {line.get('verdict') or line['error']} |")
    return "\n".join([*out, ""])


__all__ = ["DIAGRAM", "DOCUMENT", "diagram", "document"]
