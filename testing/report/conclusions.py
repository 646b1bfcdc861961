# ruff: noqa: RUF005 (tables read better whole)
"""What a made-up campaign concludes: fits, comparisons, diagnoses and a calibration, numbers drawn and not fitted."""

from __future__ import annotations

import numpy as np
import xarray as xr

from rfea_vision.artefacts import Actuator, Calibration, Comparison, Diagnosis, ModelFit
from testing.report.plant import LENGTH_MM, RADIUS_MM, ROLES, RUNGS, SEGMENTS


def error_of(predicted: xr.Dataset) -> np.ndarray:
    return np.linalg.norm(predicted.tip_residual.values, axis=-1)


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def scores(predicted: dict[str, xr.Dataset]) -> dict[str, dict]:
    return {
        name: {
            "role": ROLES.get(name, "train"),
            "tip_rmse_mm": rms(error_of(d)),
            "tip_y_rmse_mm": rms(d.tip_residual.values[:, 1]),
            "midline_rmse_mm": rms(d.normal_residual.values),
            "angle_rmse_deg": rms(error_of(d)) * 0.4,
            "tip_rmse_percent_of_length": 100 * rms(error_of(d)) / LENGTH_MM,
            "frames_used": d.sizes["time"],
        }
        for name, d in predicted.items()
    }


LAWS = {
    "maxwell": {
        "title": "Visco-elastic relaxation (Maxwell branch)", "reference": "Ferry, Viscoelastic Properties of Polymers, 1980",
        "latex": r"\tau_j = -k_1 k_{\mathrm{ref}} \left(\theta_j - z_j\right), \qquad \dot z_j = \frac{\theta_j - z_j}{T}",
        "text": "Part of the rubber's torque relaxes with the time constant T.",
    },
    "gravity_tilt": {
        "title": "Gravity tilted in the plane", "reference": "Geometry of the rig",
        "latex": r"\vec g = -g \left(\sin\alpha, \cos\alpha\right)",
        "text": "Gravity is turned by the angle alpha in the plane of motion.",
    },
}  # fmt: skip


def parameter(value: float, unit: str, relative: float, **more: object) -> dict:
    half = 1.96 * relative * abs(value)
    return {
        "value": value,
        "unit": unit,
        "stderr": relative * abs(value),
        "interval_95": [value - half, value + half],
    } | more


