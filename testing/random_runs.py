"""What the fit's bounds allow can be simulated: random parameters of random models under random logs, none of which may fail.

Parameters are drawn over the whole of the optimiser's box (`fitting.coordinates.build`), evenly in the logarithm where a
bound allows; logs are made of steps, ramps, holds and noise, and read by a 12-bit converter.
"""

from __future__ import annotations

import numpy as np

from rfea_vision.artefacts import Actuator
from rfea_vision.dynamics.simulation import Chain, Excitation, Model
from rfea_vision.effects.catalogue import catalogue
from rfea_vision.fitting.coordinates import base_reference, build

SECONDS = 3.0
TUBES = (
    Actuator(),
    Actuator(outer_radius=0.0125, inner_radius=0.004, length=0.07, density=1070.0),
    Actuator(outer_radius=0.003, inner_radius=0.0026, length=0.25),
)
#: Nothing, every effect of the catalogue that changes the motion, and pairs of those that bend the law most.
MODELS: tuple[tuple[str, ...], ...] = (
    (),
    *((name,) for name, effect in sorted(catalogue().items()) if effect.kind != "measurement"),
    ("coulomb", "contact"),
    ("nonlinear_stiffness", "nonlinear_damping"),
    ("stiffness_profile", "damping_profile"),
    ("hysteresis", "payload"),
)


def random_log(rng: np.random.Generator, rate_Hz: float = 1000.0) -> tuple[np.ndarray, np.ndarray]:
    """Time (s) and pressure (Pa) of a few seconds of steps, ramps and holds between -50 and 350 kPa, in 12 bits of 1 MPa."""
    time = np.arange(0.0, SECONDS, 1 / rate_Hz)
    knots = np.sort(rng.uniform(0.1, SECONDS, rng.integers(3, 10)))
    knots[1:] = np.where(rng.random(knots.size - 1) < 0.4, knots[:-1] + 1 / rate_Hz, knots[1:])  # a step in one sample
    pressure = np.interp(time, np.sort(knots), rng.uniform(-50e3, 350e3, knots.size))
    pressure = pressure + rng.normal(0, rng.choice([0.0, 300.0, 2e3]), time.size)
    least = 1e6 / 2**12
    return time, np.round(pressure / least) * least


def random_run(seed: int) -> tuple[Model, np.ndarray, Excitation]:
    """A model, parameters within the bounds of its fit, and what drives it."""
    rng = np.random.default_rng(seed)
    actuator = TUBES[rng.integers(len(TUBES))]
    segments = int(rng.choice([2, 6, 16]))
    effects = tuple(catalogue()[name]() for name in MODELS[seed % len(MODELS)])
    joints = "middle" if rng.random() < 0.7 else "start"
    model = Model(Chain.tube(actuator, segments, joints), effects, order=int(rng.choice([2, 3])))
    held = np.append(base_reference(actuator, segments), np.zeros(len(model.names) - 7))
    box = build(model, actuator, segments, float(rng.uniform(0.3, 3.0)), held=held)
    even, steep = rng.uniform(size=(2, box.lower.size))
    positive = (box.lower > 0) & (rng.random(box.lower.size) < 0.7)
    low, high = np.maximum(box.lower, 1e-300), box.upper
    y = np.where(positive, low * (high / low) ** even, box.lower + (box.upper - box.lower) * steep)
    excitation = Excitation.from_log(*random_log(rng), 0.0, SECONDS - 0.01)
    return model, box.parameters(y), excitation


def failures(seeds: range) -> dict[int, str]:
    """Seeds of the runs that could not be simulated, or that gave something that is no number, and why."""
    found = {}
    for seed in seeds:
        model, par, excitation = random_run(seed)
        frames = np.linspace(0.0, excitation.end_s, 60)
        motion = model.simulate(par, excitation, frames, range(par.size))
        if not motion.ok:
            found[seed] = motion.message
        elif not (np.all(np.isfinite(motion.phi)) and np.all(np.isfinite(motion.sensitivity))):
            found[seed] = "not a number"
    return found
