"""What the stages of mechanics write beside their JSON, and the sentences that say how they went."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rfea_vision.artefacts import Diagnosis, ModelFit, Rung
from rfea_vision.files import read_dataset, whole_file, write_datasets, write_text
from rfea_vision.units import rounded

if TYPE_CHECKING:
    import xarray as xr


#: What `improve` does in the minute before its first model stands.
CLIMBING = "improve fits the model, weighs every effect against what it leaves, adds what is named, and again until a verdict ends it"


def compiling(room: str) -> str:
    """Announce that Numba has to compile the functions of a room; empty where they are in its cache."""
    kept = Path(__file__).parent.parent / room / "__pycache__"
    if "NUMBA_CACHE_DIR" in os.environ or not os.access(kept.parent, os.W_OK) or any(kept.glob("*.nbi")):
        return ""
    return f"compiling {room} once, which takes a minute, several on a slow or busy machine; later commands find it in the cache"


def save_prediction(folder: Path, predictions: Mapping[str, xr.Dataset], file: str = "prediction.nc") -> Path:
    """Write prediction.nc, one group per experiment, and return its path."""
    write_datasets(folder / file, {**predictions})
    return folder / file


def load_prediction(folder: Path, experiments: Sequence[str]) -> dict[str, xr.Dataset]:
    """Read the groups of prediction.nc."""
    return {name: read_dataset(folder / "prediction.nc", name) for name in experiments}


def save_timings(folder: Path, model: ModelFit) -> None:
    """Write how long each chain of the study took, apart from the results, which are the same on every machine."""
    if model.timings:
        write_text(folder / "timings.json", json.dumps({"segments_study_s": model.timings}, indent=1) + "\n")


def save_diagnosis(folder: Path, diagnosis: Diagnosis, pressure: xr.Dataset | None) -> list[Path]:
    """Write the diagnosis, and the pressure (kPa) over log_time (s) to play next as a CSV beside it."""
    outputs = [folder / "diagnosis.json"]
    if pressure is not None and diagnosis.next_experiment is not None:
        import pandas as pd

        path = folder / Path(diagnosis.next_experiment.pressure).name
        columns = {"time_s": pressure["log_time"].values, "pressure_kPa": pressure["pressure"].values}
        columns |= {"tension_N": pressure["tension"].values} if "tension" in pressure else {}
        with whole_file(path) as temporary:
            pd.DataFrame(columns).to_csv(temporary, float_format="%.6g", index=False)
        outputs.append(path)
    diagnosis.save(outputs[0])
    return outputs


def rung_of(model: ModelFit, diagnosis: Diagnosis, below: Sequence[tuple[Rung, Diagnosis]]) -> Rung:
    """Return the rung of a model, above those `below`, of a ladder that is still climbed: `share` is counted once it ends."""
    from rfea_vision.effects.catalogue import plain  # brings SymPy: only where a ladder is climbed

    known, own = {rung.added for rung, _ in below}, [plain(effect) for effect in model.effects]
    new = [effect for effect in own if effect not in known] or ["segments"]  # the rung that has no new law
    added = new[-1] if below else None
    before = below[-1][1] if below else diagnosis
    candidate = next((row for row in before.candidates if row.effect == added), None)
    return Rung.of(
        model,
        added=added,
        tied=before.rivals_of(added) if added else [],
        verdict=diagnosis.verdict,
        asks_less=diagnosis.asks_less,
        uncertain=diagnosis.uncertain,
        uncertain_because=diagnosis.uncertain_because,
        grade=None if added is None else "named" if added in before.named else "stand-in",
        probability=candidate.probability if candidate else None,
    )


def describe_fit(model: ModelFit) -> str:
    """Say how well a model fits."""
    parts = []
    for role, metrics in model.metrics.items():
        if metrics.tip_rmse_mm is not None:
            parts.append(f"{role} {rounded(metrics.tip_rmse_mm)} mm")
        elif metrics.angle_rmse_deg is not None:
            parts.append(f"{role} {rounded(metrics.angle_rmse_deg)} deg")
    return f"{model.status}, root mean square error {', '.join(parts)}" if parts else model.status


def describe_rung(rung: Rung) -> str:
    """Say what a rung has brought."""
    train, held_out = rung.error("train"), rung.error("validate")
    errors = f"train {'-' if train is None else rounded(train)}"
    errors += f" {rung.unit} (no run is held out)" if held_out is None else f", validate {rounded(held_out)} {rung.unit}"
    rivals = f" ({rung.added} cannot be told from {' or '.join(rung.tied)})" if rung.tied else ""
    return f"{rung.model}: {errors}, {rung.said}{rivals}"
