"""What a critique may be asked for."""

from __future__ import annotations

from typing import Annotated

from pydantic import AliasChoices, Field
from pydantic.dataclasses import dataclass

from rfea_vision.options.asking import CLOSED, Asked, quantity
from rfea_vision.options.fit import EffectFiles, Seed

#: Share of the squared error above the noise from which on a misfit counts as explained, unless asked otherwise.
EXPLAINED = 0.97


@dataclass(frozen=True, kw_only=True, config=CLOSED)
class CritiqueOptions:
    """How effects are judged, and how far the ladder is climbed."""

    seed: Seed = 0
    effect_files: EffectFiles = ()
    enough: Annotated[
        float,
        quantity("1", "97%"),
        Asked(("diagnose", "improve"), "SHARE", write=lambda value, _: [f"{100 * value:g}%"]),
    ] = Field(
        default=EXPLAINED,
        gt=0,
        le=1,
        description="Share of the misfit (squared error above the noise) that must be explained to earn a name; "
        "default 97%.",
    )
    stand_ins: bool = Field(
        default=False,
        description="Go on with flexible stand-ins for what has no name, after the effects that have one.",
    )
    budget_s: Annotated[
        float | None,
        quantity("s", "5min"),
        Asked(("improve", "demo"), "TIME", write=lambda value, _: [f"{value:g}s"]),
    ] = Field(
        default=None,
        ge=0,
        validation_alias=AliasChoices("budget", "budget_s"),
        description="Time after which no further rung is begun; by default there is none.",
    )
