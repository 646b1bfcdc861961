"""Results of many campaigns as one table: a row per campaign and model, for pandas, DuckDB or a spreadsheet."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TypeVar

import pandas as pd

from rfea_vision.artefacts import CHOOSING_ROLES, Diagnosis, Ladder, ModelFit
from rfea_vision.campaign.loading import OUTPUT_FOLDER
from rfea_vision.errors import InputError, RfeaError
from rfea_vision.files import whole_file
from rfea_vision.stages.cache import StageCache

_Artefact = TypeVar("_Artefact", ModelFit, Diagnosis, Ladder)
_ERRORS = ("tip_rmse_mm", "midline_rmse_mm", "angle_rmse_deg")
_RUNG = ("added", "grade", "probability", "share")


def campaign_rows(folder: Path) -> list[dict[str, object]]:
    """Read the models of one campaign.

    Parameters
    ----------
    folder : campaign, or its folder of results

    Returns
    -------
    list of dict
        One per model, those of the ladder first and in its order.

    Raises
    ------
    InputError
        If there is no model, or one cannot be read.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; give campaigns, or folders of results")
    out = folder if (folder / "models").is_dir() else folder / OUTPUT_FOLDER
    files = sorted((out / "models").glob("*/model.json"))
    if not files:
        raise InputError(f"{folder}: holds no model; run 'rfea improve {folder}' first")
    ladder = _load(Ladder, out / Ladder.FILE)
    rungs = {rung.model: rung for rung in ladder.rungs} if ladder is not None else {}
    order = list(rungs)
    cache = StageCache(out)
    rows = []
    for file in sorted(files, key=lambda path: (_place(path.parent.name, order), path.parent.name)):
        model = _load(ModelFit, file)
        assert model is not None
        record = cache.record(f"fit/{model.name}")
        rows.append(
            {
                "campaign": out.resolve().parent.name if out.name == OUTPUT_FOLDER else out.resolve().name,
                "folder": str(folder),
                "model": model.name,
                "rung": order.index(model.name) + 1 if model.name in order else None,
                "last_rung": bool(order) and model.name == order[-1],
                **{key: getattr(rungs.get(model.name), key, None) for key in _RUNG},
                **_facts(model, _load(Diagnosis, file.with_name("diagnosis.json"))),
                "made_with": (record.version if record is not None else "") or None,
                **_parameters(model),
            }
        )
    return rows


def write_table(path: Path, rows: Sequence[dict[str, object]], kind: str) -> list[str]:
    """Write rows as ``parquet`` or ``csv`` and return the names of the columns; what a row lacks is empty.

    Raises
    ------
    InputError
        If the extra that writes Parquet is not installed.
    """
    frame = pd.DataFrame(list(rows)).astype({"rung": "Int64"})
    for name in frame.columns[frame.isna().all()]:  # a column of which nothing is known is one of numbers
        frame[name] = frame[name].astype(float)
    with whole_file(path) as temporary:
        if kind == "csv":
            frame.to_csv(temporary, index=False)
            return [str(name) for name in frame.columns]
        try:
            frame.to_parquet(temporary, index=False)
        except ImportError as error:
            remedy = "pip install 'rfea-vision[parquet]', or give --format csv"
            raise InputError(f"{path}: Parquet needs the Python module 'pyarrow'; {remedy}") from error
    return [str(name) for name in frame.columns]


def _facts(model: ModelFit, diagnosis: Diagnosis | None) -> dict[str, object]:
    errors = {
        f"{role}_{error}": getattr(model.metrics[role], error) if role in model.metrics else None
        for role in CHOOSING_ROLES
        for error in _ERRORS
    }
    return {
        "effects": " ".join(model.effects),
        "segments": model.segments,
        "observe": model.observe,
        "status": model.status,
        "verdict": diagnosis.verdict if diagnosis is not None else None,
        "named": " ".join(diagnosis.named) if diagnosis is not None else None,
        **errors,
        "noise_floor_mm": model.noise_floor_mm,
        "noise_floor_deg": model.noise_floor_deg,
    }


def _parameters(model: ModelFit) -> dict[str, object]:
    """Value, 95 % interval, standard error and unit of every parameter."""
    found: dict[str, object] = {}
    for name, parameter in model.parameters.items():
        low, high = parameter.interval_95 or (None, None)
        found |= {
            name: parameter.value,
            f"{name}_low_95": low,
            f"{name}_high_95": high,
            f"{name}_stderr": parameter.stderr,
            f"{name}_unit": parameter.unit,
        }
    return found


def _place(name: str, order: list[str]) -> int:
    return order.index(name) if name in order else len(order)


def _load(kind: type[_Artefact], path: Path) -> _Artefact | None:
    if not path.is_file():
        return None
    try:
        return kind.load(path)
    except (RfeaError, OSError, ValueError, RecursionError) as error:
        raise InputError(f"{path}: cannot be read ({' '.join(str(error).split())[:200]})") from error
