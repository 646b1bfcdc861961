"""Parameters that the section has no use for, or that the runs cannot determine: held by rule, with a sentence for each fact."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rfea_vision.artefacts.measurement import Actuator
from rfea_vision.artefacts.rows import UNUSED_BY_BEAMS
from rfea_vision.fitting.coordinates import base_reference
from rfea_vision.fitting.observed import Observed
from rfea_vision.options.fit import FitOptions

#: Runs whose pressure stays within this are no push.
CONSTANT_PA = 5e3


def pushed(items: Sequence[Observed]) -> bool:
    """Whether the pressure changes by enough to move a tube, within a run or from one run to another."""
    return float(np.ptp(np.concatenate([item.excitation.pressure for item in items]))) >= CONSTANT_PA


def held_by_rule(items: Sequence[Observed], actuator: Actuator, segments: int) -> tuple[dict[str, float], list[str]]:
    """Parameters that the section has no use for, or that no run can tell, with a sentence for each fact."""
    fixed, said = {}, []
    if actuator.kind != "tube":
        fixed |= dict.fromkeys(UNUSED_BY_BEAMS, 0.0)
        kept = "the side that keeps its length" if actuator.keeps == "side" else "its middle"
        said.append(
            f"A {actuator.kind} bends about {kept} and keeps its section: the incompressible bore of the paper does not "
            f"apply, so k_slope, b_pos_slope and b_neg_slope have no meaning and are 0. It has one damper, b_pos, to whichever "
            "side it moves; b_neg is not used."
        )
    if not pushed(items):
        lever = float(base_reference(actuator, segments)[6])
        fixed["r_hyd"] = lever
        said.append(
            f"No training run changes its pressure, so that none tells r_hyd; it was held at {lever * 1e3:.3g} mm, and k and b are "
            "what the weight and the swing say."
        )
    return fixed, said


def under_rules(options: FitOptions, items: Sequence[Observed], actuator: Actuator) -> FitOptions:
    """The options with what is held by rule; what a person gave stands."""
    fixed, _ = held_by_rule(items, actuator, options.segments)
    rules = {
        name: value for name, value in fixed.items() if name not in (*options.fixed, *options.priors, *options.bounds)
    }
    return replace(options, fixed={**rules, **options.fixed}) if rules else options
