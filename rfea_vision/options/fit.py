"""What a fit may be asked for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AliasChoices, Field, WithJsonSchema, model_validator
from pydantic.dataclasses import dataclass
from pydantic_core import ArgsKwargs

from rfea_vision.errors import InputError
from rfea_vision.options.asking import CLOSED, Asked, effect_file_paths, quantity
from rfea_vision.options.given import (
    known_values,
    read_bounds,
    read_priors,
    read_values,
    write_values,
)

Observe = Literal["tip_y", "tip", "midline", "angle"]
#: Parameters of the base model that are per joint of the chain.
PER_JOINT = ("k_ref", "k_slope", "b_pos_ref", "b_pos_slope", "b_neg_ref", "b_neg_slope")
#: Bodies of a chain, unless asked otherwise: docs/physics.md 5 shows where finer ones stop to matter.
SEGMENTS = 16

_MODEL = ("fit", "improve")

Seed = Annotated[int, Asked((*_MODEL, "diagnose")), Field(description="Seed of everything random.")]
EffectFiles = Annotated[
    tuple[Path, ...],
    effect_file_paths("--effect-file", "'rfea effects new {name}' writes a template"),
    Asked((*_MODEL, "diagnose", "effects", "power"), "FILE.py", flag="--effect-file"),
    Field(description="An effect of one's own, as 'rfea effects new' writes it; may be repeated."),
]


def _standard_error(unit: str) -> Asked:
    return Asked(_MODEL, "SD", write=lambda value, _: [f"{value:g}{unit}"])


@dataclass(frozen=True, kw_only=True, config=CLOSED)
class FitOptions:
    """What to fit and how. Values of parameters are in SI; those of k and b are per joint of a chain of `segments`."""

    name: Annotated[str, Asked(("fit",), "MODEL")] = Field(
        default="", description="Name of the model; default base, base+EFFECT, ..."
    )
    effects: Annotated[tuple[str, ...], Asked(("fit",), "EFFECT")] = Field(
        default=(),
        validation_alias=AliasChoices("add", "effects"),
        description="An effect beside the base model, at one joint alone as in coulomb@2, of one chamber alone as in "
        "pressure_lag@right; may be repeated.",
    )
    segments: Annotated[
        int,
        Asked(_MODEL, "[INTEGER|auto]", write=lambda value, options: ["auto" if options.auto_segments else str(value)]),
        WithJsonSchema({"anyOf": [{"type": "integer"}, {"const": "auto"}]}),
    ] = Field(
        default=SEGMENTS,
        ge=1,
        le=256,
        description="Number of bodies; auto: as few as bring the error near the noise floor.",
    )
    joints: Annotated[Literal["middle", "start"], Asked(_MODEL)] = Field(
        default="middle", description="Joints in the middle of their arc, or at the start of the body as in the paper."
    )
    observe: Annotated[Observe | None, Asked(_MODEL)] = Field(
        default=None, description="What of the recordings is fitted; default the richest that all of them offer."
    )
    effect_files: EffectFiles = ()
    seed: Seed = 0
    fixed: Annotated[
        Mapping[str, float],
        known_values(partial(read_values, "--fix")),
        Asked(_MODEL, "NAME=VALUE", write=write_values),
    ] = Field(
        default_factory=dict,
        validation_alias=AliasChoices("fix", "fixed"),
        description="Hold a parameter, as in r_hyd=3.6mm; may be repeated.",
    )
    start: Annotated[
        Mapping[str, float],
        known_values(partial(read_values, "--start")),
        Asked(("fit",), "NAME=VALUE", write=write_values),
    ] = Field(
        default_factory=dict,
        description="Begin here alone, as in k_ref=0.3N*m/rad; what is left out begins as in the paper; may be repeated.",
    )
    priors: Annotated[
        Mapping[str, tuple[float, float]],
        known_values(read_priors),
        Asked(_MODEL, "NAME=VALUE±SD", write=partial(write_values, between="±")),
    ] = Field(
        default_factory=dict,
        validation_alias=AliasChoices("prior", "priors"),
        description="What was weighed or measured, as in payload.m=2g±0.1g or modulus=2MPa±0.3MPa; may be repeated.",
    )
    bounds: Annotated[
        Mapping[str, tuple[float, float]],
        known_values(read_bounds),
        Asked(_MODEL, "NAME=LOW..HIGH", write=partial(write_values, between="..")),
    ] = Field(
        default_factory=dict,
        validation_alias=AliasChoices("bound", "bounds"),
        description="Other bounds, as in r_hyd=3mm..4mm; may be repeated.",
    )
    loss: Annotated[Literal["auto", "linear", "huber"], Asked(_MODEL)] = Field(
        default="auto",
        description="huber: for tracks with wrong frames; auto takes it where a track leaves the model in jumps.",
    )
    pressure_zero_sd: Annotated[float, quantity("Pa", "1kPa"), _standard_error("Pa")] = Field(
        default=0.0,
        ge=0,
        validation_alias=AliasChoices("pressure_zero", "pressure_zero_sd"),
        description="Standard error of the pressure sensor's zero, then found for every run, such as 1kPa.",
    )
    angle_zero_sd: Annotated[float, quantity("rad", "2deg"), _standard_error("rad")] = Field(
        default=0.0,
        ge=0,
        validation_alias=AliasChoices("angle_zero", "angle_zero_sd"),
        description="Standard error of an angle sensor's zero, then found for every run without a tip, such as 2deg.",
    )
    frames: Annotated[int | None, Asked(_MODEL, "COUNT")] = Field(
        default=None, ge=10, description="At most so many frames of each run, evenly chosen; by default all."
    )
    study_segments: Annotated[bool, Asked(("fit",))] = Field(
        default=False, description="Try 2, 4, 8, 16 and 32 segments too: errors, path of the tip, seconds."
    )
    profile: Annotated[tuple[str, ...], Asked(("fit",), "NAME")] = Field(
        default=(), description="Profile likelihood of a parameter; may be repeated."
    )
    leave_one_out: Annotated[bool, Asked(("fit",))] = Field(
        default=False, description="Fit again without each training run, and score that run."
    )
    starts: int = Field(default=2, ge=0, description="Number of random starts beside the regular ones.")
    auto_segments: bool = Field(
        default=False, description="Whether `segments` is only where the search for their number begins."
    )
    named: Annotated[
        bool, Field(exclude=True, description="Whether `name` was asked for: told by itself, and in no record.")
    ] = field(default=False, compare=False)

    @model_validator(mode="before")
    @classmethod
    def _complete(cls, given: Any) -> Any:
        """Take effects apart, the word auto for what it means, and call a model without a name after its effects."""
        values = dict((given.kwargs or {}) if isinstance(given, ArgsKwargs) else given)
        if values.get("segments") == "auto":
            values |= {"segments": SEGMENTS, "auto_segments": True}
        key = "add" if "add" in values else "effects"
        listed = values.get(key) or ()
        if not isinstance(listed, str):
            values[key] = tuple(dict.fromkeys(name for item in listed for name in str(item).split(",")))
            values.setdefault("named", bool(values.get("name")))
            values["name"] = values.get("name") or "+".join(("base", *values[key]))
        name = str(values.get("name"))
        if "/" in name or "\\" in name or name.startswith("."):
            raise InputError(f"--name {name}: cannot name a folder; use letters, digits and dashes")
        return values

    def with_segments(self, segments: int) -> FitOptions:
        """Return the same options for another number of segments: what is given per joint goes with it."""
        factor = segments / self.segments

        def of(name: str) -> float:
            return factor if name in PER_JOINT else 1.0

        return replace(
            self,
            segments=segments,
            fixed={name: of(name) * value for name, value in self.fixed.items()},
            start={name: of(name) * value for name, value in self.start.items()},
            bounds={name: (of(name) * low, of(name) * high) for name, (low, high) in self.bounds.items()},
            priors={name: (of(name) * mean, of(name) * sd) for name, (mean, sd) in self.priors.items()},
        )
