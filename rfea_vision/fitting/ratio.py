"""The lever of the pressure where runs tell only its ratio to the stiffness."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rfea_vision.artefacts.judgement import Parameter
from rfea_vision.fitting.coordinates import base_reference
from rfea_vision.fitting.information import delta_bic
from rfea_vision.fitting.observed import Observed
from rfea_vision.fitting.problem import Problem
from rfea_vision.fitting.refit import Fitted, refit, refit_from, with_solution
from rfea_vision.fitting.uncertainty import uncertainty_of
from rfea_vision.options import FitOptions
from rfea_vision.units import rounded

#: A lever that the data tell no better than to this share is not told by them: its bounds are 25 % apart.
LOOSE_SHARE = 0.1


def only_ratio(fitted: Fitted, items: Sequence[Observed]) -> bool:
    """Whether the runs tell no more than the ratio of stiffness and lever: the lever's standard error is a tenth of it."""
    names = fitted.coordinates.names
    if not {"k_ref", "r_hyd"} <= set(names):
        return False
    found = uncertainty_of(fitted.solution, items)
    at = names.index("r_hyd")
    size = fitted.coordinates.matrix[6, at] * np.sqrt(found.covariance[at, at]) / fitted.par[6]
    return bool(found.undetermined[at] or size > LOOSE_SHARE)


def with_lever_held(problem: Problem, fitted: Fitted) -> Fitted:
    """The same fit with the lever held at its usual value, where the runs tell no more than its ratio to the stiffness.

    What they tell is judged near the fit; where they fit worse with the lever held, by more than one parameter less is worth (BIC),
    they do tell it, and it stays free.
    """
    if not only_ratio(fitted, problem.train):
        return fitted
    options = fitted.options
    lever = float(base_reference(problem.actuator, options.segments)[6])
    share = lever / fitted.par[6]
    known = {
        name: value * (share if k < 7 else 1.0)
        for k, (name, value) in enumerate(zip(fitted.model.names, fitted.par.tolist(), strict=True))
    }
    options = replace(options, fixed={**options.fixed, "r_hyd": lever})
    held = refit(problem, options, known, options.segments, fitted.solution.clocks)
    return fitted if delta_bic(problem, fitted, held) > 0 else replace(with_solution(fitted, held), ratio_only=True)


def with_lever_free(problem: Problem, fitted: Fitted) -> Fitted:
    """The same fit with the lever free where the rule had held it.

    What a model leaves blurs what its runs tell: with the effect that is missing they may well tell the lever, and where it
    is held off its value some other effect would be called in to make up for it.
    """
    if not fitted.ratio_only:
        return fitted
    return replace(with_solution(fitted, refit_from(problem, lever_free(fitted), fitted)), ratio_only=False)


def lever_free(fitted: Fitted) -> FitOptions:
    """The options of a fit without what the rule held."""
    held = {"r_hyd"} if fitted.ratio_only else set()
    return replace(fitted.options, fixed={n: v for n, v in fitted.options.fixed.items() if n not in held})


def about_ratio(k_ref: Parameter, lever: float) -> str:
    """The sentence on a lever (m) that was held because these runs tell only its ratio to the stiffness."""
    within = ""
    if k_ref.interval_95 is not None:
        within = f" ± {rounded((k_ref.interval_95[1] - k_ref.interval_95[0]) / 2 / lever, 2)}"
    return (
        f"k / r_hyd: these runs tell only the ratio, k_ref / r_hyd = {k_ref.value / lever:.4g}{within} N/rad (95 %); r_hyd was held at "
        f"{lever * 1e3:.3g} mm, and k and b go with it."
    )
