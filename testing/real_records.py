"""Readers of the real data beside the checkout, shared by the benchmarks and the tests."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import scipy.io
import yaml

from rfea_vision.dynamics.simulation import Chain
from testing.chain_diagnosis import ChainMotion, ChainRecord, low_pass, residual_torque

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"


@dataclass(frozen=True)
class TwoLinks:
    """The published two-link chain: its model, its friction, and the residual torque of each run copied here."""

    chain: Chain
    published: dict[str, float]
    records: dict[str, ChainRecord]
    motions: dict[str, ChainMotion]


def two_links(data: Path = SHARED) -> TwoLinks:
    """Read design A.0, model 2.0, runs 00 and 12; the inertias there are about the joints, ours about the centres."""
    folder = data / "two-link-chain" / "data"
    text = folder / "system_identification/identified_parameters/design_A.0/model_2.0/model_parameters.yml"
    p = yaml.safe_load(text.read_text(encoding="utf-8"))
    chain = Chain.general(
        [p["l1"], p["l2"]],
        [p["m1"], p["m2"]],
        [p["r1"], p["r2"]],
        [p["I1"] - p["m1"] * p["r1"] ** 2, p["I2"] - p["m2"] * p["r2"] ** 2],
    )
    records, motions = {}, {}
    for run in ("00", "12"):
        table = pd.read_csv(folder / f"experiment_records/design_A.0/20220815/sys_id/trajectory_{run}.csv")
        records[run] = ChainRecord(
            table["time"].to_numpy(),
            table[["pos_meas1", "pos_meas2"]].to_numpy(),
            table[["tau_meas1", "tau_meas2"]].to_numpy(),
        )
        rotor = p["Ir"] * p["gr"] ** 2
        motions[run] = residual_torque(chain, records[run], rotor_inertia=[rotor, rotor], gravity=p["g"])
    return TwoLinks(chain, p, records, motions)


def published_friction(links: TwoLinks, run: str, joint: int) -> np.ndarray:
    """Friction torque of the published model along a run: b v + cf atan(100 v), after the same low-pass (N m)."""
    motion = links.motions[run]
    rate, p = motion.rate[:, joint - 1], links.published
    torque = p[f"b{joint}"] * rate + p[f"cf{joint}"] * np.arctan(100 * rate)
    return low_pass(torque, motion.step_s, motion.cutoff_Hz)


@dataclass(frozen=True)
class PressureTable:
    """One configuration of the static actuator: pressures (unit unstated there), tip in the rig frame (mm)."""

    name: str
    pressure: np.ndarray
    tip_mm: np.ndarray
    length_mm: float


def pressure_tables(data: Path = SHARED) -> dict[str, PressureTable]:
    """Read all configurations. x there is along the actuator, y across it; theta is the direction of the tip as seen from the base.

    The base's distance, L in tan(theta) = y / (L + x), comes out at 135.0 mm in all but a few of them.
    """
    file = data / "static-pressure-tip" / "OverLapMat.mat"
    rows = scipy.io.loadmat(str(file), squeeze_me=True, struct_as_record=False)["config"]
    found = {}
    for row in rows:
        p, x, y, theta = (np.asarray(v, dtype=float) for v in (row.p, row.x, row.y, row.theta))
        length = float(np.median(np.abs(y[1:]) / np.tan(np.deg2rad(np.abs(theta[1:]))) - x[1:]))
        found[str(row.name)] = PressureTable(str(row.name), p, np.column_stack([-np.abs(y), -(135.0 + x)]), length)
    return found
