"""The torque that the pressure does by virtual work."""

from __future__ import annotations

import sympy as sp

from rfea_vision.effects.base import BEAMS, Effect, EffectParameter, Joint


class VirtualWork(Effect):
    """tau = (1 - a) p pi r_i^2 r_hyd + a p pi r_o^3 (dV/dtheta = pi r_o^3 for constant r_o and incompressible rubber)."""

    id = "virtual_work"
    title = "Pressure torque by virtual work"
    reference = "docs/physics.md, erratum 9: dV/dtheta = pi r_o^3"
    shows = "the torque grows less with bending than the paper's law says"
    mistaken_for = "the slope of the stiffness"
    split_by = "steps from several pressures: the slope of stiffness changes the ringing, the torque law does not"
    not_of = BEAMS
    parameters = {"a": EffectParameter("1", 0.0, 0.0, 1.5, 0.5, "share of the virtual-work torque")}

    def hydraulic_torque(self, joint: Joint, torque: sp.Expr) -> sp.Expr:
        return (1 - self.a) * torque + self.a * joint.pressure * sp.pi * joint.rest_outer_radius**3
