"""A Jupyter notebook that opens a campaign's artefacts, for those who go on by hand."""

from __future__ import annotations

import json
from pathlib import Path

from rfea_vision.report.collect import collect

_ABOUT = (
    "The artefacts of this campaign as xarray datasets and pandas tables. Lengths in mm, angles in deg, time in s, "
    "pressure in kPa; origin at the clamp, x to the right, y up."
)
_OPENING = """import json
from pathlib import Path

import pandas as pd
import plotly.express as px
import xarray as xr

rfea = Path.cwd().parent  # this notebook lies in rfea/report"""
_PLOT = "px.line(x=recording.time, y=recording.bend_angle, labels={'x': 'time in s', 'y': 'bend angle in deg'})"


def render_notebook(folder: Path, *, title: str) -> str:
    """Make a notebook (nbformat 4) that is to be saved in ``<folder>/report/``.

    Parameters
    ----------
    folder : the campaign's ``rfea/`` folder
    title : name of the campaign

    Returns
    -------
    str
        JSON of the notebook. Its code uses xarray, pandas and plotly only.
    """
    evidence = collect(folder)
    step = evidence.last
    recordings = {run.name: run.recording for run in evidence.experiments if run.recording is not None}
    runs = list(recordings)
    cells = [_text(f"# {title}\n\n{_ABOUT}"), _code(_OPENING)]
    if runs:
        cells += [
            _text("## What was measured"),
            _code(f"recording = xr.load_dataset(rfea / {runs[0]!r} / 'recording.nc')"),
        ]
        cells += [_code("recording"), _code(_PLOT if "bend_angle" in recordings[runs[0]] else "list(recording.data_vars)")]
    if step is not None:
        cells += _model_cells(step.rung.model, runs[0] if runs and runs[0] in step.predictions else None)
    if evidence.ladder:
        cells += [
            _text("## The ladder"),
            _code("pd.DataFrame(json.loads((rfea / 'ladder.json').read_text())['rungs'])"),
        ]
    return json.dumps({
        "cells": [cell | {"id": f"cell-{index}"} for index, cell in enumerate(cells)],
        "metadata": {"kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"}},
        "nbformat": 4, "nbformat_minor": 5,
    }, indent=1) + "\n"  # fmt: skip


def _model_cells(model: str, run: str | None) -> list[dict[str, object]]:
    cells = [
        _text(f"## The model `{model}`"),
        _code(f"model = rfea / 'models' / {model!r}\nfit = json.loads((model / 'model.json').read_text())"),
        _code("pd.DataFrame(fit['parameters']).T"),
        _code("pd.DataFrame(fit['experiments']).T"),
    ]
    if run is not None:
        cells += [_code(f"prediction = xr.load_dataset(model / 'prediction.nc', group={run!r})"), _code("prediction")]
    return cells


def _text(source: str) -> dict[str, object]:
    return {"cell_type": "markdown", "metadata": {}, "source": source}


def _code(source: str) -> dict[str, object]:
    return {"cell_type": "code", "execution_count": None, "metadata": {}, "outputs": [], "source": source}
