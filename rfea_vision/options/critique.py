"""What a critique may be asked for."""

from __future__ import annotations

from typing import Annotated

from pydantic import AliasChoices, Field
from pydantic.dataclasses import dataclass

from rfea_vision.options.asking import CLOSED, Asked, quantity
from rfea_vision.options.fit import EffectFiles, Seed


@dataclass(frozen=True, kw_only=True, config=CLOSED)
class CritiqueOptions:
    """How effects are judged, and how far the ladder is climbed."""

    seed: Seed = 0
    effect_files: EffectFiles = ()
    stand_ins: Annotated[bool, Asked(("improve",))] = Field(
        default=False,
        description="Go on with effects that lower the held-out error though they are hardly its cause, marked as such.",
    )
    budget_s: Annotated[
        float | None, quantity("s", "5min"), Asked(("improve", "demo"), "TIME", write=lambda value, _: [f"{value:g}s"])
    ] = Field(
        default=None,
        ge=0,
        validation_alias=AliasChoices("budget", "budget_s"),
        description="Time after which nothing is added that is not named; by default there is none.",
    )
