"""A planar chain of hinged bodies: the tube's, with its joints in either place, or any other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts.measurement import Actuator
from rfea_vision.errors import InputError
from rfea_vision.tube import body_inertia, body_mass


@dataclass(frozen=True)
class Chain:
    """A planar chain of n hinged bodies, SI units. Arrays of shape (n,); the first hinge hangs `base_length` below the clamp.

    along, across : centre of mass from the hinge, along the body and towards the outside of the bend
    force_along, force_across : point on which body forces act (the middle of the centre line)
    added_along : where along the body sits the mass that it gains as its joint bends: in the middle of the joint's arc
    position : material coordinate of each joint (0 clamp, 1 tip); arc : rest length that each joint stands for
    offset : of the centre line from the hinge line (m); bore_offset : the same of a tube, and 0 of a beam, whose bore does not follow
    count : what makes a joint's angle the tube's: n for a tube, 1 for a general chain
    """

    length: FloatArray
    mass: FloatArray
    along: FloatArray
    across: FloatArray
    inertia: FloatArray
    force_along: FloatArray
    force_across: FloatArray
    added_along: FloatArray
    position: FloatArray
    arc: FloatArray
    base_length: float
    count: float
    outer_radius: float
    offset: float
    inner_radius: float
    fluid_density: float
    polygon: bool = True
    bore_offset: float = 0.004

    @classmethod
    def tube(cls, actuator: Actuator, segments: int, joints: Literal["middle", "start"] = "middle") -> Chain:
        """Chain of the tube: joints in the middle of the arc they stand for, or at the start of each body (the paper's).

        Raises
        ------
        InputError
            If there is no segment, or `joints` is unknown.
        """
        if segments < 1:
            raise InputError(f"segments: {segments} is too few; use at least 1")
        arc = actuator.length / segments
        length = np.full(segments, arc)
        shift = np.zeros(segments)
        if joints == "middle":
            length[-1] = arc / 2
            # A curve falls below the straight bodies that stand for it: over the arc of every joint its weight has h^2/24 more
            # of a lever than theirs. Moving the last centre of mass by h/12 gives that to every joint at once.
            shift[-1] = arc / 12
            position = (np.arange(segments) + 0.5) / segments
        elif joints == "start":
            position = np.arange(segments) / segments
        else:
            raise InputError(f"joints: '{joints}' is unknown; use middle or start")
        return cls(
            length=length,
            mass=body_mass(actuator, length),
            along=length / 2 + shift,
            across=np.zeros(segments),
            inertia=body_inertia(actuator, length),
            force_along=length / 2,
            force_across=np.full(segments, actuator.offset),
            added_along=np.zeros(segments) if joints == "middle" else length / 2,
            position=position,
            arc=np.full(segments, arc),
            base_length=arc / 2 if joints == "middle" else 0.0,
            count=float(segments),
            outer_radius=actuator.outer_radius,
            offset=actuator.offset,
            inner_radius=actuator.inner_radius,
            fluid_density=actuator.fluid_density,
            polygon=joints == "start",
            bore_offset=actuator.bore_offset,
        )

    @classmethod
    def general(
        cls, length: Sequence[float], mass: Sequence[float], along: Sequence[float], inertia: Sequence[float]
    ) -> Chain:
        """Any planar chain: link lengths (m), masses (kg), centres of mass from the hinge (m), inertias about them (kg m^2), (n,) each.

        Raises
        ------
        InputError
            If their numbers differ.
        """
        values = [np.asarray(v, dtype=float) for v in (length, mass, along, inertia)]
        n = values[0].size
        if any(v.shape != (n,) for v in values):
            raise InputError("chain: length, mass, along and inertia must have one entry per body")
        return cls(
            length=values[0],
            mass=values[1],
            along=values[2],
            across=np.zeros(n),
            inertia=values[3],
            force_along=values[2],
            force_across=np.zeros(n),
            added_along=values[2],
            position=np.linspace(0, 1, n),
            arc=values[0],
            base_length=0.0,
            count=1.0,
            outer_radius=0.004,
            offset=0.004,
            inner_radius=0.003,
            fluid_density=0.0,
        )

    @property
    def bodies(self) -> int:
        """How many bodies there are, and so joints."""
        return self.length.size
