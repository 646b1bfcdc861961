"""What is fitted to what: the recordings made ready, and the model that both describe."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts.measurement import Actuator, Recording
from rfea_vision.dynamics.simulation import Chain, Model
from rfea_vision.effects.catalogue import find_effects, parameters_of, split_joint
from rfea_vision.errors import DataError, InputError
from rfea_vision.fitting.coordinates import base_reference, largest_bend, sized
from rfea_vision.fitting.observation import default_observe, observe_recording
from rfea_vision.fitting.observed import Observed
from rfea_vision.fitting.rules import CONSTANT_PA, pushed
from rfea_vision.options.fit import FitOptions, Observe

WRONG_SIDE_RAD = 0.3  # median bend to the other side under pressure at which a run is refused
#: Twice the modulus of a stiff rubber (10 MPa): a thin wall of it has burst long before.
BURSTS_PA = 2e7


@dataclass(frozen=True)
class Problem:
    """Recordings made ready, by role, with the tube they show."""

    actuator: Actuator
    train: tuple[Observed, ...]
    validate: tuple[Observed, ...]
    test: tuple[Observed, ...]
    recordings: dict[str, Recording]
    bend: float

    @property
    def mirror(self) -> float:
        """-1 where the tube bends right in the recordings, which are then mirrored; else 1; of all runs the same."""
        return self.train[0].mirror

    @property
    def scored(self) -> tuple[Observed, ...]:
        """The runs on which a fit is scored: training, then validation."""
        return (*self.train, *self.validate)


def make_problem(recordings: Mapping[str, Recording], actuator: Actuator, options: FitOptions | None = None) -> Problem:
    """Prepare all recordings but the ignored ones, as the options say what to look at and what of the sensors is known.

    Raises
    ------
    DataError
        No recording has the role `train`, or a training run cannot be one of this tube.
    """
    used = {name: r for name, r in recordings.items() if r.role in ("train", "validate", "test")}
    training = [r for r in used.values() if r.role == "train"]
    if not training:
        raise DataError("no experiment has `role: train`; set it in the experiment.yaml of at least one run")
    options = options or FitOptions()
    wanted = options.observe or default_observe(training)
    items = []
    for recording in used.values():
        item = observed(recording, wanted, options, as_asked=recording.role == "train")
        items.append(item.thinned(1 if options.frames is None else -(-item.time.size // options.frames)))
    _refuse_nonsense([o for o in items if o.role == "train"], actuator)
    groups = {role: tuple(o for o in items if o.role == role) for role in ("train", "validate", "test")}
    return Problem(
        actuator, groups["train"], groups["validate"], groups["test"], dict(used), largest_bend(groups["train"])
    )


def observed(
    recording: Recording,
    wanted: Observe,
    options: FitOptions,
    *,
    as_asked: bool = False,
    longest_step_s: float = np.inf,
) -> Observed:
    """A recording as it is fitted or scored: looked at as is wanted, or where it does not offer that as it can be."""
    seen = wanted if as_asked or _offers(recording, wanted) else default_observe([recording])
    return with_zeros(observe_recording(recording, seen, longest_step_s=longest_step_s), options)


def with_zeros(item: Observed, options: FitOptions) -> Observed:
    """A run with what is known of the zeros of its sensors."""
    return replace(item, pressure_zero_sd=options.pressure_zero_sd, angle_zero_sd=options.angle_zero_sd)


def _refuse_nonsense(train: Sequence[Observed], actuator: Actuator) -> None:
    """Refuse what no tube of this length does: a wrong unit or side (broken input, as in `sync`), a pressure that never changes."""
    highest = max(float(np.max(np.abs(item.excitation.pressure))) for item in train)
    if highest > BURSTS_PA:
        raise InputError(
            f"the pressure of the training runs reaches {highest / 1e6:.3g} MPa, more than any soft tube bears; "
            "check the unit of the pressure log"
        )
    if not pushed(train) and all(item.held is None for item in train):
        spread = max(float(np.ptp(item.excitation.pressure)) for item in train)
        raise DataError(
            f"the pressure of the training runs stays within {spread / 1e3:.2g} kPa: it moves no tube; check its unit, record a run in "
            "which it changes, or say `start: {shape: measured}` where the tube was held by hand and let go"
        )
    for item in train:
        if not item.has_tip:
            continue
        tip = item.points[:, -1]
        reach = float(np.percentile(np.linalg.norm(tip, axis=1), 99))
        if not 0.1 * actuator.length < reach < 2.0 * actuator.length:
            raise InputError(
                f"experiment {item.name}: its tip comes {reach * 1e3:.3g} mm from the clamp, the tube is "
                f"{actuator.length * 1e3:.0f} mm long; check the unit and the origin of the track"
            )
        pressure = item.excitation.at(item.time)
        if np.ptp(pressure) <= CONSTANT_PA or item.mounting != 0:
            continue
        share = np.abs(pressure) / float(np.abs(pressure).max())
        bends, loaded, idle = 2 * np.arctan2(-tip[:, 0], -tip[:, 1]), share > 0.7, share < 0.3
        at_rest = float(np.median(bends[idle])) if idle.any() else 0.0  # of markers beside the line not nought
        bend = float(np.median((bends[loaded] - at_rest) * np.sign(pressure[loaded])))
        if bend < -WRONG_SIDE_RAD:
            raise InputError(
                f"experiment {item.name}: under pressure the tip goes to the side that `actuator.bends` does not name; "
                "change it, or the direction of x in the track"
            )


def _offers(recording: Recording, observe: Observe) -> bool:
    return {"midline": "midline", "tip": "tip", "tip_y": "tip", "angle": "bend_angle"}[observe] in recording.dataset


def parse_effects(effects: Sequence[str], segments: int) -> tuple[tuple[str, ...], dict[str, int]]:
    """Split ``coulomb@2`` into the effect, with its form if it has one (``mullins:linear``), and the joint by its id.

    An effect of the line at a chamber, ``pressure_lag@right``, is an effect of its own. InputError if the chain has no such joint.
    """
    ids, places = [], {}
    for text in effects:
        name, joint = split_joint(text)
        ids.append(name)
        if joint:
            if not 1 <= int(joint) <= segments:
                raise InputError(f"effect '{text}': the joint after @ must be a whole number from 1 to {segments}")
            places[name.partition(":")[0]] = int(joint)
    return tuple(ids), places


def make_model(actuator: Actuator, options: FitOptions, mirror: float = 1.0) -> Model:
    """Model that the options describe."""
    ids, places = parse_effects(options.effects, options.segments)
    effects = sized(find_effects(ids, options.effect_files), actuator)
    chain = Chain.tube(actuator, options.segments, options.joints)
    return Model(chain, effects, mirror=mirror, at=places)


def start_vector(model: Model, actuator: Actuator, segments: int) -> FloatArray:
    """The paper's table for the base parameters, the declared start for those of effects: (parameters,) in SI."""
    par = np.zeros(len(model.names))
    par[:7] = base_reference(actuator, segments)
    for name, spec in parameters_of(model.effects).items():
        par[model.names.index(name)] = (spec.grid or (spec.start,))[0] if spec.absent is None else spec.start
    return par
