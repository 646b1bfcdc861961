"""Whether the parameters can be believed: the paper's recipe on its own table, coverage of the intervals, study of segments.

Data: tracks of the independent plant (MuJoCo) whose joints are those of the model, so that the truth is known for each
parameter. Every draw of noise is fitted anew.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from rfea_vision.artefacts import Actuator, ModelFit, Recording
from rfea_vision.fitting.intervals import intervals
from rfea_vision.fitting.problem import make_problem
from rfea_vision.fitting.refit import refit
from rfea_vision.options import FitOptions
from rfea_vision.stages import open_campaign
from rfea_vision.stages.recipes import load_recipe, run_recipe
from rfea_vision.twin import TwinOptions, paper_campaign, simulate
from rfea_vision.twin.draw import noise_like

DRAWS = 100
SEGMENTS = 4
NOISE_MM = 0.06


def paper_recipe(folder: Path) -> tuple[ModelFit, ModelFit, dict[str, float]]:
    """Models of pipelines/paper.yaml with 8 and with 2 bodies, and the true parameters."""
    campaign = folder / "paper"
    truth = simulate(campaign, replace(paper_campaign(), duration_s=6.0, seed=1))
    work = open_campaign(campaign)
    run_recipe(work, load_recipe("paper"))
    return work.model("paper-8dof"), work.model("paper-2dof"), truth["base"]


def exact_tracks(folder: Path) -> tuple[dict[str, xr.Dataset], Actuator, dict[str, float]]:
    """Two runs of 3 s at 120 Hz without noise, and the parameters behind them."""
    options = TwinOptions(
        joints=SEGMENTS,
        layout="start",
        roles=("train", "train"),
        duration_s=3.0,
        rate_Hz=120,
        seed=3,
        noise_mm=0.0,
        pressure_noise_kPa=0.0,
        sync="common_clock",
        step_s=0.00025,
    )
    truth = simulate(folder / "exact", options)
    recordings = open_campaign(folder / "exact").recordings("train")
    runs = {name: item.dataset.load() for name, item in recordings.items()}
    base = {name: value * (1 if name == "r_hyd" else SEGMENTS / 8) for name, value in truth["base"].items()}
    return runs, options.actuator, base


def seen(data: xr.Dataset, observe: str, correlation: float, generator: np.random.Generator) -> Recording:
    """A run with noise on its midline, or on its tip alone."""
    if observe == "midline":
        line = data["midline"].values + noise_like(data["midline"].shape, NOISE_MM, correlation, generator)
        data = data.assign(midline=(data["midline"].dims, line), tip=(("time", "xy"), line[:, -1]))
        return Recording(data.assign(midline_sigma=(("time", "node"), np.full(line.shape[:2], NOISE_MM))))
    tip = data["tip"].values + noise_like(data["tip"].shape, NOISE_MM, correlation, generator)
    data = data.drop_vars(["midline", "midline_sigma"]).assign(tip=(("time", "xy"), tip))
    return Recording(data.assign(tip_sigma=(("time", "xy"), np.full(tip.shape, NOISE_MM))))


def coverage(
    runs: dict[str, xr.Dataset], actuator: Actuator, truth: dict[str, float], observe: str, correlation: float
) -> dict[str, float]:
    """Share of draws, in percent, in which the 95 % interval holds the truth, for each parameter."""
    options = FitOptions(segments=SEGMENTS, joints="start", observe=observe)  # type: ignore[arg-type]
    hits = dict.fromkeys(truth, 0)
    for draw in range(DRAWS):
        generator = np.random.default_rng([41, draw])
        recordings = {name: seen(data, observe, correlation, generator) for name, data in runs.items()}
        problem = make_problem(recordings, actuator, options)
        fitted = refit(problem, options, truth, SEGMENTS)
        found = intervals(fitted, problem.train, actuator).parameters
        for name, value in truth.items():
            interval = found[name].interval_95
            hits[name] += int(interval is not None and interval[0] <= value <= interval[1])
    return {name: 100 * count / DRAWS for name, count in hits.items()}


def rows_of_recipe(folder: Path) -> list[dict[str, Any]]:
    """What the recipe gives back of the table it was fed with."""
    model, coarse, truth = paper_recipe(folder)
    off = {name: 100 * abs(model.parameters[name].value / truth[name] - 1) for name in ("k_ref", "r_hyd")}
    inside = sum(
        p.interval_95 is not None and p.interval_95[0] <= truth[name] <= p.interval_95[1]
        for name, p in model.parameters.items()
    )
    tip, coarse_tip = model.metrics["validate"].tip_rmse_mm, coarse.metrics["validate"].tip_rmse_mm
    rows: list[dict[str, Any]] = [
        {
            "name": f"paper's recipe on the paper's 8-DoF table: error of {name}",
            "value": round(error, 3),
            "unit": "%",
            "target": 1,
            "met": error <= 1,
        }
        for name, error in off.items()
    ]
    rows.append(
        {
            "name": "paper's recipe: parameters inside their own 95 % interval, of 7",
            "value": inside,
            "unit": "",
            "target": 7,
            "met": inside == 7,
        }
    )
    rows.append(
        {
            "name": "paper's recipe: validation tip at 220 kPa",
            "value": round(tip or np.nan, 3),
            "unit": "mm",
            "target": 0.1,
            "met": tip is not None and tip <= 0.1,
            "against": f"noise floor {model.noise_floor_mm:.3f} mm; with 2 bodies {coarse_tip:.2f} mm",
        }
    )
    for row in model.segments_study:
        rows.append(
            {
                "name": f"study over segments, n = {row['segments']}: validation tip",
                "value": round(row["validate_tip_rmse_mm"], 3),
                "unit": "mm",
                "against": f"x {row['validate_tip_x_rmse_mm']:.3f} mm, y {row['validate_tip_y_rmse_mm']:.3f} mm",
            }
        )
    return rows


def run() -> list[dict[str, Any]]:
    """Rows of results."""
    with tempfile.TemporaryDirectory() as folder:
        rows = rows_of_recipe(Path(folder))
        runs, actuator, truth = exact_tracks(Path(folder))
        for observe, correlation in (("tip", 0.0), ("midline", 0.0), ("tip", 0.9)):
            shares = coverage(runs, actuator, truth, observe, correlation)
            low, high = min(shares.values()), max(shares.values())
            kind = f"correlated noise ({correlation:g} from frame to frame)" if correlation else "white noise"
            rows.append(
                {
                    "name": f"{observe}, {kind}: draws in which the 95 % interval holds, lowest and highest parameter",
                    "value": f"{low:.0f} to {high:.0f}",
                    "unit": "%",
                    "target": "90 to 99",
                    "met": bool(low >= 90 and high <= 99),
                    "against": ", ".join(f"{name} {share:.0f}" for name, share in shares.items()),
                }
            )
    return rows
