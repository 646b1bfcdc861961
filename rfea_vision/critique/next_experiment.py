"""The experiment to run next: the pressure profile on which two rival models differ most, within what the rig has shown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts.judgement import NextExperiment
from rfea_vision.artefacts.measurement import TENSION_kPa
from rfea_vision.dynamics.simulation import Excitation
from rfea_vision.fitting.observed import Observed
from rfea_vision.fitting.problem import Problem
from rfea_vision.fitting.refit import Fitted
from rfea_vision.fitting.residuals import as_rigged
from rfea_vision.fitting.rules import pushed
from rfea_vision.units import rounded

DURATION_S = 8.0  # of the proposed run at its usual pace: room for two swings up and down, and pauses
STEP_S = 2e-3  # of its pressure; valves are slower
#: Steps of the search for pace and amplitude, how often both are tried, and the slowest pace (its inverse is the fastest).
PACES, AMPLITUDES, ROUNDS, SLOWEST = (0.5, 0.7, 1.4, 2.0), (0.5, 0.7, 1.4), 3, 0.25


#: Pressures beyond zero by less than this share of the largest are the sensor's noise and zero.
BESIDE_ZERO = 0.05


def limits(problem: Problem) -> tuple[float, float, float]:
    """Lowest and highest pressure (Pa, with sign) and steepest rate (Pa/s) that the recordings show the rig can do."""
    low = min(float(o.excitation.pressure.min()) for o in problem.train)
    high = max(float(o.excitation.pressure.max()) for o in problem.train)
    rates = [np.abs(np.diff(o.excitation.pressure)) / o.excitation.step_s for o in problem.train]
    least = BESIDE_ZERO * max(-low, high)
    low, high = (0.0 if -least < low < 0 else low), (0.0 if 0 < high < least else high)
    return low, high, float(np.percentile(np.concatenate(rates), 99.5))


def _limited(target: FloatArray, rate: float) -> FloatArray:
    out = np.empty_like(target)
    out[0] = target[0]
    step = rate * STEP_S
    for k in range(1, target.size):
        out[k] = out[k - 1] + np.clip(target[k] - out[k - 1], -step, step)
    return out


def profiles(low: float, high: float, rate: float, seed: int) -> dict[str, FloatArray]:
    """Candidate profiles in words: name to pressure (Pa) on a 2 ms grid, from zero (or the limit nearest to it) to each side."""
    t = np.arange(0, DURATION_S, STEP_S)
    levels = np.random.default_rng(seed).uniform(0.1, 1.0, 10)
    there_and_back = [0, 1, 0, 0, 1, 0]
    shares = {
        "a fast step to full pressure, held, and back": (t > 0.5) & (t < 5),
        "a slow triangle to full pressure and back": np.interp(t, [0.3, 4.0, 7.7], [0, 1, 0]),
        "fast and slow triangles to the same pressure": 0.8
        * np.interp(t, [0.2, 0.7, 1.2, 1.7, 4.5, 7.5], there_and_back),
        "a staircase up and down with holds": np.interp(
            np.floor(t / 0.8), range(10), [0, 0.25, 0.5, 0.75, 1, 0.75, 0.5, 0.25, 0, 0]
        ),
        "small fast reversals about half pressure": 0.5 * (t > 0.3)
        + 0.12 * np.sign(np.sin(2 * np.pi * 1.5 * t)) * (t > 2),
        "small fast reversals near full pressure": 0.85 * (t > 0.3)
        + 0.12 * np.sign(np.sin(2 * np.pi * 2 * t)) * (t > 2),
        "random steps": levels[np.minimum((t / 0.8).astype(int), 9)] * (t > 0.3),
        "the same cycle twice after a rest": np.interp(t, [0.3, 1.3, 2.3, 4.5, 5.5, 6.5], there_and_back),
    }
    rest = min(max(low, 0.0), high)
    sides = {name: side for name, side in (("", high), (" to the other side", low)) if side != rest}
    if high == rest:
        sides = {"": low}
    targets = {
        name + where: rest + (side - rest) * share for where, side in sides.items() for name, share in shares.items()
    }
    if len(sides) == 2:
        one, other = (np.interp(t, [at, at + 1.8, at + 3.6], [0, 1, 0]) for at in (0.3, 3.9))
        targets["triangles to one side and to the other"] = rest + (high - rest) * one + (low - rest) * other
    return {name: _limited(np.asarray(target, dtype=float), rate) for name, target in targets.items()}


def _shared(pressure: FloatArray, like: Observed) -> dict[str, tuple[float, FloatArray]]:
    """Signs and pressures of the chambers of a rig that make up a pressure: to either side the first that bends there is driven."""
    chambers, driven = {}, set[float]()
    for name, (sign, _) in like.excitation.chambers.items():
        chambers[name] = sign, np.maximum(sign * pressure, 0.0) * (sign not in driven)
        driven.add(sign)
    return chambers


def _seen(fitted: Fitted, like: Observed, pressure: FloatArray, unit: str) -> FloatArray | None:
    """What a camera would see of a pressure on a rig: middle and tip (frames, 4) in mm, or the bend angle (frames, 1) in deg."""
    model, par, _ = as_rigged(fitted.model, fitted.par, like)
    excitation = Excitation(0.0, STEP_S, pressure, chambers=_shared(pressure, like))
    times = np.arange(0, pressure.size * STEP_S - 0.02, 0.01)
    motion = model.simulate(par, excitation, times)
    if not motion.ok:
        return None
    if unit == "deg":
        return np.rad2deg(motion.phi[:, -1:])
    return model.centre_line(motion, np.array([0.5, 1.0]))[0].reshape(times.size, -1) * 1e3


@dataclass(frozen=True)
class _Design:
    """A shape with its amplitude (1: as far as was seen) and pace (2: twice as fast, and again)."""

    shape: str
    amplitude: float = 1.0
    pace: float = 1.0

    def words(self, pressure: FloatArray, *, tension: bool) -> str:
        how = (
            ""
            if self.pace == 1
            else f", {self.pace:.2g} times as fast"
            if self.pace > 1
            else f", {1 / self.pace:.2g} times as slow"
        )
        low, high = float(pressure.min()) / 1e3, float(pressure.max()) / 1e3
        if tension:  # of a tendon that only pulls
            return f"{self.shape}{how} (up to {rounded(high / TENSION_kPa, 2)} N, {pressure.size * STEP_S:.3g} s)"
        reach = (
            f"up to {high:.0f}"
            if low >= -0.5
            else f"down to {low:.0f}"
            if high <= 0.5
            else f"from {low:.0f} to {high:.0f}"
        )
        return f"{self.shape}{how} ({reach} kPa, {pressure.size * STEP_S:.3g} s)"


def shaped(target: FloatArray, amplitude: float, pace: float, rate: float) -> FloatArray:
    """A profile (samples,) in Pa with another amplitude about its first pressure and at another pace, no steeper than `rate` (Pa/s).

    Faster ones are repeated until the time is over; slower ones take longer.
    """
    t = np.arange(target.size) * STEP_S
    at = np.arange(round(target.size / min(pace, 1.0))) * STEP_S
    played = np.interp((at * pace) % (t[-1] + STEP_S), t, target)
    rest = float(target[0])
    return _limited(rest + amplitude * (played - rest), rate)


def design_next(
    problem: Problem, rivals: Sequence[Fitted], names: Sequence[str], seed: int, floor: float
) -> tuple[NextExperiment | None, xr.Dataset | None]:
    """Pressure that separates two fitted rivals best, by the RMS difference of their predictions (mm, deg where only an angle is seen).

    The best shape first; then its pace and its amplitude in turn, as long as either tells more, within what the rig has shown.
    A rig on which no pressure ever changed has shown none: nothing is proposed. The noise `floor`, in the same unit, is told beside it.
    """
    if len(rivals) < 2 or not pushed(problem.train):
        return None, None
    low, high, rate = limits(problem)
    shapes = profiles(low, high, rate, seed)
    unit = "mm" if problem.train[0].has_tip else "deg"

    def apart(design: _Design) -> float:
        pressure = shaped(shapes[design.shape], design.amplitude, design.pace, rate)
        one, other = (_seen(rival, problem.train[0], pressure, unit) for rival in rivals[:2])
        if one is None or other is None:
            return -1.0
        coordinates = 2 if unit == "mm" else 1
        return float(np.sqrt(coordinates * np.mean((one - other) ** 2)))

    told = {design: apart(design) for design in map(_Design, shapes)}
    for _ in range(ROUNDS):
        best = max(told, key=lambda design: told[design])
        near = [replace(best, pace=best.pace * factor) for factor in PACES]
        near += [replace(best, amplitude=min(1.0, best.amplitude * factor)) for factor in AMPLITUDES]
        new = [design for design in near if design not in told and SLOWEST <= design.pace <= 1 / SLOWEST]
        told |= {design: apart(design) for design in new}
        if max(told, key=lambda design: told[design]) == best:
            break
    best = max(told, key=lambda design: told[design])
    if told[best] < 0:
        return None, None
    pressure = shaped(shapes[best.shape], best.amplitude, best.pace, rate)
    what = "tips" if unit == "mm" else "angles"
    decides = told[best] >= floor
    tension = problem.actuator.tendon is not None
    said = best.words(pressure, tension=tension)
    sentence = f"Run {said}: there {names[0]} and {names[1]}, as fitted now, predict"
    if not decides:
        sentence = (
            f"No run within the pressures and slopes of this rig tells {names[0]} from {names[1]} for sure: where they part most, "
            f"by {said}, they predict, as fitted now,"
        )
    beside = f"{'beside' if decides else 'less than'} a noise floor of {rounded(floor)} {unit}"
    sentence += f" {what} {rounded(told[best])} {unit} RMS apart, {beside}."
    file = f"next-experiment-{names[0]}-{names[1]}.csv"
    dataset = xr.Dataset(
        {"pressure": ("log_time", pressure / 1e3, {"units": "kPa"})},
        coords={"log_time": np.arange(pressure.size) * STEP_S},
    )
    if tension:
        dataset["tension"] = ("log_time", pressure / 1e3 / TENSION_kPa, {"units": "N"})
    planned = {"for": list(names[:2]), "pressure": file, "sentence": sentence, "decides": decides}
    return NextExperiment.model_validate(planned), dataset
