"""Campaigns whose physics is known, for the calibration of the critique's probabilities: of the twin and of the second plant.

Small on purpose (two runs to fit, one to judge, 6 s at 60 frames/s, nine nodes): what is asked is whether a probability of 0.8
is right eight times in ten, and that takes many campaigns. Which seed hides what is drawn here, and nowhere else.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rfea_vision import open_campaign
from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts import Actuator, Recording
from rfea_vision.twin import TwinOptions
from rfea_vision.twin import simulate as simulate_twin
from testing.claims import LAWS
from testing.other_plant import OtherTube, centre_line, simulate
from testing.recordings import recording_of

NOISE_MM = 0.06
#: Of each of the twin's effects: an amplitude that leaves about five noise floors, and the most that is tried.
AMPLITUDES: dict[str, tuple[float, float]] = {
    "virtual_work.a": (0.6, 1.0),
    "variable_mass.a": (1.0, 2.0),
    "payload.m": (1e-3, 2e-2),
    "com_offset.a": (0.8, 1.0),
    "gravity_tilt.angle": (0.05, 0.45),
    "rest_curvature.angle": (0.05, 0.8),
    "nonlinear_stiffness.c": (0.05, 0.8),
    "pressure_stiffening.c": (5e-7, 5e-6),
    "stiffness_profile.a1": (0.05, 0.5),
    "damping_profile.a1": (0.5, 0.8),
    "nonlinear_damping.c": (0.1, 4.0),
    "maxwell.k1": (0.05, 1.0),
    "hysteresis.tau_h": (5e-4, 1e-2),
    "coulomb.tau_c": (3e-4, 1e-2),
    "mullins.c": (0.03, 0.4),
    "radial_expansion.c": (1e-7, 3e-7),
    "compressibility.c": (1e-7, 3e-7),
    "fluid_inertia.I": (2e8, 2e10),
    "fluid_damping.R": (1e9, 5e10),
    "drag.c": (200.0, 1.8e3),
    "contact.k": (10.0, 1e3),
    "base_rotation.c": (1.0, 30.0),
    "pressure_lag.T": (0.02, 0.2),
    "pressure_offset.p0": (2e3, 5e4),
    "time_offset.dt": (0.01, 0.1),
    "clock_drift.d": (3e-3, 0.03),
    "camera_scale.s": (0.01, 0.1),
    "plane_tilt.a": (0.3, 1.5),
    "fan.F": (0.02, 1.0),
    "warm_up.c": (0.05, 0.5),
    "shaking.a": (0.2, 5.0),
    "heavy_section.m": (1e-3, 2e-2),
    "kink.c": (0.3, 1.0),
}
OUTSIDE = ("fan", "warm_up", "shaking", "heavy_section", "kink")
#: Partners that vanish with the amplitude: drawn between these, evenly in the logarithm.
PARTNERS: dict[str, dict[str, tuple[float, float]]] = {
    "maxwell": {"maxwell.T": (0.25, 2.5)},
    "hysteresis": {"hysteresis.w": (0.1, 0.6)},
    "coulomb": {"coulomb.w": (0.05, 0.2)},
    "mullins": {"mullins.s": (0.4, 1.2)},
    "contact": {"contact.d": (0.05, 0.09)},
    "warm_up": {"warm_up.T": (2.0, 6.0)},
    "shaking": {"shaking.f": (2.0, 5.0)},
    "heavy_section": {"heavy_section.at": (0.3, 0.6)},
    "kink": {"kink.at": (0.25, 0.5)},
}
SIGNED = ("gravity_tilt", "rest_curvature", "com_offset", "plane_tilt", "stiffness_profile", "pressure_offset")
ROLES = ("train", "train", "validate")
DURATION_S, RATE_HZ, ANGLE_NOISE_DEG = 6.0, 60.0, 0.2
FRACTIONS = np.linspace(0, 1, 9)
UNKNOWN: dict[str, tuple[float, float]] = {
    "fan": (0.003, 0.05),
    "shake": (1e-4, 1e-3),
    "drift": (0.03, 0.2),
    "twitch": (0.005, 0.03),
}
#: Kinds, and how often each is drawn.
KINDS = {"single": 0.5, "pair": 0.2, "triple": 0.1, "nothing": 0.1, "outside": 0.1}
SHOWN_BY_TWIN = tuple(
    dict.fromkeys(k.split(".")[0] for k in AMPLITUDES if k.split(".")[0] not in (*OUTSIDE, "virtual_work"))
)


#: Pressure (samples,) in the tube, of that at the sensor and the step (s) between samples.
Felt = Callable[[FloatArray, float], FloatArray]


@dataclass(frozen=True)
class Case:
    """One campaign: its plant, its seed, what hides in it (by the plant's own names), and what each of its laws may be called."""

    plant: str
    seed: int
    kind: str
    hidden: dict[str, float]
    laws: tuple[tuple[str, ...], ...]
    angle_only: bool

    @property
    def key(self) -> str:
        """Name of the campaign."""
        return f"{self.plant}-{self.seed}"

    @property
    def right(self) -> tuple[str, ...]:
        """Effects of the catalogue that may be named."""
        return tuple(dict.fromkeys(name for names in self.laws for name in names))


def draw(plant: str, seed: int) -> Case:
    """Draw one campaign."""
    rng = np.random.default_rng([seed, len(plant)])
    kind = str(rng.choice(list(KINDS), p=list(KINDS.values())))
    count = {"single": 1, "pair": 2, "triple": 3}.get(kind, 0)
    angle_only = bool(rng.uniform() < 0.15)
    pool = list(LAWS) if plant == "other" else list(SHOWN_BY_TWIN)
    hidden: dict[str, float] = {}
    laws: list[tuple[str, ...]] = []
    for name in rng.permutation(pool)[:count]:
        own, names = (of_other if plant == "other" else of_twin)(str(name), rng)
        hidden |= own
        laws.append(names)
    if kind == "outside":
        name = str(rng.choice(list(UNKNOWN) if plant == "other" else list(OUTSIDE)))
        hidden |= {name: even(rng, *UNKNOWN[name])} if plant == "other" else of_twin(name, rng)[0]
    return Case(plant, seed, kind, hidden, tuple(laws), angle_only)


def even(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def of_other(name: str, rng: np.random.Generator) -> tuple[dict[str, float], tuple[str, ...]]:
    right, low, high = LAWS[name]
    value = even(rng, low, high) * (
        rng.choice([-1.0, 1.0]) if name in ("tilt", "curl_root", "stepped", "damping_stepped") else 1.0
    )
    out = {name: float(value)}
    if name == "soften_capped":
        out["soften_capped_at"] = float(rng.uniform(0.5, 2.0))
    if name == "spot":
        out |= {"spot_at": float(rng.uniform(0.2, 0.8)), "spot_width": float(rng.uniform(0.05, 0.15))}
    return out, right


def of_twin(name: str, rng: np.random.Generator) -> tuple[dict[str, float], tuple[str, ...]]:
    key = next(k for k in AMPLITUDES if k.split(".")[0] == name)
    guess, most = AMPLITUDES[key]
    value = min(guess * even(rng, 0.2, 3.0), most)
    if name in SIGNED and rng.uniform() < 0.5:
        value = -value
    out = {key: float(f"{value:.4g}")}
    out |= {k: float(f"{even(rng, *span):.4g}") for k, span in PARTNERS.get(name, {}).items()}
    return out, () if name in OUTSIDE else (name,)


def recordings_of(case: Case, felt: Felt | None = None) -> tuple[dict[str, Recording], Actuator]:
    """Make the campaign; a tube of the second plant may feel another pressure than the log has."""
    rng = np.random.default_rng([case.seed, 77])
    if case.plant == "twin":
        found, actuator = _by_twin(case)
    else:
        found, actuator = _by_other(case, rng, felt), Actuator()
    if case.angle_only:
        found = {name: _angle_alone(r, rng) for name, r in found.items()}
    return found, actuator


def _by_twin(case: Case) -> tuple[dict[str, Recording], Actuator]:
    clocks = any(name.split(".")[0] in ("time_offset", "clock_drift") for name in case.hidden)
    options = TwinOptions(
        hidden=case.hidden,
        seed=case.seed,
        roles=ROLES,
        duration_s=DURATION_S,
        rate_Hz=RATE_HZ,
        noise_mm=NOISE_MM,
        noise_correlation=0.5 if case.seed % 3 == 2 else 0.0,
        joints=16,
        sync="offset" if clocks else "common_clock",
        write_truth=False,
    )
    return by_twin(options)


def by_twin(options: TwinOptions) -> tuple[dict[str, Recording], Actuator]:
    """Make a campaign of the twin in a folder that goes again, and read it as a user's."""
    with tempfile.TemporaryDirectory() as folder:
        simulate_twin(Path(folder) / "campaign", options)
        found = open_campaign(Path(folder) / "campaign").sync()
        return {name: Recording(r.dataset.load()) for name, r in found.items()}, options.actuator


def _by_other(case: Case, rng: np.random.Generator, felt: Felt | None) -> dict[str, Recording]:
    tube = OtherTube(*(float(v) for v in rng.uniform(0.85, 1.2, 3)), case.hidden)
    step_s = 1e-3
    time_s = np.arange(0, DURATION_S + 0.3, step_s)
    out = {}
    for index, role in enumerate(ROLES):
        own = tube
        if "twitch" in case.hidden:  # the tube is not the same from run to run
            changed = {
                **case.hidden,
                "twitch": case.hidden["twitch"] * float(rng.choice([-1, 1]) * rng.uniform(0.5, 1.5)),
            }
            own = replace(tube, hidden=changed)
        pressure = programme(time_s, rng)
        every = round(1 / RATE_HZ / step_s)
        phi = simulate(own, pressure if felt is None else felt(pressure, step_s), step_s, every)
        frame_s = time_s[::every][: phi.shape[0]]
        seen = frame_s < DURATION_S
        line = centre_line(phi[seen], FRACTIONS) * 1e3
        noise = NOISE_MM * rng.standard_normal(line.shape)
        if case.seed % 3 == 2:
            for k in range(1, noise.shape[0]):
                noise[k] = 0.5 * noise[k - 1] + np.sqrt(0.75) * noise[k]
        noise[:, 0] = 0.0
        out[f"run{index}"] = recording_of(
            f"run{index}", role, frame_s[seen], line + noise, phi[seen, -1], time_s, pressure, noise_mm=NOISE_MM
        )
    return out


def programme(time_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Pressure (Pa) of one run: rest, then steps, ramps and a swing in an order of their own, no faster than 600 kPa/s."""
    top = rng.uniform(1.2e5, 2.2e5)
    wanted, at = np.zeros_like(time_s), 0.5
    while at < time_s[-1]:
        length = rng.uniform(0.5, 1.5)
        part = (time_s >= at) & (time_s < at + length)
        level, kind = top * rng.uniform(0, 1), rng.integers(3)
        if kind == 0:
            wanted[part] = level
        elif kind == 1:
            wanted[part] = np.linspace(top * rng.uniform(0, 1), level, int(part.sum()))
        else:
            wanted[part] = level * (0.5 - 0.5 * np.cos(2 * np.pi * rng.uniform(0.7, 2.5) * (time_s[part] - at)))
        at += length
    step = 6e5 * (time_s[1] - time_s[0])
    out = np.zeros_like(wanted)
    for k in range(1, wanted.size):
        out[k] = out[k - 1] + np.clip(wanted[k] - out[k - 1], -step, step)
    return out


def _angle_alone(recording: Recording, rng: np.random.Generator) -> Recording:
    data = recording.dataset
    keep = [n for n in ("pressure", "bend_angle", "valid", "reason") if n in data]
    out = data[keep].copy()
    out["bend_angle"] = out["bend_angle"] + ANGLE_NOISE_DEG * rng.standard_normal(out["bend_angle"].shape)
    out["bend_angle_sigma"] = ("time", np.full(out.sizes["time"], ANGLE_NOISE_DEG))
    return Recording(out)
