"""The tube as a MuJoCo chain: bodies on the hinge line, and the forces that act on them from outside.

Legend: x to the camera's right, y up, tube hanging along -y and bending towards -x; phi, absolute angle of a body;
body centres lie on the hinge line, which starts at (-r_o, 0). MuJoCo supplies mass matrix, gravity and Coriolis forces.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import Any, Literal

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts import Actuator

mujoco: Any = import_module("mujoco")  # its type stubs do not list what the compiled module offers

GRAVITY = 9.80665  # m/s^2, standard gravity


class HingedRods:
    """Rigid bodies hinged in a plane.

    Parameters
    ----------
    actuator : dimensions and densities at rest
    n : number of joints
    layout : ``middle``: half a body at either end, the first one clamped; ``start``: a whole body after each joint
    hidden : effect parameters (the full table, SI)
    gravity_deg : direction of gravity from down, positive towards -x; None for none in the plane

    Attributes
    ----------
    has_base : whether a compliant clamp adds a joint before the others (`base_rotation`)
    size : degrees of freedom, n or n + 1
    """

    def __init__(
        self,
        actuator: Actuator,
        n: int,
        layout: Literal["middle", "start"],
        hidden: Mapping[str, float],
        gravity_deg: float | None = 0.0,
    ) -> None:
        self.actuator, self.n, self.hidden = actuator, n, hidden
        self.has_base = hidden["base_rotation.c"] > 0
        self.size = n + self.has_base
        piece = actuator.length / n
        self.lead = piece / 2 if layout == "middle" else 0.0
        self.lengths = np.full(n, piece)
        if layout == "middle":
            self.lengths[-1] = piece / 2
        outer, inner = actuator.outer_radius, actuator.inner_radius
        self.line_density = np.pi * (actuator.density * (outer**2 - inner**2) + actuator.fluid_density * inner**2)
        self.masses = self.line_density * self.lengths
        self.com_offset = hidden["com_offset.a"] * outer
        tilt = hidden["gravity_tilt.angle"] + np.radians(gravity_deg or 0.0)
        self.gravity = (0.0 if gravity_deg is None else GRAVITY) * np.array([-np.sin(tilt), -np.cos(tilt)])
        self.model = mujoco.MjModel.from_xml_string(self._xml())
        self.data = mujoco.MjData(self.model)
        self._bodies = np.array([self.model.body(f"body{index}").id for index in range(n)])
        self._rest_mass = self.model.body_mass.copy()
        self._rest_inertia = self.model.body_inertia.copy()
        self._full = np.zeros((self.size, self.size))
        self._bias = np.zeros(self.size)

    def _inertial(self, mass: float, length: float, last: bool = False) -> str:
        outer, inner = self.actuator.outer_radius, self.actuator.inner_radius
        across = mass * (3 * (outer**2 + inner**2) + length**2) / 12  # eq. CylinderIx
        middle = length / 2
        if self.lead and last:
            # The chain of hinged rods rings too fast by 2e-4 at 32 joints, all of it from the free end, where the sum
            # over rods lacks the end term h^2/24 of the Euler-Maclaurin formula. With it 1e-6 is left.
            middle += length / 6
        return (
            f'<inertial pos="{self.com_offset!r} {-middle!r} 0" mass="{mass!r}" '
            f'diaginertia="{across!r} {across!r} {across!r}"/>'
        )

    def _point(self, name: str, mass: float, x: float, y: float) -> str:
        tiny = mass * 1e-8
        return (
            f'<body name="{name}" pos="{x!r} {y!r} 0">'
            f'<inertial pos="0 0 0" mass="{mass!r}" diaginertia="{tiny!r} {tiny!r} {tiny!r}"/></body>'
        )

    def _xml(self) -> str:
        outer = self.actuator.outer_radius
        opening, closing = "", ""
        if self.has_base:  # the clamp turns about the middle of the first cross-section and carries its half body
            mass = self.line_density * max(self.lead, 1e-4)
            opening += '<body name="clamp"><joint type="hinge" axis="0 0 -1"/>' + self._inertial(
                mass, max(self.lead, 1e-4)
            )
            closing = "</body>" + closing
        heavy_at = min(int(self.hidden["heavy_section.at"] * self.n), self.n - 1)
        for index, (mass, length) in enumerate(zip(self.masses, self.lengths, strict=True)):
            position = f"{-outer!r} {-self.lead!r} 0" if index == 0 else f"0 {-float(self.lengths[index - 1])!r} 0"
            opening += f'<body name="body{index}" pos="{position}"><joint type="hinge" axis="0 0 -1"/>'
            opening += self._inertial(float(mass), float(length), index == self.n - 1)
            if self.hidden["heavy_section.m"] and index == heavy_at:
                opening += self._point("heavy", self.hidden["heavy_section.m"], 0.0, -float(length) / 2)
            if self.hidden["payload.m"] and index == self.n - 1:
                opening += self._point(
                    "payload", self.hidden["payload.m"], self.hidden["payload.offset"] * outer, -float(length)
                )
            closing = "</body>" + closing
        gravity = f"{float(self.gravity[0])!r} {float(self.gravity[1])!r} 0"
        return (
            f'<mujoco><compiler angle="radian"/><option gravity="{gravity}"><flag contact="disable"/></option>'
            f"<worldbody>{opening}{closing}</worldbody></mujoco>"
        )

    def inertia_and_bias(self, q: FloatArray, v: FloatArray, *, inertia: bool = True) -> tuple[FloatArray, FloatArray]:
        """Mass matrix (size, size) and the bias force (size,): gravity and velocity terms on the left-hand side."""
        model, data = self.model, self.data
        data.qpos[:], data.qvel[:] = q, v
        if self.hidden["variable_mass.a"]:
            self._take_in_water(q[self.has_base :])
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        if inertia:
            mujoco.mj_makeM(model, data)
            _full_mass_matrix(model, data, self._full)
        mujoco.mj_comVel(model, data)
        mujoco.mj_rne(model, data, 0, self._bias)
        return self._full, self._bias

    def _take_in_water(self, theta: FloatArray) -> None:
        """Water that has flowed in since rest: a rho_f pi r_o^3 theta per joint, half to the body on either side."""
        water = self.hidden["variable_mass.a"] * self.actuator.fluid_density * np.pi * self.actuator.outer_radius**3
        if self.lead:
            added = water * 0.5 * (theta + np.append(theta[1:], 0.0))
        else:
            added = water * theta
        ratio = 1 + added / self.masses
        self.model.body_mass[self._bodies] = self._rest_mass[self._bodies] * ratio
        self.model.body_inertia[self._bodies] = self._rest_inertia[self._bodies] * ratio[:, None]

    def outside_forces(self, q: FloatArray, v: FloatArray, wind_N_m: float, shake_m_s2: float) -> FloatArray | None:
        """Generalised forces (size,) of what acts on the tube from outside, taken at the bodies' middles.

        Drag and wind act on the centre line; a shaken frame is a uniform acceleration along x. None where nothing acts.
        """
        get = self.hidden
        drag, wall = get["drag.c"], get["contact.k"]
        if not (drag or wall or wind_N_m or shake_m_s2):
            return None
        outer = self.actuator.outer_radius
        theta, rate = q[self.has_base :], v[self.has_base :]
        phi = np.cumsum(theta) + (q[0] if self.has_base else 0.0)
        omega = np.cumsum(rate) + (v[0] if self.has_base else 0.0)
        along = np.stack([-np.sin(phi), -np.cos(phi)], axis=1)
        out = np.stack([np.cos(phi), -np.sin(phi)], axis=1)
        ends = np.cumsum(along * self.lengths[:, None], axis=0)
        hinges = np.array([-outer, -self.lead]) + np.vstack([np.zeros((1, 2)), ends[:-1]])
        middle = hinges + along * self.lengths[:, None] / 2 + out * outer
        force = np.zeros_like(middle)
        if drag:
            # d(along)/dt = -omega out, d(out)/dt = omega along
            hinge_speed = np.vstack([np.zeros((1, 2)), np.cumsum(-out * (omega * self.lengths)[:, None], axis=0)[:-1]])
            speed = hinge_speed - out * (omega * self.lengths / 2)[:, None] + along * (omega * outer)[:, None]
            force -= (drag * 2 * outer * self.lengths * np.hypot(*speed.T))[:, None] * speed
        force[:, 0] += wind_N_m * self.lengths + shake_m_s2 * self.masses
        # moments about the origin, positive as the angles are: towards -x
        moment = force[:, 0] * middle[:, 1] - force[:, 1] * middle[:, 0]
        if wall:  # at several points of each body, lest the tube touch body by body
            for share in (0.1, 0.3, 0.5, 0.7, 0.9):
                point = hinges + along * (share * self.lengths)[:, None] + out * outer
                push = 0.2 * wall * self.lengths / self.actuator.length
                push = push * np.maximum(0.0, -get["contact.d"] - point[:, 0])
                force[:, 0] += push
                moment += push * point[:, 1]
        total_force = np.cumsum(force[::-1], axis=0)[::-1]
        total_moment = np.cumsum(moment[::-1])[::-1]
        generalised = total_moment - total_force[:, 0] * hinges[:, 1] + total_force[:, 1] * hinges[:, 0]
        return np.append(total_moment[0], generalised) if self.has_base else generalised


def _full_mass_matrix(model: Any, data: Any, out: FloatArray) -> None:
    """Dense mass matrix; MuJoCo 4 reads it from the data, older ones from the sparse array."""
    try:
        mujoco.mj_fullM(model, data, out)
    except TypeError:
        mujoco.mj_fullM(model, out, data.qM)
