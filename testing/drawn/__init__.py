"""Drawn films of soft bending actuators, as people shoot them: all of a film follows from its seed, the truth with it."""

from testing.drawn.film import Stage, Truth, film
from testing.drawn.scene import Scene, draw, summary

__all__ = ["Scene", "Stage", "Truth", "draw", "film", "summary"]
