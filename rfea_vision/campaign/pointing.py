"""What a person points at in a film, beside what is known of the rig: told before a frame is followed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rfea_vision.artefacts.measurement import Actuator, Calibration, Hints
from rfea_vision.campaign.scaling import calibrated_by_scale, pointed_line
from rfea_vision.campaign.schema import ScalePart
from rfea_vision.campaign.specs import CameraSpec
from rfea_vision.errors import InputError
from rfea_vision.lines import along

#: Of the way from clamp to tip, by which the tip lies above where gravity points down: a tube that hangs and bends by 90 deg has none.
_UPWARDS = 0.5
#: Cosine of the angle between a clamp's two points and the way on from it, 10 degrees: the end of a bow of 160 degrees lies so.
_ALONG = 0.985
#: Times as wide as the tube is, or as long, by the scale, and as narrow: chosen, a diameter given as a radius is twice as wide, and a
#: tube that bends is shorter from clamp to tip.
_OTHER_SIZE = 1.5
#: From clamp to tip, in lengths of the tube, where it bends by 217 deg: shorter, and not drawn in between, it is another length.
_CURLED = 0.5
#: Of a film's frames: chosen, key points that are doubted in some frames are left out there.
ENOUGH = 0.5
#: Of a mask: the tube is less of the picture than what is around it.
MOST = 0.5
#: Widths of the clamp, chosen: so near to it the first of the key points is.
NEAR = 3.0


class Film(NamedTuple):
    """The size of a film's pictures in px, and how many there are."""

    size: tuple[int, int]
    frames: int


def of_camera(
    camera: CameraSpec, film: Film, tube: Actuator | None, gravity_deg: float | None
) -> tuple[list[tuple[str, str]], list[tuple[str, str]]]:
    """What is wrong, and what is odd, of what was pointed at in a film, or found there by another program: keys, and why.

    Of a tube that is not known no size is doubted.
    """
    wrong, odd = outside(camera, film), of_hints(camera.hints, gravity_deg)
    if camera.scale is not None and tube is not None and not wrong:
        try:
            odd += of_size(camera.hints, calibrated_by_scale(camera, film.size, 1e3 * tube.length), tube)
        except InputError as error:
            key, _, text = str(error).removeprefix("camera.").partition(": ")
            wrong.append((key, text))
    try:
        odd += of_guide(camera.hints, film)
    except InputError as error:
        wrong.append(("masks" if camera.hints.keypoints is None else "keypoints", str(error)))
    return [(f"camera.{key}", text) for key, text in wrong], [(f"camera.{key}", text) for key, text in odd]


def of_guide(hints: Hints, film: Film) -> list[tuple[str, str]]:
    """Doubt masks or key points that are not those of a film: the key under `camera`, and why.

    Raises
    ------
    InputError
        If they cannot be read.
    """
    from rfea_vision.readers.pictures import numbered_pictures, read_grey
    from rfea_vision.vision.body.guide import PICTURES, guide_of

    given = hints.masks if hints.keypoints is None else hints.keypoints
    if given is None:
        return []
    key = "masks" if hints.keypoints is None else "keypoints"
    if hints.clamp is None or hints.tip is None:
        return [(key, "acts where camera.clamp and camera.tip are given, too; give both, in pixels of the first frame")]
    clamp = np.array(hints.clamp, dtype=float)
    found = list[str]()
    if (guide := guide_of(hints, clamp)) is None:
        return []
    if key == "masks":
        files = numbered_pictures(given, PICTURES)
        count, picture = len(files), read_grey(files[0])
        if picture is not None and picture.shape[::-1] != film.size:
            sizes = f"{files[0].name} has {picture.shape[1]} x {picture.shape[0]} px, and the film {film.size[0]} x {film.size[1]}"
            found.append(f"{sizes}; write masks of the film's size")
        if picture is not None and np.mean(picture > picture.max() / 2) > MOST:
            found.append(f"most of {files[0].name} is light, and the tube is what is light in a mask; are they the other way round?")
    else:
        count = sum(guide(frame) is not None for frame in range(film.frames))
    if count != film.frames and (count < ENOUGH * film.frames or key == "masks"):
        remedy = "; they are taken in order, one for each frame, so write an empty one where there is none" if key == "masks" else ""
        found.append(f"{given.name} holds {count} of the film's {film.frames} frames{remedy}")
    line, wide = guide(0), float(along(clamp)[-1])
    off = np.inf if line is None else float(np.linalg.norm(line - clamp.mean(axis=0), axis=1).min())
    if not found and off > NEAR * wide:
        where = "says nothing of the first frame" if line is None else f"lies {off:.0f} px from camera.clamp in the first frame"
        found.append(f"{given.name} {where}; is it that of this film, in its pixels (x, y)?")
    return [(key, text) for text in found]


def of_hints(hints: Hints, gravity_deg: float | None) -> list[tuple[str, str]]:
    """Doubt hints that contradict one another, or the rig: the key under `camera`, and why."""
    return _forbidden(hints) + (_along(hints) or _upside_down(hints, gravity_deg))


def _forbidden(hints: Hints) -> list[tuple[str, str]]:
    """What was pointed at where `region` or `exclude` say that the tube never is."""
    boxes = [("exclude", box) for box in hints.exclude] + ([] if hints.region is None else [("region", hints.region)])
    ends = [("camera.clamp", point) for point in hints.clamp or ()] + ([] if hints.tip is None else [("camera.tip", hints.tip)])
    found = dict[str, str]()
    for key, (left, top, width, height) in boxes:
        for name, (x, y) in ends:
            within = left <= x <= left + width and top <= y <= top + height
            if within == (key == "exclude"):
                where = f"{'within' if within else 'outside'} the box {[left, top, width, height]}"
                found[key] = f"{name} lies {where}; it is x, y, width and height"
    return list(found.items())


