"""Is the critique right on tubes that nobody has looked at? ``python -m benchmarks.blind``, and ``--unseen`` once, at the end.

Campaigns of the third plant (testing/third_plant.py): tubes and rods, hanging, upright or level, seen as a midline, as a tip, or by
an angle sensor at 25 Hz. Each row of ``blind/results.jsonl`` is one run with its commit, and stays: the table shows all.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from scipy.interpolate import PchipInterpolator

from benchmarks._commit import commit
from benchmarks.probabilities import read_results, run_case
from benchmarks.probable_campaigns import Case, even
from rfea_vision.artefacts import Actuator, Recording
from rfea_vision.errors import RfeaError
from testing.third_plant import INNER, OUTER, ThirdTube, centre_line, simulate

RESULTS = Path(__file__).parent / "blind" / "results.jsonl"
SEEN, UNSEEN = range(1, 13), range(13, 25)
NOISE_MM, ANGLE_NOISE_DEG, DURATION_S, LOG_HZ = 0.06, 0.2, 8.0, 500.0
ROLES = ("train", "train", "validate")
RATES_HZ = {"midline": 50.0, "tip": 50.0, "angle": 25.0}
#: Of each law the effects that it may be called, the range of its amplitude, and whether its sign is drawn.
LAWS: dict[str, tuple[tuple[str, ...], float, float, bool]] = {
    "cap": (("payload",), 2e-4, 3e-3, False),
    "lean": (("gravity_tilt",), 0.01, 0.15, True),
    "set": (("rest_curvature", "rest_curvature_profile"), 0.02, 0.3, True),
    "taper": (("stiffness_profile",), 0.02, 0.25, False),
    "fung": (("nonlinear_stiffness",), 0.01, 0.2, False),
    "creep": (("maxwell", "maxwell_2"), 0.003, 0.05, False),
    "dahl": (("hysteresis",), 1e-4, 1.5e-3, False),
    "rub": (("coulomb",), 1e-4, 1e-3, False),
    "shear": (("nonlinear_damping",), 0.1, 1.0, False),
    "air": (("drag",), 50.0, 800.0, False),
    "orifice": (("pressure_lag",), 0.01, 0.1, False),
    "late": (("time_offset",), 0.005, 0.06, False),
    "gain": (("pressure_gain",), 0.5, 1.2, False),
    "zero": (("pressure_offset",), 5e2, 8e3, True),
    "fatigue": (("mullins",), 0.03, 0.3, False),
    "wall": (("contact",), 2e-3, 5e-2, False),
    "clamp": (("base_rotation",), 0.02, 0.4, False),
    "inertance": (("fluid_inertia",), 3e7, 5e8, False),
}
OUTSIDE = {
    "wind": (0.1, 1.0), "string": (0.5, 10.0), "ring": (3e-4, 4e-3), "fold": (0.2, 0.8), "warm": (0.02, 0.15), "leak": (0.02, 0.15),
    "jet": (1e-8, 2e-7), "shake": (2e-4, 1e-3), "bore": (0.5, 1.0),
}  # fmt: skip
#: Partners that are drawn with their law.
PARTNERS = {
    "cap": {"cap_far": (1e-3, 8e-3), "cap_beside": (0.2, 2.0)},
    "dahl": {"dahl_w": (0.1, 0.6)},
    "fatigue": {"fatigue_at": (0.5, 2.0)},
    "wall": {"wall_at": (0.03, 0.08)},
    "ring": {"ring_at": (0.3, 0.6)},
    "fold": {"fold_at": (0.25, 0.6)},
    "shake": {"shake_Hz": (2.0, 5.0)},
}
KINDS = {"nothing": 0.1, "single": 0.35, "pair": 0.2, "triple": 0.1, "outside": 0.25}


def draw(seed: int) -> tuple[Case, ThirdTube, str]:
    """One campaign: what hides in it, its tube, and how it is seen."""
    rng = np.random.default_rng([seed, 333])
    kind, view = str(rng.choice(list(KINDS), p=list(KINDS.values()))), str(rng.choice(list(RATES_HZ), p=[0.5, 0.25, 0.25]))
    rod, gravity = bool(rng.uniform() < 0.25), float(rng.choice([0.0, 90.0, 180.0], p=[0.6, 0.2, 0.2]))
    factors = tuple(float(v) for v in rng.uniform(0.85, 1.2, 3))
    hidden: dict[str, float] = {}
    names = [str(n) for n in rng.permutation(list(LAWS))[: {"single": 1, "pair": 2, "triple": 3}.get(kind, 0)]]
    if kind == "outside":
        names = [str(rng.choice([n for n in OUTSIDE if not (rod and n == "bore")]))]
    for name in names:
        low, high, signed = LAWS[name][1:] if name in LAWS else (*OUTSIDE[name], name == "wind")
        hidden[name] = even(rng, low, high) * (float(rng.choice([-1, 1])) if signed else 1.0)
        hidden |= {partner: even(rng, *span) for partner, span in PARTNERS.get(name, {}).items()}
    laws = tuple(LAWS[name][0] for name in names if name in LAWS)
    return Case("third", seed, kind, hidden, laws, view == "angle"), ThirdTube(rod, gravity, factors, hidden), view


def recordings_of(case: Case) -> tuple[dict[str, Recording], Actuator]:
    """Make a campaign that `draw` has drawn."""
    _, tube, view = draw(case.seed)
    rng = np.random.default_rng([case.seed, 77])
    log_s, frame_s = np.arange(0, DURATION_S + 0.3, 1 / LOG_HZ), np.arange(0, DURATION_S, 1 / RATES_HZ[view])
    out = {}
    for index, role in enumerate(ROLES):
        pressure = programme(rng)
        phi = simulate(tube, pressure, frame_s)
        seen: dict[str, Any] = {"valid": ("time", np.ones(frame_s.size, dtype=np.int8))}
        seen["reason"] = ("time", np.full(frame_s.size, "", dtype=object))
        if view == "angle":
            angle = np.rad2deg(phi[:, -1]) + ANGLE_NOISE_DEG * rng.standard_normal(frame_s.size)
            seen |= {"bend_angle": ("time", angle), "bend_angle_sigma": ("time", np.full(frame_s.size, ANGLE_NOISE_DEG))}
        else:
            line = 1e3 * centre_line(tube, phi, np.linspace(0, 1, 9 if view == "midline" else 2))
            line[:, 1:] += NOISE_MM * rng.standard_normal(line[:, 1:].shape)
            seen |= {"tip": (("time", "xy"), line[:, -1]), "tip_sigma": (("time", "xy"), np.full((frame_s.size, 2), NOISE_MM))}
            if view == "midline":
                seen["midline"] = (("time", "node", "xy"), line)
                seen["midline_sigma"] = (("time", "node"), np.full(line.shape[:2], NOISE_MM))
        seen["pressure"] = ("log_time", pressure(log_s) / 1e3)
        kept = {"experiment": f"run{index}", "role": role, "bends": "left", "gravity_deg": tube.gravity_deg}
        clock = {"sync_method": "offset", "offset_s": 0.0, "offset_stderr_s": 0.0}
        times = {"time": ("time", frame_s, {"units": "s"}), "log_time": ("log_time", log_s), "xy": ["x", "y"]}
        out[f"run{index}"] = Recording(xr.Dataset(seen, coords=times, attrs={**kept, **clock}))
    return out, Actuator(kind="rod" if tube.rod else "tube", outer_radius=OUTER, inner_radius=INNER)


def programme(rng: np.random.Generator) -> PchipInterpolator:
    """Pressure (Pa over s) of one run: from rest through levels in an order of its own, some held, no corner anywhere."""
    top, at, levels = rng.uniform(1.2e5, 2.2e5), [0.0, 0.4], [0.0, 0.0]
    while at[-1] < DURATION_S + 0.3:
        level = top * rng.uniform(0, 1)
        at.append(at[-1] + rng.uniform(0.15, 0.8))
        levels.append(level)
        if rng.uniform() < 0.4:
            at.append(at[-1] + rng.uniform(0.2, 1.0))
            levels.append(level)
    return PchipInterpolator(at, levels)


def run_all(seeds: Sequence[int], path: Path) -> None:
    """Run campaigns of these seeds with this version, each kept as soon as it is finished."""
    path.parent.mkdir(exist_ok=True)
    version = commit()
    done = {(line["seed"], line["commit"]) for line in read_results(path)}
    for seed in seeds:
        case, tube, view = draw(seed)
        if (seed, version) in done:
            continue
        rig = {"rod": tube.rod, "gravity_deg": tube.gravity_deg, "view": view, "commit": version}
        try:
            line = {**run_case(case, recordings_of), **rig}
        except (RfeaError, ArithmeticError, np.linalg.LinAlgError) as error:
            line = {"key": case.key, "seed": seed, "kind": "failed", "hidden": case.hidden, "error": str(error), **rig}
        with path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(line) + "\n")
        sys.stderr.write(said(line) + "\n")


def said(line: dict[str, Any]) -> str:
    """One row: what hides, how it was seen, what was named how surely, errors in floors, processor time, commit."""
    hidden = ", ".join(f"{k} {v:.3g}" for k, v in line["hidden"].items()) or "nothing"
    rig = f"{'rod' if line['rod'] else 'tube'}, {line['gravity_deg']:.0f} deg, {line['view']}"
    if line["kind"] == "failed":
        return f"| {line['seed']} | {hidden} | {rig} | failed: {line['error']} | | | | {line['commit']} |"
    told = {tuple(tie): " or ".join(tie) for tie in line["tied"]}
    names = [next((words for tie, words in told.items() if tie[0] == name), name) for name in line["named"]]
    named = ", ".join(f"{words} {line['probability'][name]:.2f}" for words, name in zip(names, line["named"], strict=True))
    numbers = f"{line['floors']:.1f} | {line['left']:.1f} | {line['processor_s']:.0f} | {line['commit']} |"
    return f"| {line['seed']} | {hidden} | {rig} | {named or line['verdict']} | {numbers}"


def table(lines: Sequence[dict[str, Any]]) -> str:
    """All rows, first and last run of every seed, seen and unseen apart."""
    out = []
    for title, seeds in (("Looked at", SEEN), ("Unseen, run once", UNSEEN)):
        rows = [line for seed in seeds for line in [one for one in lines if one["seed"] == seed]]
        out += [f"## {title}", "", "| seed | hidden | rig | named | floors before | after | processor s | commit |", "|---" * 8 + "|"]
        out += [*map(said, rows), ""]
    return "\n".join(out)


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.blind", description=__doc__)
    parser.add_argument("seeds", type=int, nargs="*", help="campaigns to run (default: those that may be looked at)")
    parser.add_argument("--unseen", action="store_true", help="the campaigns that nobody has looked at")
    parser.add_argument("--to", type=Path, default=RESULTS, help="file of the lines")
    parser.add_argument("--table", action="store_true", help="print the table of the lines, and run nothing")
    given = parser.parse_args(arguments)
    if given.table:
        sys.stdout.write(table(read_results(given.to)))
        return 0
    run_all(given.seeds or (UNSEEN if given.unseen else SEEN), given.to)
    return 0


if __name__ == "__main__":
    sys.exit(main())
