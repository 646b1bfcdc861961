"""Parameters of every segment: stiffness, damping or rest angle of each joint by itself, where a smooth profile is not enough.

These are effects like any other (exact derivatives, nested in the tube without them); they are made for a number of
joints, so they are used from Python and not from the catalogue.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import sympy as sp

from rfea_vision.effects.base import Effect, EffectParameter, Joint
from rfea_vision.errors import InputError

_KINDS = {
    "stiffness": EffectParameter("1", 0.0, -0.9, 10.0, 0.1, "share of the joint's stiffness added"),
    "damping": EffectParameter("1", 0.0, -0.9, 10.0, 0.1, "share of the joint's damping added"),
    "rest_angle": EffectParameter("rad", 0.0, -0.5, 0.5, 0.01, "angle at which the joint's spring is at rest"),
}


def per_segment(what: Literal["stiffness", "damping", "rest_angle"], segments: int) -> Effect:
    """An effect with one parameter per joint, `segment_stiffness.s1` .. `s<n>` from clamp to tip.

    stiffness, damping : k_j (1 + s_j), b_j (1 + s_j); rest_angle : the spring of joint j is at rest at s_j (rad)

    Raises
    ------
    InputError
        Another kind, or fewer than one segment.
    """
    if what not in _KINDS or segments < 1:
        raise InputError(f"per_segment: '{what}' for {segments} segments; use {', '.join(_KINDS)} and at least 1")
    names = [f"s{index + 1}" for index in range(segments)]

    def own(effect: Effect, joint: Joint) -> Any:
        """The joint's own parameter: that of the interval of the material coordinate in which it lies."""
        # Joints sit in the middle or at the start of their interval; a quarter of it is clear of either.
        steps = [
            (getattr(effect, name), joint.position < sp.Rational(4 * k + 3, 4 * segments))
            for k, name in enumerate(names)
        ]
        return sp.Piecewise(*steps[:-1], (steps[-1][0], True)) if segments > 1 else steps[0][0]

    def scaled(effect: Effect, joint: Joint, value: Any) -> Any:
        return value * (1 + own(effect, joint))

    def moved(effect: Effect, joint: Joint, value: Any) -> Any:
        return value + own(effect, joint)

    hook: Callable[..., Any] = moved if what == "rest_angle" else scaled
    content = {
        "id": f"segment_{what}",
        "title": f"{what.replace('_', ' ').capitalize()} of every segment",
        "reference": "one parameter per joint of eqs. SpringCoefficient and DamperCoefficient",
        "parameters": dict.fromkeys(names, _KINDS[what]),
        "source_text": f"per_segment {what} {segments} 1",
        what: hook,
    }
    return type(f"Segment{what.title().replace('_', '')}", (Effect,), content)()
