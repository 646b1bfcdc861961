"""From `model.json` back to a model that runs, with its parameters."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts import Actuator, ModelFit
from rfea_vision.dynamics.simulation import STANDARD_GRAVITY, Chain, Model
from rfea_vision.effects.catalogue import find_effects
from rfea_vision.errors import InputError
from rfea_vision.fitting.problem import parse_effects


def fitted_model(fit: ModelFit, gravity: float = STANDARD_GRAVITY, mounting: float = 0.0) -> tuple[Model, FloatArray]:
    """Model and parameters (SI, in the order of its names) of a fit, on a rig: see `Observed.gravity` and `mounting`.

    Raises
    ------
    InputError
        The fit lacks a parameter of the model, or names an effect that nobody declares.
    """
    ids, places = parse_effects(fit.effects, fit.segments)
    effects = find_effects(ids, [Path(file) for file in fit.effect_files])
    actuator = Actuator(**fit.actuator)
    chain = Chain.tube(actuator, fit.segments, fit.joints)
    model = Model(chain, effects, mirror=actuator.mirror, at=places, gravity=gravity, mounting=mounting)
    if model.law.chambers:
        raise InputError(
            f"model '{fit.name}' has effects at the chamber {model.law.chambers[0]}; an exported model has one pressure: fit it without"
        )
    missing = [name for name in model.names if name not in fit.parameters]
    if missing:
        raise InputError(f"model '{fit.name}': model.json lacks the parameter {missing[0]}; fit it again with --force")
    return model, np.array([fit.parameters[name].value for name in model.names])
