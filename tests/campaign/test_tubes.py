"""Radii that are diameters: doubted where the mass or the track's own line says so, and only there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from rfea_vision.artefacts import Actuator
from rfea_vision.campaign.resolve import resolve_actuator
from rfea_vision.campaign.schema import ActuatorPart, SectionPart
from rfea_vision.campaign.tubes import (
    modulus_of,
    of_moduli,
    of_square,
    of_stretch,
    of_tube,
    of_weight,
    of_width,
    weight_moment,
)
from rfea_vision.errors import DataError, InputError
from tests.cli.console import rfea

from .campaigns import write_campaign

TUBE = Actuator(outer_radius=0.005, inner_radius=0.0035, length=0.155)
AS_DIAMETERS = replace(TUBE, outer_radius=0.010, inner_radius=0.007)


def filmed(offset_mm: float, bends: str = "left", widest: float = 1.2) -> xr.Dataset:
    """A line that lies `offset_mm` outside of a side of constant length, over postures up to `widest` rad of bend."""
    bend = np.linspace(0.0, widest, 60)[:, None]
    share, sign = np.linspace(0, 1, 21), 1 if bends == "left" else -1
    heading = bend * (share[1:] + share[:-1]) / 2
    step = (155 + offset_mm * bend) / 20
    x, y = (np.pad(np.cumsum(step * part(heading), axis=1), ((0, 0), (1, 0))) for part in (np.sin, np.cos))
    line = np.stack([sign * x, y], axis=-1) + np.random.default_rng(1).normal(0, 0.03, (60, 21, 2))
    return xr.Dataset({"midline": (("time", "node", "xy"), line), "valid": ("time", np.ones(60, dtype=bool))})


@pytest.mark.parametrize("bends", ["left", "right"])
def test_the_line_of_a_track_tells_radii_from_diameters(bends):
    (text,) = of_stretch(filmed(5.0, bends), replace(AS_DIAMETERS, bends=bends))
    assert "given as 10 mm; are actuator.outer_radius and inner_radius diameters?" in text
    assert of_stretch(filmed(5.0, bends), replace(TUBE, bends=bends)) == []


def test_a_line_that_tells_nothing_is_not_doubted():
    assert of_stretch(filmed(0.0), AS_DIAMETERS) == []  # the inextensible side itself
    assert of_stretch(filmed(10.0), AS_DIAMETERS) == []  # diameters indeed
    assert of_stretch(filmed(5.0, widest=0.1), AS_DIAMETERS) == []  # hardly bent
    assert of_stretch(filmed(5.0), replace(AS_DIAMETERS, kind="rod")) == []
    assert of_stretch(xr.Dataset(), AS_DIAMETERS) == []


@pytest.mark.parametrize(("length", "told"), [(0.150, True), (0.160, True), (0.1555, False), (0.152, False)])
def test_a_line_tells_the_length_where_it_is_straight(length, told):
    """Bent by 1.2 rad it is 6 mm longer: only where it is straight it says how long the inextensible side is."""
    said = of_stretch(filmed(5.0), replace(TUBE, length=length))
    assert bool(said) == told and all("its line is 155 mm long where it is straight" in text for text in said)


def test_a_line_that_is_noisy_says_nothing_of_the_length():
    line = filmed(5.0)
    noise = np.random.default_rng(2).normal(0, 40.0, (60, 1, 1)) * np.linspace(0, 1, 21)[None, :, None]
    assert of_stretch(line.assign(midline=line["midline"] + noise), replace(TUBE, length=0.150)) == []


def _seen(width_mm: float, sigma_mm: float = 0.11, length_mm: float = 155.0) -> xr.Dataset:
    """A track of a film, in whose frames the tube is so wide, with the standard error of each."""
    columns = {"width": width_mm, "width_sigma": sigma_mm}
    data = {name: (("time", "node"), np.full((30, 5), value)) for name, value in columns.items()}
    return xr.Dataset(data | {"valid": ("time", np.ones(30, dtype=bool))}, attrs={"hinge_length_mm": length_mm})


def test_a_radius_that_the_film_does_not_show_is_doubted():
    """A radius of 4.5 mm for 4 was read in silence."""
    (text,) = of_width(_seen(8.03), TUBE)
    assert "seen 8.03 mm wide, and is 10 mm by actuator.outer_radius (-20 %" in text
    (text,) = of_width(_seen(8.03), replace(TUBE, kind="rectangle", width=0.03))
    assert "by actuator.section.thickness" in text
    assert of_width(_seen(10.3), TUBE) == of_width(_seen(8.0, sigma_mm=0.8), TUBE) == []
    assert of_width(_seen(8.0, length_mm=0.8 * 155), TUBE) == []  # as short as it is narrow: the scale, which is told of the length
    assert of_width(_seen(8.03).assign_attrs(followed_by="body"), TUBE) == []  # pale on paper: no edges to speak of
    assert of_width(xr.Dataset({"valid": ("time", np.ones(3, dtype=bool))}), TUBE) == []


def test_the_mass_tells_radii_from_diameters():
    weighed = TUBE.linear_density
    assert of_tube(replace(TUBE, mass_per_length=weighed)) == of_tube(TUBE) == of_tube(AS_DIAMETERS) == []
    ((key, text),) = of_tube(replace(AS_DIAMETERS, mass_per_length=weighed))
    assert key == "outer_radius" and "are the radii diameters" in text
    empty = TUBE.density * TUBE.solid_area
    assert "or was it weighed empty" in of_tube(replace(TUBE, mass_per_length=empty))[0][1]


def test_check_and_fit_say_it(tmp_path, monkeypatch):
    folder = write_campaign(tmp_path / "c")
    file = folder / "campaign.yaml"
    file.write_text(file.read_text().replace("inner_radius: 3 mm", "inner_radius: 3.1 mm, mass: 3.1 g"))
    assert "actuator.outer_radius: the tube weighs 3.1 g" in rfea("check", folder).out

    def far_enough(*_: object) -> None:
        raise DataError("far enough")

    monkeypatch.setattr("rfea_vision.stages.mechanics._fitted", far_enough)
    assert rfea("fit", folder).err.count("warning: actuator.outer_radius: the tube weighs 3.1 g") == 1


def test_a_bore_ten_times_too_narrow_is_doubted():
    ((key, text),) = of_tube(replace(TUBE, inner_radius=0.00035))
    assert key == "inner_radius" and "a bore of 0.35 mm radius in a tube of 5 mm is 0.49 % of its section" in text


def held_kPa(bend: np.ndarray, modulus: float, tube: Actuator, gravity_deg: float) -> np.ndarray:
    """The pressure that holds each bend (rad) against wall and weight."""
    weight = np.array([weight_moment(angle, tube, gravity_deg) for angle in bend])
    wall = modulus * tube.bending_moment_of_area / tube.length * bend
    return (wall + weight) / (1e3 * np.pi * tube.inner_radius**2 * tube.outer_radius)


@pytest.mark.parametrize("gravity_deg", [0.0, 180.0, 90.0])
@pytest.mark.parametrize("seen", ["angle", "tip"])
def test_bend_and_pressure_tell_the_modulus_of_the_wall(seen, gravity_deg):
    bend = np.linspace(0.3, 1.2, 50)
    pressure_kPa = held_kPa(bend, 2e6, TUBE, gravity_deg)
    track = xr.Dataset({"bend_angle": ("time", np.degrees(bend))})
    if seen == "tip":
        chord_mm = 155 * np.sin(bend / 2) / (bend / 2)
        tip = np.column_stack([-np.sin(bend / 2), -np.cos(bend / 2)]) * chord_mm[:, None]
        track = xr.Dataset({"tip": (("time", "xy"), tip)})
    assert modulus_of(track, pressure_kPa, TUBE, gravity_deg) == pytest.approx(2e6, rel=0.03)
    assert of_moduli([modulus_of(track, pressure_kPa, TUBE, gravity_deg)]) == ""
    if gravity_deg == 0.0:  # a weight that helps to bend may do it alone
        in_bar = of_moduli([modulus_of(track, pressure_kPa / 100, TUBE, gravity_deg)])
        assert "by less pressure than its own weight takes" in in_bar and "is pressure.unit right in every run" in in_bar
    for other in (replace(TUBE, kind="rod"), replace(TUBE, material="nylon")):
        assert modulus_of(track, pressure_kPa, other, gravity_deg) is None


def test_a_pressure_that_cannot_lift_the_tube_is_doubted():
    assert "no run goes beyond 2.7 kPa" in of_weight(2.7, TUBE, 0.0)
    assert of_weight(270.0, TUBE, 0.0) == of_weight(2.7, TUBE, 180.0) == of_weight(2.7, replace(TUBE, kind="rod"), 0.0) == ""


@pytest.mark.parametrize(("square_mm", "told"), [(9.0, False), (12.0, False), (90.0, True), (0.9, True)])
def test_a_square_in_cm_makes_a_tube_that_no_picture_shows(square_mm, told):
    """The tube had not been found, and its clamp been asked for."""
    corners = np.stack(np.meshgrid(np.arange(9.0), np.arange(6.0)), axis=-1).reshape(-1, 2)
    said = of_square(square_mm * corners, 48.6 * corners, (1280, 720), TUBE)
    assert bool(said) == told and ("is the square right" in said) == told


def test_of_a_thin_tube_whose_bore_is_not_given_that_is_said():
    """It was said that a bore which nobody gave must be smaller."""
    part = ActuatorPart.model_validate({"outer_radius": "2 mm"})
    with pytest.raises(InputError, match=r"is missing: that of the paper's tube, 3 mm, is no smaller than .*, 2 mm; give"):
        resolve_actuator(part)
    assert resolve_actuator(part.model_copy(update={"section": SectionPart(kind="rod")})).outer_radius == 0.002
