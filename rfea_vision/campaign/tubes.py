"""Dimensions of a tube that are right in form and unlikely, as diameters given as radii are; and pressures that do not go with them."""

from __future__ import annotations

from collections.abc import Iterable
from math import cos, radians, sin
from typing import TYPE_CHECKING

import numpy as np
from scipy import constants

from rfea_vision.artefacts import Actuator
from rfea_vision.artefacts.measurement import ELASTOMER_MODULUS, bend_sign
from rfea_vision.campaign.tracked import lengths, valid_rows
from rfea_vision.lines import from_down

if TYPE_CHECKING:
    import xarray as xr

    from rfea_vision.arrays import FloatArray

#: Length over diameter: short actuators have about 3; one given by its diameters, or in cm, has less than this.
_LEAST_SLENDER = 2.0
#: The same, where the length is in m: cm that are called mm leave 0.3 and more, m that are called mm 0.1 at most.
_IN_M = 0.1
#: Mass of the tube over that of its fluid, below which it was given in mg for g: no error of a radius does as much.
_GRAMS_IN_MG = 0.05
#: Bore over outer radius, below which the decimal point is wrong: hoses and actuators have a third and more.
_NARROW = 0.1
#: Materials whose moduli are those of elastomers; one that is not named is taken for one.
_ELASTOMERS = ("", "PDMS", "SILICONE", "RUBBER")
#: Bend (rad) that the highest pressure of a campaign must be able to hold, at which the tip is an eighth of the length aside; and the
#: least range of the bend from which a modulus is found: in less, the shape at rest and noise have too large a part. Chosen.
_LEAST_HELD, _LEAST_SWING = 0.25, 0.1
#: kg/m^3 of lead, of mercury, and of the lightest foams (CRC Handbook of Chemistry and Physics): no wall and no fluid of an actuator is
#: denser or lighter. A rubber's 900 to 2,000 that are taken for lb/ft^3 are 14,400 and more.
_DENSEST, _DENSEST_FLUID, _LIGHTEST = 11_340.0, 13_600.0, 10.0
#: Bend (rad) that a load must leave a tube under the highest pressure, at which the tip is a fortieth of the length aside. Chosen.
_LEAST_LOADED = 0.05
#: kg/m^3: silicones and natural rubbers begin at 900; diameters given as radii make the wall's area four times as large, and leave 400.
_LIGHTEST_RUBBER = 700.0
#: Length of the tube over the picture's longer side, and its width (px), below both of which no edge of it is found; and its length
#: over the picture's diagonal, above which it is not in the picture at all.
_LEAST_SEEN, _LEAST_WIDE_PX, _MOST_SEEN = 0.1, 6.0, 2.0
_PAPER_DIAMETERS_MM = (8.0, 6.0)
#: Lengthening of the centre line per rad of bend, over the radius: it is 1, and 0.5 where the radius is a diameter. Noise, and an
#: inextensible side that gives a little, change it by less than these bounds leave.
_HALVED = (0.4, 0.6)
#: Share of the tube's length, and standard errors, by which its line may be longer or shorter: the same as of films.
_OTHER_LENGTH, _CLEAR = 0.03, 4.0
#: Share of the width: blur and shade move either edge by half a pixel or so, and tubes widen under pressure. Chosen.
_OTHER_WIDTH = 0.1
#: Range of the bend (rad) from which the lengthening is read, and the share of its variance that the bend must explain.
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
    elif said := _of_mass(tube):
        doubts.append(said)
    if tube.kind == "tube" and inner < _NARROW * outer:
        text = f"a bore of {inner:g} mm radius in a tube of {outer:g} mm is {100 * (inner / outer) ** 2:.2g} % of its section; "
        doubts.append(("inner_radius", text + "is the unit right, and the place of the decimal point?"))
    for key, densest, name in (("density", _DENSEST, "lead"), ("fluid_density", _DENSEST_FLUID, "mercury")):
        value = getattr(tube, key)
        if value > densest or (key == "density" and value < _LIGHTEST):
            than = f"more than {name}'s" if value > densest else "less than any rubber's"
            doubts.append((key, f"{value:g} kg/m^3 is {than}; is the unit right?"))
    return doubts


