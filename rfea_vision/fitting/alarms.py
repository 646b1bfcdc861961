"""Values that physics does not allow, said in plain sentences; and a fit that has run away, which is refused."""

from __future__ import annotations

from rfea_vision.artefacts.judgement import RAN_AWAY
from rfea_vision.artefacts.measurement import ELASTOMER_MODULUS, Actuator
from rfea_vision.fitting.coordinates import base_reference, stiffness_per_modulus
from rfea_vision.fitting.refit import Fitted, carried
from rfea_vision.units import rounded

#: Young's modulus of PDMS, Pa, over the usual curing temperatures: Johnston et al. 2014, doi:10.1088/0960-1317/24/3/035017.
PDMS_MODULUS = (1.3e6, 3.0e6)
#: By what factor the modulus may lie beside it: the inextensible side and the pressure in the wall stiffen the tube.
MODULUS_FACTOR = 5.0
RUBBER_DENSITY = (700.0, 2500.0)
#: Times the published value, scaled to the tube's size, at which k or b have run away; bounds end at 50.
RUNAWAY = 45.0
#: A start is kept a little inside of the bounds; one that is moved by more than this share was outside.
MOVED = 0.01


def alarms(fitted: Fitted, actuator: Actuator) -> list[str]:
    """Sentences on densities, masses and moduli that a rubber tube cannot have, and on starts that no fit may have."""
    out = _moved_starts(fitted, actuator)
    low, high = RUBBER_DENSITY
    named = actuator.material.upper() in ("PDMS", "SILICONE", "RUBBER")
    if named and actuator.mass_per_length is None and not low <= actuator.density <= high:
        out.append(
            f"A density of {actuator.density:.0f} kg/m^3 is not that of a rubber ({low:.0f} to {high:.0f}): "
            "check actuator.density."
        )
    values = fitted.values
    own = actuator.linear_density * actuator.length
    extra = values.get("payload.m", 0.0)
    if extra > own:
        out.append(
            f"A payload of {rounded(extra * 1e3, 2)} g is more than the {'filled tube' if actuator.kind == 'tube' else 'beam'} weighs "
            f"({rounded(own * 1e3, 2)} g): weigh it, and give it as a prior."
        )
    modulus = values["k_ref"] / stiffness_per_modulus(actuator, fitted.options.segments)
    low, high = PDMS_MODULUS[0] / MODULUS_FACTOR, PDMS_MODULUS[1] * MODULUS_FACTOR
    if actuator.material.upper() == "PDMS" and not low <= modulus <= high:
        out.append(
            f"The stiffness at rest is that of a wall with a Young's modulus of {rounded(modulus / 1e6, 2)} MPa, far from PDMS "
            f"({PDMS_MODULUS[0] / 1e6:.1f} to {PDMS_MODULUS[1] / 1e6:.1f} MPa): check the radii and the unit of the pressure."
        )
    low, high = ELASTOMER_MODULUS
    if not actuator.material and actuator.kind == "tube" and not low <= modulus <= high:
        out.append(
            f"The stiffness at rest is that of a wall with a Young's modulus of {rounded(modulus / 1e6, 2)} MPa, and soft "
            f"elastomers have {low / 1e6:g} to {high / 1e6:g} MPa: where the wall is neither reinforced nor folded, check the "
            "radii and pressure.unit (mbar taken for kPa makes a tube ten times as stiff)."
        )
    return out


def _moved_starts(fitted: Fitted, actuator: Actuator) -> list[str]:
    """Values from which the fit was asked to begin, and which lie outside of its bounds."""
    options, names = fitted.options, fitted.model.names
    wanted = carried(fitted.model, actuator, options.segments, options.start, options.segments)
    begun = fitted.coordinates.parameters(fitted.coordinates.coordinates(wanted))
    moved = [k for k in fitted.coordinates.free if names[k] in options.start]
    return [
        f"start {names[k]} = {wanted[k]:.4g} lies outside of the fit's bounds: it began at {begun[k]:.4g} (SI units); "
        f"wider ones are given by '--bound {names[k]}=LOW..HIGH'."
        for k in moved
        if abs(begun[k] - wanted[k]) > MOVED * abs(wanted[k])
    ]


def runaway(fitted: Fitted, actuator: Actuator) -> str:
    """Why a fit is refused; empty where it is not. k, slopes and r_hyd can grow together without end (docs/physics.md 3.10)."""
    if actuator.kind != "tube":  # of anything, from rubber to steel
        return ""
    reference = base_reference(actuator, fitted.options.segments)
    par = fitted.par
    free = set(fitted.coordinates.names)
    for k in (0, 2, 4):
        name = fitted.model.names[k]
        factor = par[k] / reference[k]
        far = factor > RUNAWAY or (factor > 8 and par[6] > 2 * actuator.outer_radius)
        if name not in free or not far:
            continue
        said = f"Refused: {RAN_AWAY}, {name} is {factor:.0f} times what a tube of this size has"
        if "r_hyd" in free and par[6] > actuator.outer_radius:
            lever = f"r_hyd is {par[6] * 1e3:.3g} mm; keep it within its usual bounds, or fix it (--fix r_hyd=3.6mm)"
            return f"{said} and {lever}."
        return f"{said}; is the body a tube that bends about its outer side (actuator.section says what else it may be)?"
    return ""
