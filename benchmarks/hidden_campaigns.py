"""Campaigns whose physics is known: which effects hide in them, how strongly, and the recordings of one of them.

The strength is set so that the tip misfit of the base model, after its own refit, is a wanted number of noise floors; it
is searched once, to first order, and kept in ``hidden_effects/strengths.json``, so that a campaign is the same forever.
"""

from __future__ import annotations

import json
import tempfile
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfea_vision import open_campaign
from rfea_vision.artefacts import Actuator, Recording
from rfea_vision.dynamics.simulation import Excitation
from rfea_vision.errors import DataError
from rfea_vision.files import write_text
from rfea_vision.fitting.fit import carried, make_model
from rfea_vision.options import FitOptions
from rfea_vision.twin import BaseParameters, TwinOptions, simulate
from rfea_vision.twin.draw import (
    Run,
    build_plant,
    camera_times,
    draw_runs,
    highest_pressure,
    misread_plane,
    move,
    posture_at,
)
from rfea_vision.twin.options import with_partners
from rfea_vision.twin.plant import Plant

FloatArray = NDArray[np.float64]

FOLDER = Path(__file__).parent / "hidden_effects"
STRENGTHS = FOLDER / "strengths.json"
NOISE_MM = 0.06
SEARCH_STEP_S = 0.0025  # the strength is wanted to first order only
#: First guess of each effect's amplitude at about five noise floors, and the most that is tried.
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
_COMMON = ("maxwell", "coulomb", "payload", "hysteresis", "gravity_tilt", "stiffness_profile")
SINGLE = tuple(
    dict.fromkeys([*_COMMON, *(key.split(".")[0] for key in AMPLITUDES if key.split(".")[0] not in OUTSIDE)])
)
#: Exactly tied to r_hyd, or swallowed by it: nothing to be found (docs/physics.md 5).
SWALLOWED = ("pressure_gain",)
PAIRS = (
    ("maxwell", "payload"),
    ("coulomb", "stiffness_profile"),
    ("hysteresis", "gravity_tilt"),
    ("maxwell", "gravity_tilt"),
    ("payload", "stiffness_profile"),
    ("pressure_lag", "nonlinear_stiffness"),
    ("maxwell", "coulomb"),
    ("drag", "rest_curvature"),
)
#: Seed and misfit wanted, in noise floors, of each round; those in `UNSEEN` were drawn when the critique was finished.
ROUNDS = ((1, 5.0), (2, 15.0), (3, 5.0), (4, 15.0), (5, 2.0), (7, 6.0), (8, 5.0))
UNSEEN = (8,)
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


@dataclass(frozen=True)
class Case:
    """One campaign to generate: effects (none, one or two), misfit wanted in noise floors, seed, and the side it bends to."""

    effects: tuple[str, ...]
    floors: float
    seed: int
    bends: str = "left"

    @property
    def key(self) -> str:
        """Name of the campaign."""
        right = "-right" if self.bends == "right" else ""
        return f"{'+'.join(self.effects) or 'complete'}-{self.floors:g}-{self.seed}{right}"

    @property
    def kind(self) -> str:
        """complete, outside, single or pair."""
        if not self.effects:
            return "complete"
        if any(effect in OUTSIDE for effect in self.effects):
            return "outside"
        return "single" if len(self.effects) == 1 else "pair"

    @property
    def noise_correlation(self) -> float:
        """Every third campaign has noise that is correlated from frame to frame."""
        return 0.5 if self.seed % 3 == 2 else 0.0


def cases() -> list[Case]:
    """All campaigns, taken in turn from the kinds, so that a part of them already tells something about each."""
    return [case for seed, floors in ROUNDS for case in _round(seed, floors)]


def unseen() -> set[str]:
    """Names of the campaigns that nothing was tuned on."""
    return {case.key for seed, floors in ROUNDS if seed in UNSEEN for case in _round(seed, floors)}


def _round(seed: int, floors: float) -> list[Case]:
    out: list[Case] = []
    singles = [Case((effect,), floors, seed) for effect in SINGLE]
    if seed == 1:
        turned = ("gravity_tilt", "com_offset", "plane_tilt", "rest_curvature")
        singles[8:8] = [Case((effect,), floors, 6, "right") for effect in turned]
    others = [
        *[Case((effect,), floors, seed) for effect in OUTSIDE],
        *[Case(pair, 8.0, seed) for pair in PAIRS],
        *[Case((), 0.0, 100 + 10 * seed + k) for k in range(8)],
    ]
    order = np.random.default_rng(seed).permutation(len(others))
    for index in range(max(len(singles), len(others))):
        out += singles[index : index + 1]
        out += [others[k] for k in order[index : index + 1]]
    return out


