"""Whether runs are followed far better by pressures in psi: gravity weighs the torque of the pressure, where it acts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rfea_vision.errors import DataError
from rfea_vision.fitting.coordinates import base_reference
from rfea_vision.fitting.problem import Problem
from rfea_vision.fitting.refit import Fitted, on_few_bodies, refit, rough_runs
from rfea_vision.fitting.residuals import evaluate
from rfea_vision.fitting.solver import farthest
from rfea_vision.units import rounded

#: kPa of one psi: a mistake that leaves the tube within the moduli of elastomers; with bar or mbar it does not.
PSI_kPa = 6.894757
#: Bounds of the lever in times of the tube's: beyond that factor to both sides, and short of where gravity is negligible beside it.
_REACH = 12.0
#: Share of the tube's length, or rad, by which a model is off at the worst moment before another scale is tried. Chosen: what an effect
#: of the catalogue moves is mostly less.
_FAR_OFF = 0.1
#: Of the residual (root mean square), that another scale must leave at most to be reported. Chosen: a missing effect may be made up
#: for in part.
_LEFT = 0.5
#: Factor to both sides of that within which a lever is taken for it: missing effects move the lever, too.
_NEAR = 1.3


def about_psi(problem: Problem, fitted: Fitted) -> list[str]:
    """Say that pressures as many times higher as psi are than kPa follow the runs far better.

    Of a tube without effects alone, whose lever nobody gave, and that is followed badly. Stiffness, damping and lever scaled together
    leave the motion as it is but for gravity and inertia: the fit, on thinned runs, tells whether these ask for another lever.
    """
    options, tube = fitted.options, problem.actuator
    given = {"r_hyd"} & {*options.bounds, *options.priors, *(() if fitted.ratio_only else options.fixed)}
    if options.effects or given or tube.kind != "tube" or farthest(problem.train, fitted.solution, tube.length) < _FAR_OFF:
        return []
    items, clocks = rough_runs(problem, fitted), fitted.solution.clocks
    now = evaluate(fitted.model, fitted.par, items, (), clocks)
    if now is None:
        return []
    lever = float(base_reference(tube, options.segments)[6])
    wide = {**options.bounds, "r_hyd": (lever / _REACH, lever * _REACH)}
    fixed = {name: value for name, value in options.fixed.items() if name != "r_hyd"}
    free = replace(on_few_bodies(options), bounds=wide, fixed=fixed)
    start = PSI_kPa * base_reference(tube, free.segments)
    known = dict(zip(fitted.model.names[:7], start.tolist(), strict=True)) | fixed
    try:
        found = refit(problem, free, known, free.segments, clocks, items=items, tolerance=1e-4)
    except DataError:
        return []
    share = float(np.linalg.norm(found.solution.evaluation.residual) / np.linalg.norm(now.residual))
    times = found.par[6] / lever
    if share > _LEFT or max(times / PSI_kPa, PSI_kPa / times) > _NEAR:
        return []
    return [
        f"With pressures {rounded(times, 2)} times as high, {rounded(100 * share, 2)} % of the error is left: is the log in psi "
        "(one psi is 6.9 kPa)? pressure.unit says which unit it is in."
    ]