def _of_mass(tube: Actuator) -> tuple[str, str] | None:
    """The key and why the mass of a tube does not go with its radii; None where it does, or was not weighed."""
    if tube.kind != "tube" or tube.mass_per_length is None:
        return None
    mass_g = 1e3 * tube.mass_per_length * tube.length
    fluid_g = 1e3 * np.pi * tube.inner_radius**2 * tube.fluid_density * tube.length
    wall = 1e-3 * (mass_g - fluid_g) / (tube.solid_area * tube.length)
    if _LIGHTEST_RUBBER <= wall <= _DENSEST:
        return None
    if wall > _DENSEST or mass_g < _GRAMS_IN_MG * fluid_g:
        text = f"the tube would weigh {mass_g:.3g} g, and the fluid in it {fluid_g:.3g} g; is the unit right?"
        return "mass", text
    left = f"leaves {wall:.0f} kg/m^3 for the wall, less than a rubber's" if wall > 0 else "is more than all of it"
    return "outer_radius", (
        f"the tube weighs {mass_g:.3g} g, and the fluid in a bore of {1e3 * tube.inner_radius:g} mm radius {fluid_g:.3g} g, which "
        f"{left}; are the radii diameters, or was it weighed empty?"
    )


def of_stretch(track: xr.Dataset, tube: Actuator) -> list[str]:
    """Doubt the radii by how much the line of another tool's track lengthens as a tube bends about its outer side, and its length.

    Where it does not bend, the line is as long as that side.
    """
    if tube.kind != "tube" or "midline" not in track:
        return []
    line = valid_rows(track, "midline")
    line = line[np.isfinite(line).all(axis=(1, 2))]
    steps = np.diff(line, axis=1)
    if len(line) < 20 or steps.shape[1] < 4:
        return []
    heading = np.unwrap(np.arctan2(steps[..., 1], steps[..., 0]), axis=1)
    bend, length_mm = heading[:, -1] - heading[:, 0], lengths(line)
    if np.ptp(np.percentile(bend, (2, 98))) < _LEAST_BEND or np.corrcoef(bend, length_mm)[0, 1] ** 2 < _TOLD:
        return []
    (slope_mm, straight_mm), covariance = np.polyfit(bend, length_mm, 1, cov=True)
    radius_mm, given_mm = 1e3 * tube.outer_radius, 1e3 * tube.length
    if _HALVED[0] < abs(slope_mm) / radius_mm < _HALVED[1]:
        return [
            f"its line lengthens by {abs(slope_mm):.2g} mm for each rad of bend, and the middle of a tube by its outer radius, given "
            f"as {radius_mm:g} mm; are actuator.outer_radius and inner_radius diameters?"
        ]
    if abs(straight_mm - given_mm) > max(_OTHER_LENGTH * given_mm, _CLEAR * float(np.sqrt(covariance[1, 1]))):
        return [
            f"its line is {straight_mm:.4g} mm long where it is straight, {100 * (straight_mm / given_mm - 1):+.1f} % against "
            f"actuator.length, {given_mm:g} mm; is that of the part that bends, and is the line from the clamp to the tip?"
        ]
    return []


def of_width(track: xr.Dataset, tube: Actuator) -> list[str]:
    """Doubt the outer radius of a filmed tube by how wide it is seen: beside how long, as a wrong scale changes both alike.

    Not of one that is followed as a whole body: where no edges can be read, shade makes it narrower by a fifth.
    """
    seen = track["valid"].values.astype(bool)
    if "width" not in track or not seen.any() or track.attrs.get("followed_by") == "body":
        return []
    width_mm, sigma_mm = (float(np.nanmedian(track[name].values[seen])) for name in ("width", "width_sigma"))
    given_mm, length_mm = 2e3 * tube.outer_radius, 1e3 * tube.length
    long = float(track.attrs.get("hinge_length_mm", length_mm)) / length_mm
    off = width_mm / given_mm / long - 1
    if not abs(off) > max(_OTHER_WIDTH, _CLEAR * sigma_mm / width_mm):
        return []
    seen_as = f"the tube is seen {width_mm:.3g} mm wide, and is {given_mm:.3g} mm by {tube.width_key}"
    return [f"{seen_as} ({100 * off:+.0f} % beside its length); is that right?"]


def modulus_of(track: xr.Dataset, pressure_kPa: FloatArray, tube: Actuator, gravity_deg: float | None) -> float | None:
    """Young's modulus (Pa) of a wall that bends so far by so much pressure (samples,), as an arc at rest; None where nothing tells.

    At the clamp the pressure's moment is held by the wall and by the weight of the tube. That of an arc of a `bend` is the tube's
    times the mean distance of the arc from the clamp, across gravity. Whatever the clocks, the widest swings of both go together.
    """
    elastic = tube.kind == "tube" and tube.material.upper() in _ELASTOMERS
    if not elastic or not ("bend_angle" in track or "tip" in track):
        return None
    if "bend_angle" in track:
        bend = np.radians(track["bend_angle"].values)
    else:  # an arc's chord has half of its bend
        bend = 2 * from_down(track["tip"].values, bend_sign(tube.bends))
    low, high = np.percentile(bend[np.isfinite(bend)], (1, 99)) if np.isfinite(bend).sum() >= 20 else (0.0, 0.0)
    pushed = _pressure_moment(tube, float(np.ptp(np.percentile(pressure_kPa, (1, 99)))))
    if high - low < _LEAST_SWING or pushed <= 0:
        return None
    weighed = 0.0 if gravity_deg is None else weight_moment(high, tube, gravity_deg) - weight_moment(low, tube, gravity_deg)
    return float((pushed - weighed) * tube.length / (tube.bending_moment_of_area * (high - low)))


