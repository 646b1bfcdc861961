"""From `model.json` back to a model that runs, with its parameters."""

from __future__ import annotations

from dataclasses import replace

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts import ModelFit
from rfea_vision.dynamics.simulation import STANDARD_GRAVITY, Model
from rfea_vision.errors import InputError
from rfea_vision.fitting.scoring import rebuild


def fitted_model(fit: ModelFit, gravity: float = STANDARD_GRAVITY, mounting: float = 0.0) -> tuple[Model, FloatArray]:
    """Model and parameters (SI, in the order of its names) of a fit, on a rig: see `Observed.gravity` and `mounting`.

    Raises
    ------
    InputError
        The model has effects at a chamber; or as for `rebuild`.
    """
    model, par = rebuild(fit)
    model = replace(model, gravity=gravity, mounting=mounting, order=2)  # that of the exported step
    if model.law.chambers:
        raise InputError(
            f"model '{fit.name}' has effects at the chamber {model.law.chambers[0]}; an exported model has one pressure: fit it without"
        )
    return model, par
