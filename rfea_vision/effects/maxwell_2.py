"""A second Maxwell branch: rubber seldom relaxes with one time constant."""

from __future__ import annotations

from rfea_vision.effects.maxwell import Maxwell


class SecondMaxwell(Maxwell):
    """The same law with a stiffness and a time constant of its own, beside the first branch."""

    id = "maxwell_2"
    title = "Second branch of visco-elastic relaxation"
    reference = "Wiechert 1893, doi:10.1002/andp.18932861209; Ferry, Viscoelastic Properties of Polymers, 1980"
    shows = "with one branch fitted, the creep still starts too slowly and ends too early"
    mistaken_for = "a time constant of the first branch that is off"
    split_by = "one long hold: two branches leave two slopes of the creep over the logarithm of time"
    goes_with = ("maxwell",)
