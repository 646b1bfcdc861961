"""Which effects could these recordings reveal, and how strong would they have to be?

To first order, at the fit at hand: an effect of a given strength moves the tube; what the base parameters and clocks can
absorb of that is lost, and the rest must stand out from the noise by what *matters* (docs/formats.md).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rfea_vision.artefacts.judgement import ModelFit
from rfea_vision.artefacts.measurement import Recording
from rfea_vision.critique.diagnosis import reopened
from rfea_vision.critique.floors import binding, floors_of
from rfea_vision.critique.measures import MATTERS_FLOORS, MATTERS_SHARE
from rfea_vision.critique.screening import Sensitivity, available, offered, sensitivities
from rfea_vision.fitting.observed import MM
from rfea_vision.fitting.ratio import with_lever_free


@dataclass(frozen=True)
class Revealed:
    """The least amplitude of one effect that these recordings would show; None where they could not show it at all.

    `amplitude` is counted from the value at which the effect is absent, at the most telling point of its `grid`.
    """

    effect: str
    parameter: str
    unit: str
    amplitude: float | None
    grid: dict[str, float]
    sentence: str


def power_study(
    model: ModelFit,
    recordings: Mapping[str, Recording],
    *,
    candidates: Sequence[str] | None = None,
    effect_files: Sequence[Path] = (),
) -> list[Revealed]:
    """Least strength at which each effect would be called missing, with this excitation, camera and noise.

    Parameters
    ----------
    model : a fit to these recordings; its parameters set the tube that is studied
    recordings : by name; those with `role: train` are used

    Returns
    -------
    list of Revealed
        One row per amplitude on offer.
    """
    problem, fitted = reopened(model, recordings)
    fitted = with_lever_free(problem, fitted)
    floor = binding(floors_of(problem, fitted))
    present = {e.id for e in fitted.model.effects}
    effects = available(offered(problem, fitted, candidates, effect_files), present)
    # An error that, by what matters, falls to the floor where the effect is added: by a tenth, and by a fifth of the floor.
    wanted = max(1 + MATTERS_FLOORS, 1 / (1 - MATTERS_SHARE))
    structure = floor * float(np.sqrt(wanted**2 - 1))
    least: dict[tuple[str, str], tuple[float, dict[str, float]]] = {}
    for row in sensitivities(problem, fitted, effects):
        for column, name in enumerate(row.names):
            shift = _tip_rms(row, column)
            amplitude = structure / shift if shift > 0 else float("inf")
            if row.secant > 0:
                amplitude = float(np.sqrt(row.secant * amplitude))
            key = (row.effect.id, name)
            if amplitude < least.get(key, (float("inf"), {}))[0]:
                least[key] = (amplitude, row.grid)
    out = []
    for effect in effects:
        for name in effect.amplitudes():
            spec = effect.parameters[name]
            amplitude, grid = least.get((effect.id, name), (float("inf"), {}))
            absent = spec.absent or 0.0
            reach = max(spec.upper - absent, absent - spec.lower)
            if amplitude > reach:
                sentence = f"{effect.id}: not at any strength that physics allows."
                out.append(Revealed(effect.id, name, spec.unit, None, grid, sentence))
                continue
            at = "".join(f" (at {k} = {v:g} {effect.parameters[k].unit})" for k, v in grid.items())
            sentence = f"{effect.id}: from {name} = {absent + amplitude:.3g} {spec.unit} on{at}."
            out.append(Revealed(effect.id, name, spec.unit, amplitude, grid, sentence))
    return out


def _tip_rms(row: Sensitivity, column: int) -> float:
    """RMS movement of the tip (mm; of the angle in deg) per unit of the amplitude, less what the base model absorbs."""
    total, frames = 0.0, 0
    for item, part in zip(row.items, row.slices, strict=True):
        count = item.time.size
        values = row.jacobian[part, column]
        if item.observe == "angle":
            moved = np.rad2deg(values * item.angle_sigma)
        elif item.observe == "tip_y":
            moved = values * item.sigma[:, -1] / MM
        else:  # the tip's two coordinates stand last
            moved = (values[-2 * count :].reshape(count, 2) * item.sigma[:, -1:] / MM).ravel()
        total += float(moved @ moved)
        frames += count
    return float(np.sqrt(total / max(frames, 1)))