def model_fit(rung: int, predicted: dict[str, xr.Dataset]) -> ModelFit:
    effects = RUNGS[rung].split("+")[1:]
    table = scores(predicted)
    off = (1.08, 1.01, 1.0)[rung]
    parameters = {
        "k_ref": parameter(0.0845 * off, "N m/rad", 2e-4, lower=0.01, upper=1.0),
        "k_slope": parameter(132.0 / off, "N/rad", 3e-3),
        "b_pos_ref": parameter(8.97e-4 * off**3, "N m s/rad", 4e-3),
        "b_pos_slope": parameter(1.31, "N s/rad", 2e-2),
        "b_neg_ref": parameter(5.5e-4 * off**2, "N m s/rad", 5e-3),
        "b_neg_slope": parameter(0.92, "N s/rad", 2e-2),
        "r_hyd": parameter(3.62e-3, "m", 2e-4, lower=3e-3, upper=5e-3),
    }
    if "maxwell" in effects:
        parameters |= {"maxwell.k1": parameter(0.041, "1", 0.01), "maxwell.T": parameter(1.21, "s", 0.015)}
    if "gravity_tilt" in effects:
        parameters |= {"gravity_tilt.angle": parameter(0.0349, "rad", 0.01)}
    names = list(parameters)
    matrix = 0.2 * np.cos(np.add.outer(np.arange(len(names)), 2.0 * np.arange(len(names))))
    matrix = (matrix + matrix.T) / 2
    matrix[0, 1] = matrix[1, 0] = -0.93
    np.fill_diagonal(matrix, 1.0)
    metrics = {
        role: {
            key: rms(np.array([row[key] for row in table.values() if row["role"] == role]))
            for key in (
                "tip_rmse_mm",
                "tip_y_rmse_mm",
                "midline_rmse_mm",
                "angle_rmse_deg",
                "tip_rmse_percent_of_length",
            )
        }
        for role in sorted({row["role"] for row in table.values()} - ({"test"} if rung < len(RUNGS) - 1 else set()))
    }
    bend = np.linspace(0, 270, 10)
    return ModelFit.model_validate({
        "name": RUNGS[rung], "segments": SEGMENTS, "effects": effects, "status": "converged",
        "message": "Converged in 14 steps: the last one changed the cost by less than one part in a million.",
        "actuator": Actuator().as_dict(), "parameters": parameters,
        "paper_parameters": {"k_0": parameter(-0.0394, "N m/deg", 0.3), "m_k": parameter(14.1, "N/deg", 0.2)},
        "correlation": {"names": names, "matrix": matrix.tolist()}, "metrics": metrics, "noise_floor_mm": 0.085,
        "noise_floor_source": "the track's own standard errors", "experiments": table,
        "warnings": ["k_ref and k_slope are correlated at -0.93: read them together."] if rung == 0 else [],
        "steady_state": {
            "pressure_kPa": bend.tolist(), "angle_deg": (0.76 * bend).tolist(),
            "fitted_angle_deg": (0.755 * bend + (0, 0.2, 0.1)[rung]).tolist(),
        },
        "starts": [{"start": f"start {i}", "cost": 120.0 + (0 if i < 5 else 11.0 * i), "status": "converged"} for i in range(8)],
        "segments_study": [
            {
                "segments": n, "train_tip_rmse_mm": off * (0.4 + 40 / n**2), "validate_tip_rmse_mm": off * (0.45 + 44 / n**2),
                "validate_tip_x_rmse_mm": off * (0.3 + 30 / n**2), "validate_tip_y_rmse_mm": off * (0.2 + 20 / n**2),
                "tip_path_mm": {
                    "experiment": next(iter(predicted)), "x": (np.linspace(0, -90, 40) * (1 + 1 / n)).tolist(),
                    "y": (-155 + np.linspace(0, 7, 40) ** 2).tolist(),
                },
            }
            for n in (2, 4, 8, 16, 32)
        ],
        "profiles": {
            "k_ref": {
                "unit": "N*m/rad", "value": [0.083, 0.0838, 0.0845, 0.0852, 0.086], "delta": [4.1, 1.0, 0.0, 1.0, 4.2],
                "interval_95": [0.0831, 0.0859], "sentence": "k_ref lies between 0.0831 and 0.0859 N*m/rad (95 %, profile likelihood).",
            },
        },
        "leave_one_out": {
            "experiments": {name: {"tip_rmse_mm": 1.07 * row["tip_rmse_mm"]} for name, row in table.items() if row["role"] == "train"},
            "tip_rmse_mm": 0.5, "relative_spread": {"k_ref": 0.004, "r_hyd": 0.001},
            "sentence": "k_ref moves most when a run is left out: by 0.4 %; the tip error on runs left out is 0.500 mm.",
        },
        "residual_tests": {
            "whiteness": {"correlation_time_s": (0.41, 0.032, 0.011)[rung], "sentence": "the residual is correlated"},
            "independence_of_angle": {"share": 0.1, "sentence": "10 % of its variance goes with the angle"},
        },
        "laws": {effect: LAWS[effect] for effect in effects},
        "inputs": {f"{name}/recording.nc": "9f2c" * 16 for name in predicted},
    })  # fmt: skip


def worst_places(predicted: dict[str, xr.Dataset]) -> list[dict]:
    rows = []
    for name, data in predicted.items():
        error, time = error_of(data), data.time.values
        peak = int(np.argmax(error))
        phase = str(data.phase.values[peak])
        rows.append({
            "experiment": name, "from_s": float(time[max(0, peak - 60)]), "to_s": float(time[min(len(time) - 1, peak + 60)]),
            "from_sigma": 0.6, "to_sigma": 1.0, "rmse_mm": float(error[peak]), "phase": phase,
            "sentence": f"In {name} the model is {error[peak]:.2f} mm off at the tip during {phase}, at {time[peak]:.2f} s.",
        })  # fmt: skip
    return sorted(rows, key=lambda row: -row["rmse_mm"])


