"""The scale of a film by two points a known distance apart: what stands in the files, and how it is written there or taken out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rfea_vision.campaign import Campaign, ExperimentSpec
from rfea_vision.campaign.schema import ScalePart
from rfea_vision.campaign.yaml_file import read_yaml
from rfea_vision.errors import InputError
from rfea_vision.units import parse_quantity
from rfea_vision.workbench.yaml_edit import set_keys, take_out

DISTANCE = "155 mm"  # an example
#: Keys below `camera` that say how long a pixel is; a run's own stands in place of the campaign's.
SCALING = ("scale", "file", "photos")


def is_scaled(campaign: Campaign, experiment: ExperimentSpec) -> bool:
    """Whether the files say how long a pixel is, be it right or not."""
    _, camera = _deciding(campaign, experiment)
    return experiment.camera is not None or any(camera.get(key) is not None for key in SCALING)


def scale_told(campaign: Campaign, experiment: ExperimentSpec) -> dict[str, Any] | None:
    """The scale as the page draws it: its points, the distance where there are two, and whether it is this film's alone."""
    scale = experiment.camera.scale if experiment.camera is not None else None
    if scale is None:
        return None
    own = _deciding(campaign, experiment)[0] == experiment.file
    if not isinstance(scale, ScalePart):
        return {"points": [], "distance": "", "behind": "", "own": own}
    distance = "" if scale.distance is None else f"{1e3 * scale.distance:g} mm"
    behind = f"{1e3 * scale.behind:g} mm" if scale.behind else ""
    return {"points": [list(point) for point in scale.points], "distance": distance, "behind": behind, "own": own}


def write_scale(
    campaign: Campaign, experiment: ExperimentSpec, size: tuple[int, int], value: dict[str, Any], *, everywhere: bool
) -> Path:
    """Write ``camera.scale`` as the page asks, ``{"points": [[x, y], [x, y]], "distance": "155 mm", "behind": ""}``; `size` in px.

    It goes to campaign.yaml with `everywhere`, but for a run that has a scale of its own, or stands alone.

    Raises
    ------
    InputError
        If the points or the distance tell no scale, a board tells it already, or the file's form does not allow the change.
    """
    from rfea_vision.calibration.scale import scaled_by_distance  # the state, which loads this too, needs no optimiser

    points = [[float(x), float(y)] for x, y in value["points"]]
    distance = " ".join(str(value["distance"]).split())
    if not distance:
        raise InputError(f"camera.scale.distance: is missing; type what lies between the two points, such as {DISTANCE}")
    try:
        metres = parse_quantity(distance, "m", example=DISTANCE)
    except ValueError as error:
        raise InputError(f"camera.scale.distance: {error}") from error
    if metres <= 0:
        found = f"'{distance}' lies between no two points"
        raise InputError(f"camera.scale.distance: {found}; type what you have measured, such as {DISTANCE}")
    behind = " ".join(str(value.get("behind", "")).split())
    try:
        behind_m = parse_quantity(behind or "0 mm", "m", example="12 mm")
    except ValueError as error:
        raise InputError(f"camera.scale.behind: {error}") from error
    scaled_by_distance(size, points, 1e3 * metres, behind_mm=1e3 * behind_m)
    told: dict[str, Any] = {"points": points, "distance": distance} | ({"behind": behind} if behind_m else {})
    file, camera = _deciding(campaign, experiment)
    if not everywhere:
        file, camera = experiment.file, _camera_in(experiment.file)
    if standing := next((key for key in SCALING[1:] if camera.get(key) is not None), None):
        raise InputError(f"{file}: camera.{standing} tells the scale already; to point at it, take that line out and look again")
    present = camera.get("scale")
    if isinstance(present, dict) and "places" not in present:  # what stands beside, and its comments, stay
        set_keys(file, {("camera", "scale", key): item for key, item in told.items()})
        if "behind" in present and not behind_m:
            take_out(file, ("camera", "scale", "behind"))
    else:
        set_keys(file, {("camera", "scale"): told})
    return file


def take_scale(campaign: Campaign, experiment: ExperimentSpec) -> Path:
    """Take out the scale that a run goes by: one in campaign.yaml for all films; without its own one a film goes by that.

    Raises
    ------
    InputError
        If there is none, or the file's form does not allow the change.
    """
    file, camera = _deciding(campaign, experiment)
    if camera.get("scale") is None:
        raise InputError(f"{file}: camera.scale: is not there, and cannot be taken away")
    take_out(file, ("camera", "scale"))
    return file


def _deciding(campaign: Campaign, experiment: ExperimentSpec) -> tuple[Path, dict[str, Any]]:
    """The file that says how long a pixel of a run is, or in which that would be said, and its `camera`."""
    shared, own = campaign.root / "campaign.yaml", _camera_in(experiment.file)
    if not shared.is_file() or any(key in own for key in SCALING):
        return experiment.file, own
    return shared, _camera_in(shared)


def _camera_in(file: Path) -> dict[str, Any]:
    try:
        camera = read_yaml(file).content.get("camera")
    except InputError:  # is said where the campaign is read
        return {}
    return camera if isinstance(camera, dict) else {}
