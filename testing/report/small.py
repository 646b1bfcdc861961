"""A short made-up campaign of two runs without film, and what is left of one where only an angle was measured."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

from rfea_vision.artefacts import Comparison, Diagnosis, Ladder, ModelFit, Recording, Track
from rfea_vision.files import read_dataset, write_datasets
from testing.report.sample import RUNGS, write_sample

TWO = ("steps-270kPa", "steps-180kPa")


def write_small(folder: Path) -> Path:
    """Write an ``rfea/`` folder of two runs of 1.5 s."""
    return write_sample(folder, seconds=1.5, video=False, names=TWO)


def only_angles(folder: Path) -> None:
    """Take from a campaign what an inclinometer does not give; its errors become those of the angle."""
    for path in folder.glob("*/recording.nc"):
        kept = ["valid", "reason", "bend_angle", "bend_angle_sigma"]
        Recording(read_dataset(path)[[*kept, "pressure"]]).save(path)
        Track(read_dataset(path.parent / "track.nc")[kept]).save(path.parent / "track.nc")
    for rung in RUNGS:
        room = folder / "models" / rung
        groups: dict[str | None, xr.Dataset] = {
            name: read_dataset(room / "prediction.nc", group=name)[["bend_angle", "angle_residual", "phase"]]
            for name in TWO
        }
        write_datasets(room / "prediction.nc", groups)
        fit = ModelFit.load(room / "model.json").model_dump(mode="json")
        for row in (*fit["metrics"].values(), *fit["experiments"].values()):
            row |= {key: None for key in row if key.startswith(("tip", "midline"))}
        ModelFit.model_validate(fit | {"noise_floor_mm": None}).save(room / "model.json")
        told = Comparison.load(room / "comparison.json").model_dump(mode="json")
        for row in (*told["by_phase"], *told["by_pressure"], *told["where"]):
            row |= {"rmse_mm": None, "rmse_deg": row["rmse_mm"]}
        Comparison.model_validate(told | {"by_segment": []}).save(room / "comparison.json")
        found = Diagnosis.load(room / "diagnosis.json").model_dump(mode="json", by_alias=True)
        for row in found["candidates"]:
            row |= {key.replace("_mm", "_deg"): row[key] for key in list(row) if key.endswith("_rmse_mm")}
            row |= {key: None for key in row if key.endswith("_rmse_mm")}
        floor = {"noise_floor_mm": None, "noise_floor_deg": 0.0417}
        Diagnosis.model_validate(found | floor).save(room / "diagnosis.json")
    ladder = Ladder.load(folder / "ladder.json").model_dump(mode="json")
    for rung in ladder["rungs"]:
        for role in ("train", "validate"):
            rung[f"{role}_angle_rmse_deg"] = rung.pop(f"{role}_tip_rmse_mm")
            rung[f"{role}_tip_rmse_mm"] = None
    ladder["test"] = {"angle_rmse_deg": 0.123, "first_model_angle_rmse_deg": 4.56, "experiments": {}}
    Ladder.model_validate(ladder | {"noise_floor_mm": None, "noise_floor_deg": 0.0417}).save(folder / "ladder.json")