def _pressure_moment(tube: Actuator, pressure_kPa: float) -> float:
    """Moment (N m) with which a pressure bends a tube about its outer side."""
    return float(np.pi * tube.inner_radius**2 * tube.outer_radius * 1e3 * pressure_kPa)


def weight_moment(bend: float, tube: Actuator, gravity_deg: float) -> float:
    """Moment (N m) about the clamp, against the bend (rad), of the weight of a tube that is bent to an arc."""
    small = abs(bend) < 1e-3  # the series keeps the digits that the difference loses
    across = bend / 6 if small else (bend - sin(bend)) / bend**2
    along = 0.5 if small else (1 - cos(bend)) / bend**2
    turn = radians(gravity_deg)
    return constants.g * tube.linear_density * tube.length**2 * (across * cos(turn) - along * sin(turn))


def of_moduli(found: Iterable[float | None]) -> str:
    """Doubt pressures and radii by the moduli (Pa) of all runs together; empty where an elastomer may have the middle one."""
    known = [modulus for modulus in found if modulus is not None]
    low, high = ELASTOMER_MODULUS
    if not known or low <= (middle := float(np.median(known))) <= high:
        return ""
    wall = f"like one with a wall of {middle / 1e6:.2g} MPa" if middle > 0 else "by less pressure than its own weight takes"
    return (
        f"the tube bends {wall}, and soft elastomers have {low / 1e6:g} to {high / 1e6:g} MPa; unless it is reinforced or folded, "
        "is pressure.unit right in every run (one psi is 6.9 kPa, one bar 100, one mbar 0.1), and are the radii?"
    )


def of_weight(highest_kPa: float, tube: Actuator, gravity_deg: float | None) -> str:
    """Doubt the highest pressure of all runs where it could not even hold the weight of a hanging tube; empty where it could."""
    pushed = _pressure_moment(tube, highest_kPa)
    if tube.kind != "tube" or gravity_deg != 0.0 or pushed >= weight_moment(_LEAST_HELD, tube, 0.0):
        return ""
    return (
        f"no run goes beyond {highest_kPa:.3g} kPa, which cannot bend this tube by {np.degrees(_LEAST_HELD):.0f} deg against its own "
        "weight, however soft it is; is the log in bar or MPa? pressure.unit says which unit it is in"
    )


def of_load(load_kg: float, highest_kPa: float, tube: Actuator, gravity_deg: float | None) -> str:
    """Doubt a payload that holds a hanging tube straight under the highest pressure (kPa) of all runs; empty where it does not."""
    pushed = _pressure_moment(tube, highest_kPa)
    aside = tube.length * _LEAST_LOADED / 2  # of the tip of an arc
    if tube.kind != "tube" or gravity_deg != 0.0 or not 0 < pushed < constants.g * load_kg * aside:
        return ""
    straight = f"holds this tube straight, to {np.degrees(_LEAST_LOADED):.0f} deg"
    return (
        f"a payload of {1e3 * load_kg:g} g {straight}, under the highest pressure of all runs, {highest_kPa:.3g} kPa, "
        "however soft it is; is the unit right?"
    )


def of_square(board_mm: FloatArray, pixels: FloatArray, shape: tuple[int, ...], tube: Actuator) -> str:
    """Doubt the board's square by how large the tube would be in a picture of this shape, from corners (n, 2) of the board there."""
    px_per_mm = float(np.sqrt(np.var(pixels, axis=0).sum() / np.var(board_mm, axis=0).sum()))
    long, wide = 1e3 * px_per_mm * tube.length, 2e3 * px_per_mm * tube.outer_radius
    height, width = shape[:2]
    if (long >= _LEAST_SEEN * max(shape[:2]) or wide >= _LEAST_WIDE_PX) and long <= _MOST_SEEN * np.hypot(height, width):
        return ""
    return (
        f"by it the tube would be {wide:.2g} px wide and {long:.3g} px long in pictures of {width} x {height} px; is the square "
        "right, and is actuator.length?"
    )