def unit_direction(effect: str, seed: int) -> tuple[str, float, float, dict[str, float]]:
    """Amplitude's name, first guess (with its sign), the most that is tried, and the partners' values."""
    name = next(key for key in AMPLITUDES if key.split(".")[0] == effect)
    rng = np.random.default_rng([seed, sum(map(ord, effect))])
    sign = -1.0 if effect in SIGNED and rng.uniform() < 0.5 else 1.0
    partners = {k: float(np.exp(rng.uniform(np.log(a), np.log(b)))) for k, (a, b) in PARTNERS.get(effect, {}).items()}
    if effect == "stiffness_profile":
        partners = {"stiffness_profile.a2": 0.0, "stiffness_profile.a3": 0.0}
    return name, sign * AMPLITUDES[name][0], AMPLITUDES[name][1], partners


def twin_options(case: Case, hidden: dict[str, float], *, roles: tuple[str, ...]) -> TwinOptions:
    """Options of the twin for a case."""
    clocks = any(effect in ("time_offset", "clock_drift") for effect in case.effects)
    return TwinOptions(
        hidden=hidden,
        seed=case.seed,
        roles=roles,
        noise_mm=NOISE_MM,
        noise_correlation=case.noise_correlation,
        actuator=Actuator(bends=case.bends),  # type: ignore[arg-type]
        joints=32,
        sync="offset" if clocks else "motion",
        write_truth=False,
    )


def recordings_of(options: TwinOptions) -> tuple[dict[str, Recording], Actuator]:
    """Generate the campaign in a temporary folder and read it as a user's."""
    with tempfile.TemporaryDirectory() as folder:
        simulate(Path(folder) / "campaign", options)
        found = open_campaign(Path(folder) / "campaign").sync()
        return {name: Recording(r.dataset.load()) for name, r in found.items()}, options.actuator


def _postures(plant: Plant, run: Run, step_s: float, time_s: FloatArray, hidden: dict[str, float]) -> FloatArray:
    """Nodes of the centre line (frames, nodes, 2) in mm, as the camera would see them without noise."""
    points, _ = posture_at(plant, move(plant, run, step_s), time_s).line(np.linspace(0, 1, 9)[1:])
    return np.asarray(misread_plane(points, hidden), dtype=np.float64)


@dataclass(frozen=True)
class Yardstick:
    """What the base model could swallow of a change to the motion: two training runs of a coarse twin without the effect."""

    options: TwinOptions
    base: BaseParameters
    runs: list[Run]
    without: list[FloatArray]
    slopes: list[FloatArray]

    @staticmethod
    def of(case: Case) -> Yardstick:
        """Runs, postures (frames, nodes, 2) in mm and their slopes over the base parameters and time, of one case."""
        drawn = twin_options(case, {}, roles=("train", "train"))
        options = replace(drawn, joints=16, step_s=SEARCH_STEP_S, actuator=Actuator())
        bare, base = build_plant(options)
        runs = draw_runs(options, highest_pressure(bare, options))
        camera_s = _camera_s(options)
        model = make_model(options.actuator, FitOptions(segments=options.joints))
        par = carried(model, options.actuator, options.joints, asdict(base), 8)
        without, slopes = [], []
        for run in runs:
            said_s = run.claimed_offset_s + camera_s
            without.append(_postures(bare, run, options.step_s, said_s, {}))
            line = run.programme
            excitation = Excitation.from_log(
                np.asarray(line.time_s, float), np.asarray(line.pressure_Pa, float), said_s[0] - 0.25, said_s[-1] + 0.25
            )
            motion = model.simulate(par, excitation, said_s, range(7))
            if not motion.ok:
                raise DataError(f"{case.key}: the base model cannot be simulated at the true parameters")
            speed = np.concatenate([motion.sensitivity, motion.rate[:, :, None]], axis=2)
            slopes.append(model.centre_line(replace(motion, sensitivity=speed), np.linspace(0, 1, 9)[1:])[1])
        return Yardstick(options, base, runs, without, slopes)

    def floors(self, hidden: dict[str, float]) -> float:
        """Tip RMSE over the noise floor that the base model would be left with, to first order.

        The change that the effect makes to the motion, less what the base parameters (and the clock, where it is free)
        can swallow of it.
        """
        options = self.options
        plant = Plant(options.actuator, self.base, with_partners(hidden), joints=options.joints)
        camera_s, middle_s = _camera_s(options), options.duration_s / 2
        rows, columns, tips = [], [], []
        for index, (run, without, slopes) in enumerate(zip(self.runs, self.without, self.slopes, strict=True)):
            lost_s = hidden.get("time_offset.dt", 0.0) + hidden.get("clock_drift.d", 0.0) * (camera_s - middle_s)
            true_s = run.claimed_offset_s + camera_s + lost_s
            wide = np.zeros((slopes[..., 0].size, 7 + len(self.runs)))
            wide[:, :7] = slopes[..., :7].reshape(-1, 7)
            if options.sync == "motion":
                wide[:, 7 + index] = slopes[..., 7].ravel()
            change = _postures(plant, run, options.step_s, true_s, hidden) - without
            rows.append(change.ravel())
            columns.append(wide)
            tips.append(np.tile(np.arange(8) == 7, change.shape[0]).repeat(2))
        change, jacobian, tip = np.concatenate(rows), np.concatenate(columns), np.concatenate(tips)
        scale = np.linalg.norm(jacobian, axis=0)
        jacobian = jacobian[:, scale > 0] / scale[scale > 0]
        left = change - jacobian @ np.linalg.lstsq(jacobian, change, rcond=1e-10)[0]
        return float(np.sqrt(1 + 2 * np.mean(left[tip] ** 2) / (2 * NOISE_MM**2)))