def comparison(rung: int, experiments: dict[str, dict], predicted: dict[str, xr.Dataset]) -> Comparison:
    by_phase, pooled = [], np.concatenate([error_of(d) for d in predicted.values()])
    for name, data in predicted.items():
        for phase in np.unique(data.phase.values):
            chosen = error_of(data)[data.phase.values == phase]
            share = float(np.sum(chosen**2) / np.sum(error_of(data) ** 2))
            by_phase.append({"experiment": name, "role": ROLES.get(name, "train"), "phase": str(phase),
                             "rmse_mm": rms(chosen), "rmse_deg": None, "share": share, "frames": len(chosen)})  # fmt: skip
    pressures = np.concatenate([e["p"] for e in experiments.values()])
    by_pressure = []
    for low in range(0, 280, 40):
        chosen = pooled[(pressures >= low) & (pressures < low + 40)]
        if len(chosen):
            by_pressure.append({"from_kPa": low, "to_kPa": low + 40, "rmse_mm": rms(chosen), "rmse_deg": None, "frames": len(chosen)})
    gap = np.concatenate([d.normal_residual.values for d in predicted.values()])
    by_segment = [
        {"from_sigma": i / 8, "to_sigma": (i + 1) / 8, "rmse_mm": rms(gap[:, 4 * i : 4 * i + 5]),
         "bias_mm": float(np.mean(gap[:, 4 * i : 4 * i + 5]))}
        for i in range(8)
    ]  # fmt: skip
    first = experiments[next(iter(experiments))]
    profiles = []
    for level in (90.0, 180.0, 270.0):
        at = int(np.argmin(np.abs(first["p"] - level)))
        strain = RADIUS_MM * np.radians(first["theta"][at]) / (LENGTH_MM / SEGMENTS)
        profiles.append({
            "experiment": first["name"], "pressure_kPa": level, "position": ((np.arange(SEGMENTS) + 0.5) / SEGMENTS).tolist(),
            "measured": strain.tolist(), "sigma": [0.004] * SEGMENTS, "modelled": (strain * 0.98).tolist(),
            "chi2": 90.0, "degrees_of_freedom": SEGMENTS - 1,
        })  # fmt: skip
    return Comparison.model_validate({
        "model": RUNGS[rung], "noise_floor_mm": 0.085, "by_phase": by_phase, "by_pressure": by_pressure,
        "by_segment": by_segment, "where": worst_places(predicted),
        "residual_torque": {"rms_mNm": (2.4, 0.4, 0.06)[rung], "depends_on": [
            {"on": "time since reversal", "what": "the time since the last reversal", "score": (0.71, 0.06, 0.02)[rung],
             "sentence": "Most of the residual torque follows the time since the last change of pressure."},
            {"on": "angle", "what": "the angle", "score": (0.18, 0.41, 0.01)[rung], "sentence": "Some of it follows the angle."},
        ], "note": "Torque that would close the gap, per joint."},
        "elongation": {"sentence": "Elongation is not uniform: the clamp half stretches 1.4 times as much as the tip half (p < 0.001).",
                       "assumption": "Assumes constant width: elongation is half the width times the curvature.", "profiles": profiles},
        "sentences": ["Most of the error sits in the holds, and it grows while the pressure stands still.",
                      "It is spread along the whole tube."],
    })  # fmt: skip


def diagnosis(rung: int, predicted: dict[str, xr.Dataset], error_mm: list[float]) -> Diagnosis:
    added = (["maxwell"], ["gravity_tilt"], [])[rung]
    after = error_mm[min(rung + 1, 2)]
    rows = [
        {"effect": "maxwell", "score_p": 1e-300, "predicted_rmse_mm": error_mm[1] * 1.1, "train_rmse_mm": error_mm[1],
         "validate_rmse_mm": error_mm[1], "delta_bic": -41200.0, "refitted": True, "matters": True,
         "parameters": {"maxwell.k1": parameter(0.041, "1", 0.01), "maxwell.T": parameter(1.21, "s", 0.015)}},
        {"effect": "gravity_tilt", "score_p": 1e-80, "predicted_rmse_mm": after, "train_rmse_mm": after,
         "validate_rmse_mm": after, "delta_bic": -3100.0, "refitted": True, "matters": rung < 2,
         "parameters": {"gravity_tilt.angle": parameter(0.0349, "rad", 0.01)}},
        {"effect": "rest_curvature", "score_p": 1e-79, "predicted_rmse_mm": after * 1.01, "train_rmse_mm": after * 1.01,
         "validate_rmse_mm": after * 1.02, "delta_bic": -3090.0, "refitted": True, "matters": rung < 2},
        {"effect": "hysteresis", "score_p": 1e-12, "predicted_rmse_mm": error_mm[rung] * 0.95, "refitted": True,
         "train_rmse_mm": error_mm[rung] * 0.96, "validate_rmse_mm": error_mm[rung] * 0.97, "delta_bic": -60.0, "matters": False},
        {"effect": "coulomb", "at": "joint 2", "score_p": 0.03, "predicted_rmse_mm": error_mm[rung] * 0.99, "matters": False},
        {"effect": "payload", "score_p": 0.4, "predicted_rmse_mm": error_mm[rung], "matters": False},
    ]  # fmt: skip
    verdict = ("missing", "missing", "complete")[rung]
    return Diagnosis.model_validate({
        "model": RUNGS[rung], "verdict": verdict,
        "sentence": f"The data call for {added[0]}." if added else "What is left is at the noise floor.",
        "named": added, "candidates": rows[rung:], "where": worst_places(predicted)[:3], "noise_floor_mm": 0.085,
        "tied": [{"effects": ["gravity_tilt", "rest_curvature"], "split_by": "turn the rig by 180 degrees about the tube"}]
        if rung == 1 else [],
        "explained_fraction": (0.93, 0.88, 0.02)[rung],
        "next_experiment": {"for": ["gravity_tilt", "rest_curvature"], "pressure": "next_experiment.csv",
                            "sentence": "Hold 60, 150 and 240 kPa for two seconds each: the two differ by 1.4 mm there."}
        if rung == 1 else None,
    })  # fmt: skip


