"""The body lengthens under pressure."""

from __future__ import annotations

import sympy as sp

from rfea_vision.effects.base import Effect, EffectParameter


class Stretch(Effect):
    """Every length from the clamp is (1 + c p) times that at rest, p the sum of the pressures in all chambers.

    Inertia and weight keep the arms that they have at rest: of a stretch by a tenth that is a tenth of them.
    """

    id = "stretch"
    title = "The body lengthens under pressure"
    reference = "bellows and chambers without an inextensible layer, such as Marchese and Rus 2016, doi:10.1177/0278364915587925"
    shows = "the tip moves along the body with the pressure, to whichever side it bends"
    mistaken_for = "camera_scale, a softer spring"
    split_by = "the same pressure in chambers on both sides: it stretches and does not bend"
    not_of = ("tube",)  # one side of which is inextensible
    parameters = {"c": EffectParameter("1/Pa", 0.0, -2e-5, 2e-5, 1e-7, "relative lengthening", display="1/MPa")}

    def stretch(self, pressure: sp.Symbol) -> sp.Expr:
        return self.c * pressure


class LateStretch(Stretch):
    """The same, p behind a lag T: the rubber gives way in its own time (a spring and a damper side by side, Kelvin and Voigt)."""

    form = "late"
    parameters = {
        **Stretch.parameters,
        "T": EffectParameter(
            "s", None, 0.005, 20.0, 0.5, "time constant of the lengthening", grid=(0.1, 0.5, 2.0), display="ms"
        ),
    }

    def stretch_time_constant(self) -> sp.Expr:
        return self.T