def _camera_s(options: TwinOptions) -> FloatArray:
    return np.asarray(camera_times(options)[::4], dtype=np.float64)


def search_strength(effect: str, case: Case, most_tries: int = 3) -> dict[str, Any]:
    """Hidden parameters of one effect that give the misfit wanted, or the nearest that could be reached."""
    name, guess, most, partners = unit_direction(effect, case.seed)
    yardstick = Yardstick.of(Case((effect,), case.floors, case.seed, case.bends))
    structure = float(np.sqrt(max(case.floors**2 / len(case.effects) - 1, 0.1)))
    size = min(abs(guess) * structure / 4.9, most)
    best: dict[str, Any] = {}
    for _ in range(most_tries):
        hidden = {**partners, name: float(np.copysign(size, guess))}
        try:
            reached = float(np.sqrt(max(yardstick.floors(hidden) ** 2 - 1, 1e-4)))
        except DataError:  # too strong to be simulated
            size *= 0.4
            continue
        if not best or abs(np.log(reached / structure)) < abs(np.log(best["structure"] / structure)):
            best = {"hidden": hidden, "structure": reached}
        bigger = min(size * float(np.clip(structure / reached, 0.05, 20.0)), most)
        if abs(np.log(bigger / size)) < 0.3 or bigger == size == most:
            break
        size = bigger
    if best:  # the last stretch in proportion
        factor = float(np.clip(structure / best["structure"], 0.5, 2.0))
        factor = min(factor, most / abs(best["hidden"][name]))
        best["hidden"][name] *= factor
        best["structure"] *= factor
    return best


def hidden_of(case: Case) -> dict[str, Any]:
    """Hidden parameters of a case: from the committed file, or searched."""
    if not case.effects:
        return {"hidden": {}, "expected_floors": 1.0}
    known = read_strengths()
    if case.key in known:
        return known[case.key]
    parts = [search_strength(effect, case) for effect in case.effects]
    hidden: dict[str, float] = {}
    for part in parts:
        hidden |= part.get("hidden", {})
    reached = float(np.sqrt(1 + sum(part.get("structure", 0.0) ** 2 for part in parts)))
    return {"hidden": {k: float(f"{v:.4g}") for k, v in hidden.items()}, "expected_floors": round(reached, 2)}


def read_strengths() -> dict[str, Any]:
    """Strengths found so far, by campaign."""
    return json.loads(STRENGTHS.read_text(encoding="utf-8")) if STRENGTHS.exists() else {}


def keep_strength(key: str, found: dict[str, Any]) -> None:
    """Keep a strength, so that a campaign is the same forever."""
    known = {**read_strengths(), key: found}
    write_text(STRENGTHS, json.dumps(dict(sorted(known.items())), indent=1) + "\n")