def _along(hints: Hints) -> list[tuple[str, str]]:
    """A clamp whose two points lie one behind the other on the way to the tube, not across it."""
    if hints.clamp is None or hints.tip is None:
        return []
    edges = np.asarray(hints.clamp, dtype=float)
    ahead = np.asarray((*hints.centre_line, hints.tip)[0], dtype=float) - edges.mean(axis=0)
    across, wide = edges[1] - edges[0], float(np.linalg.norm(edges[1] - edges[0]))
    if not wide < np.linalg.norm(ahead) or abs(across @ ahead) < _ALONG * wide * np.linalg.norm(ahead):
        return []
    key = "camera.centre_line" if hints.centre_line else "camera.tip"
    return [
        (
            "clamp",
            f"its two points lie one behind the other as seen from {key}, and they are the two edges of one cross-section; point at "
            "these, or are x and y exchanged? x counts to the right, y down",
        )
    ]


def _upside_down(hints: Hints, gravity_deg: float | None) -> list[tuple[str, str]]:
    """Clamp and tip of a tube that hangs, of which the tip was pointed at above."""
    if hints.clamp is None or hints.tip is None or gravity_deg != 0.0:
        return []
    way = np.asarray(hints.tip, dtype=float) - np.mean(hints.clamp, axis=0)
    if -way[1] <= _UPWARDS * np.linalg.norm(way):
        return []
    return [
        (
            "clamp",
            f"lies {-way[1]:.0f} px below camera.tip in the picture, and the tube hangs; are the two swapped? If it stands, write rig: "
            "{gravity: up}; of a film upside down turn it and the photos of the board by half a turn",
        )
    ]


def outside(camera: CameraSpec, film: Film) -> list[tuple[str, str]]:
    """What was pointed at outside of a film's pictures, or after its last: the key under `camera`, and why."""
    hints, scale, size = camera.hints, camera.scale, film.size
    given = {"clamp": hints.clamp or (), "tip": () if hints.tip is None else (hints.tip,), "centre_line": hints.centre_line}
    given["scale.points"] = scale.points if isinstance(scale, ScalePart) else ()
    given["corrections"] = [point for later in hints.corrections for point in later.points]
    found = [
        ("corrections", f"frame {later.frame} is not in the film, whose last is {film.frames - 1}; the first is 0")
        for later in hints.corrections
        if later.frame >= film.frames
    ]
    for key, points in given.items():
        places = np.array(points, dtype=float).reshape(-1, 2)
        for x, y in places[np.any((places < -0.5) | (places > np.array(size) - 0.5), axis=1)][:1]:
            which = "that" if key == "corrections" else "the first"
            swapped = ", or are x and y exchanged? x counts to the right" if y < size[0] - 0.5 and x < size[1] - 0.5 else ""
            lies = f"{x:g}, {y:g} lies outside the picture of {size[0]} x {size[1]} px"
            found.append((key, f"{lies}; point at it in {which} frame{swapped}"))
    if hints.corrections and (hints.clamp is None or hints.tip is None):
        found.append(("corrections", "acts where camera.clamp and camera.tip are given, too; give both, in pixels of the first frame"))
    if hints.region is not None:
        x, y, width, height = hints.region
        if x >= size[0] or y >= size[1] or x + width <= 0.0 or y + height <= 0.0:
            of = f"the picture of {size[0]} x {size[1]} px"
            found.append(("region", f"{list(hints.region)} lies outside {of}; it is x, y, width and height"))
    return found


def of_size(hints: Hints, calibration: Calibration, tube: Actuator) -> list[tuple[str, str]]:
    """Doubt a clamp of another width than the tube has by the scale, and a line of another length: the key under `camera`, and why."""
    from rfea_vision.calibration.projection import pixels_to_plane_mm

    found: list[tuple[str, str]] = []
    if hints.clamp is not None:
        wide_mm, tube_mm = float(along(pixels_to_plane_mm(calibration, np.array(hints.clamp)))[-1]), 2e3 * tube.outer_radius
        if not 1.0 / _OTHER_SIZE < wide_mm / tube_mm < _OTHER_SIZE:
            text = f"its two points are {wide_mm:.3g} mm apart by camera.scale, and the tube {tube_mm:.3g} mm wide by {tube.width_key}"
            found.append(("clamp", f"{text}; are they the two edges of the tube, and is no diameter given as a radius?"))
    if hints.clamp is not None and hints.tip is not None:
        long_mm, tube_mm = float(along(pixels_to_plane_mm(calibration, pointed_line(hints)))[-1]), 1e3 * tube.length
        least = 1.0 / _OTHER_SIZE if len(hints.centre_line) > 1 else _CURLED
        if not least < long_mm / tube_mm < _OTHER_SIZE:
            text = f"by it the way from camera.clamp to camera.tip is {long_mm:.3g} mm, and actuator.length {tube_mm:.3g} mm"
            curled = "" if len(hints.centre_line) > 1 else ", or point at camera.centre_line if the tube is curled up"
            found.append(("scale", f"{text}; correct the one that is wrong{curled if long_mm < tube_mm else ''}"))
    return found
