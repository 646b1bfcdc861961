"""The lens models there are. Their formulas stand in `calibration/projection.py`, compiled, and in OpenCV."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class LensModel:
    """One lens model, its coefficients in OpenCV's order.

    Attributes
    ----------
    coefficients : how many there are
    title : what the report calls it
    names : what ROS and other programs call it; the first is written
    richer_than : the model that it continues with further coefficients; its solution is where the fit begins
    fisheye : whether OpenCV's equidistant projection is meant, and not that of a pinhole
    tried : whether ``lens: auto`` compares it with the others
    """

    coefficients: int
    title: str
    names: tuple[str, ...]
    richer_than: str | None = None
    fisheye: bool = False
    tried: bool = True


LENSES: dict[str, LensModel] = {
    "brown5": LensModel(
        5, "pinhole with Brown distortion, 5 coefficients", ("plumb_bob", "", "radtan", "brown_conrady")
    ),
    "brown8": LensModel(
        8, "pinhole with rational distortion, 8 coefficients", ("rational_polynomial",), richer_than="brown5"
    ),
    "brown12": LensModel(
        12,
        "pinhole with rational and thin prism distortion, 12 coefficients",
        ("rational_polynomial",),
        richer_than="brown8",
        tried=False,
    ),
    "fisheye": LensModel(4, "fisheye with 4 coefficients", ("equidistant", "fisheye", "kannala_brandt"), fisheye=True),
}


def lens_of(name: str, used: int) -> str | None:
    """The model that another program means by a name, rich enough for `used` coefficients; None for an unknown name."""
    found = next((model for model, lens in LENSES.items() if name in lens.names), None)
    while found is not None and used > LENSES[found].coefficients:
        richer = next((model for model, lens in LENSES.items() if lens.richer_than == found), None)
        if richer is None:
            break
        found = richer
    return found