def calibration() -> Calibration:
    rng = np.random.default_rng(5)
    columns, rows = np.meshgrid(np.arange(9) * 60.0, np.arange(6) * 60.0)
    fields = []
    for index in range(10):
        turn = rng.normal(0, 0.15)
        x = 120 + 20 * rng.normal() + columns * np.cos(turn) - rows * np.sin(turn)
        y = 200 + 250 * rng.random() + columns * np.sin(turn) + rows * np.cos(turn)
        slip = rng.normal(0, 0.06, (2, x.size)) * (2.5 if index == 0 else 1.0)
        fields.append({
            "file": f"board_{index:02d}.jpg", "rms_px": float(np.sqrt(np.mean(np.sum(slip**2, axis=0)))),
            "x_px": x.ravel().tolist(), "y_px": y.ravel().tolist(), "dx_px": slip[0].tolist(), "dy_px": slip[1].tolist(),
        })  # fmt: skip
    grid_x, grid_y = np.meshgrid(np.linspace(60, 660, 9), np.linspace(100, 1180, 9))
    spread = 0.004 + 0.03 * np.hypot(grid_x - 360, grid_y - 640) / 700
    counts = [[max(0, 40 - 14 * (abs(i - 2) + abs(j - 4))) for j in range(8)] for i in range(6)]
    quality = {
        "coverage": {"counts": counts, "x_edges_px": np.linspace(0, 720, 9).tolist(), "y_edges_px": np.linspace(0, 1280, 7).tolist()},
        "warnings": ["10 photos are few: errors that they share go unnoticed; take 10 to 20"],
        "region": {"sentence": "where the tube is, the calibration places a point to 0.02 mm (0.013 % of the tube's length)"},
        "residual_fields": fields,
        "uncertainty_map": {"x_px": grid_x[0].tolist(), "y_px": grid_y[:, 0].tolist(), "sigma_mm": spread.tolist()},
        "advice": "add photos with the board at: top left, top right (3 of 48 fields are empty)",
        "cross_validation": {"difference_mm": 0.02, "predicted_mm": 0.018, "ratio": 1.1,
                             "sentence": "the two halves of the photos differ by what their uncertainties say"},
    }  # fmt: skip
    return Calibration(
        image_width=720, image_height=1280, camera_matrix=np.array([[1412.3, 0, 361.2], [0, 1411.9, 640.8], [0, 0, 1]]),
        distortion=np.array([-0.11, 0.05, 0.0003, -0.0001, 0.0]), model="brown5", rms_px=0.081,
        intrinsics_covariance=np.eye(9), plane_rotation=np.eye(3), plane_translation_mm=np.array([0.0, 0.0, 600.0]),
        plane_pose_covariance=np.eye(6), plane_tilt_deg=4.2, vertical="board",
        photos=tuple({"file": f["file"], "used": True, "reason": "", "rms_px": f["rms_px"]} for f in fields)
        + ({"file": "board_10.jpg", "used": False, "reason": "no board was found", "rms_px": None},),
        quality=quality,
    )  # fmt: skip
