"""Dimensions of a tube that are right in form and unlikely: above all, diameters given as radii."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rfea_vision.artefacts import Actuator

if TYPE_CHECKING:
    import xarray as xr

#: Short actuators are about three times as long as thick; one given by its diameters, or in cm, falls below this.
_LEAST_SLENDER = 2.0
#: A length in cm that is called mm is a tenth of 3 diameters or more; one in m a thousandth of 100 at most.
_IN_M = 0.1
#: kg/m^3: osmium, the densest solid, and the lightest foams (CRC Handbook of Chemistry and Physics).
_DENSEST, _LIGHTEST = 22_600.0, 10.0
#: kg/m^3: silicones and natural rubbers begin at 900; four times the area, as diameters make of it, leaves at most 400.
_LIGHTEST_RUBBER = 700.0
_PAPER_DIAMETERS_MM = (8.0, 6.0)
#: Of the radius, by which the middle of a tube lengthens for each rad of bend: half of it is what diameters give. Noise and a real
#: inextensible side that gives a little move it by less than this.
_HALVED = (0.4, 0.6)
#: What the lengthening must be read from: rad of bend between two postures, and the share of its variance that the bend tells.
_LEAST_BEND, _TOLD = 0.35, 0.9


def of_tube(tube: Actuator) -> list[tuple[str, str]]:
    """Doubt dimensions, densities and the mass: the key under `actuator` and why."""
    outer, inner, length = 1e3 * tube.outer_radius, 1e3 * tube.inner_radius, 1e3 * tube.length
    doubts = []
    if length < _LEAST_SLENDER * 2 * outer:
        text = f"a length of {length:g} mm is {length / (2 * outer):.2g} times the diameter of {2 * outer:g} mm; "
        why = "is the length in m?" if length < _IN_M * 2 * outer else "is the length in cm, or the radius a diameter?"
        doubts.append(("outer_radius", text + why))
    elif (outer, inner) == _PAPER_DIAMETERS_MM:
        text = f"{outer:g} and {inner:g} mm are the diameters that the paper prints; its radii are 4 and 3 mm"
        doubts.append(("outer_radius", text))
    elif text := _too_light(tube):
        doubts.append(("outer_radius", text))
    for key in ("density", "fluid_density"):
        value = getattr(tube, key)
        if value > _DENSEST or (key == "density" and value < _LIGHTEST):
            than = "more than any solid's" if value > _DENSEST else "less than any rubber's"
            doubts.append((key, f"{value:g} kg/m^3 is {than}; is the unit right?"))
    return doubts


def _too_light(tube: Actuator) -> str:
    """Why the mass of a tube does not go with its radii; empty where it does, or was not weighed."""
    if tube.kind != "tube" or tube.mass_per_length is None:
        return ""
    mass_g = 1e3 * tube.mass_per_length * tube.length
    fluid_g = 1e3 * np.pi * tube.inner_radius**2 * tube.fluid_density * tube.length
    wall = 1e-3 * (mass_g - fluid_g) / (tube.solid_area * tube.length)
    if wall >= _LIGHTEST_RUBBER:
        return ""
    left = f"leaves {wall:.0f} kg/m^3 for the wall, less than a rubber's" if wall > 0 else "is more than all of it"
    return (
        f"the tube weighs {mass_g:.3g} g, and the fluid in a bore of {1e3 * tube.inner_radius:g} mm radius {fluid_g:.3g} g, which "
        f"{left}; are the radii diameters, or was it weighed empty?"
    )


def of_stretch(track: xr.Dataset, tube: Actuator) -> list[str]:
    """Doubt the radii by how much the line of another tool's track lengthens as a tube bends about its outer side."""
    if tube.kind != "tube" or "midline" not in track:
        return []
    line = track["midline"].values[track["valid"].values.astype(bool)]
    line = line[np.isfinite(line).all(axis=(1, 2))]
    steps = np.diff(line, axis=1)
    if len(line) < 20 or steps.shape[1] < 4:
        return []
    heading = np.unwrap(np.arctan2(steps[..., 1], steps[..., 0]), axis=1)
    bend, length_mm = heading[:, -1] - heading[:, 0], np.linalg.norm(steps, axis=2).sum(axis=1)
    if np.ptp(np.percentile(bend, (2, 98))) < _LEAST_BEND or np.corrcoef(bend, length_mm)[0, 1] ** 2 < _TOLD:
        return []
    slope_mm, radius_mm = abs(float(np.polyfit(bend, length_mm, 1)[0])), 1e3 * tube.outer_radius
    if not _HALVED[0] < slope_mm / radius_mm < _HALVED[1]:
        return []
    return [
        f"its line lengthens by {slope_mm:.2g} mm for each rad of bend, and the middle of a tube by its outer radius, given as "
        f"{radius_mm:g} mm; are actuator.outer_radius and inner_radius diameters?"
    ]
