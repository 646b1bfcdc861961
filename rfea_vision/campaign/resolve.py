"""From the keys of a file to specifications: combinations of keys are checked, paths are found (`finding`)."""

from __future__ import annotations

import re
from dataclasses import replace
from math import pi
from typing import Any

from rfea_vision.artefacts import Actuator, Correction, Hints
from rfea_vision.artefacts.measurement import TENDON_AREA
from rfea_vision.calibration.board import Board
from rfea_vision.campaign.finding import Files, Finder, Folders
from rfea_vision.campaign.problems import FileProblem
from rfea_vision.campaign.reach import Reach
from rfea_vision.campaign.schema import (
    ActuatorPart,
    CameraPart,
    ExperimentFile,
    PlumbPart,
    PressurePart,
    ScalePart,
    SectionPart,
    SyncPart,
)
from rfea_vision.campaign.specs import (
    CameraSpec,
    ExperimentSpec,
    PressureSpec,
    RigSpec,
    TrackSpec,
    VideoSpec,
    gravity_deg,
)
from rfea_vision.data import read_camera_profile
from rfea_vision.errors import InputError
from rfea_vision.files import is_file

#: Names of chambers stand after the @ of an effect, before the point of a parameter.
CHAMBER = r"[^\W\d_][^.@=,]*"
SCALE_EXAMPLE = "scale: {points: [[212, 80], [230, 640]], distance: 155 mm}"


def resolve_camera(
    part: CameraPart, reach: Reach, folders: Folders, files: Files, experiment: str | None = None
) -> tuple[CameraSpec | None, list[FileProblem]]:
    """Return the camera, or what is wrong with it; neither where nothing tells its scale: runs may share the rest of their cameras."""
    if part.board is part.photos is part.file is part.scale is None:
        return None, []
    finder = Finder(reach, folders, files, experiment)
    photographed = part.board is not None and part.photos is not None
    if part.file is None and part.scale is None and not photographed:
        lacking = "board" if part.board is None else "photos"
        remedy = "give board and photos, the file of an earlier calibration, or a scale"
        finder.complain(f"camera.{lacking}", f"is missing; {remedy} ({SCALE_EXAMPLE})")
        return None, finder.problems
    if part.scale is not None and (part.file is not None or photographed):
        finder.complain("camera.scale", "stands beside a calibration, which knows the scale; keep one of the two")
    if part.file is not None and part.photos is not None:
        finder.complain(
            "camera.file", "stands beside camera.photos; keep the earlier calibration or the photos, not both"
        )
    if part.file is not None and part.plane is not None and part.board is None:
        finder.complain("camera.board", "is missing; the plane photo cannot be read without it")
    board = None
    if part.board is not None:
        if part.board.kind == "charuco" and (part.board.marker is None or part.board.dictionary is None):
            lacking = "marker" if part.board.marker is None else "dictionary"
            example = "marker: 15 mm" if lacking == "marker" else "dictionary: DICT_5X5_100"
            finder.complain(f"camera.board.{lacking}", f"is missing; a charuco board needs it, for example '{example}'")
        else:
            keys = part.board
            try:
                board = Board(keys.kind, keys.inner_corners, keys.square, keys.marker, keys.dictionary)
            except InputError as error:  # "camera.board.marker: what is wrong with it"
                key, _, message = str(error).partition(": ")
                finder.complain(key, message)
    _check_scale(part, finder)
    profile = {} if part.profile is None else read_camera_profile(part.profile)
    vertical = part.vertical.model_dump() if isinstance(part.vertical, PlumbPart) else part.vertical
    camera = CameraSpec(
        board=board,
        photos=finder.photos("camera.photos", part.photos),
        plane=finder.file("camera.plane", part.plane),
        file=finder.file("camera.file", part.file),
        vertical=vertical,
        scale=part.scale,
        hints=_hints(part, finder),
        board_offset_mm=part.board_offset * 1000.0,
        lens=part.lens or str(profile.get("lens", "auto")),
        line_delay_s=part.line_delay,
    )
    return (None if finder.problems else camera), finder.problems


def _check_scale(part: CameraPart, finder: Finder) -> None:
    scale = part.scale
    if scale == "tube" and (part.clamp is None or part.tip is None) and finder.experiment is not None:
        lacking = "clamp" if part.clamp is None else "tip"
        finder.complain(f"camera.{lacking}", "is missing; 'scale: tube' measures from camera.clamp to camera.tip")
    if not isinstance(scale, ScalePart):
        return
    if part.board_offset:
        finder.complain("camera.board_offset", "is that of a board; of a scale write 'behind', below it")
    count = len(scale.points)
    if (scale.distance is None) == (scale.places is None):
        finder.complain("camera.scale", f"needs either distance or places; for example '{SCALE_EXAMPLE}'")
    elif scale.distance is not None and (count != 2 or scale.points[0] == scale.points[1]):
        finder.complain("camera.scale.points", f"a distance lies between two different points, found {count}; give two")
    elif scale.places is not None and len(scale.places) != count:
        finder.complain("camera.scale.places", f"has {len(scale.places)} places for {count} points; give one for each")


def _hints(part: CameraPart, finder: Finder) -> Hints:
    if part.clamp is not None and part.clamp[0] == part.clamp[1]:
        finder.complain("camera.clamp", "its two points are one; give the two edges of the first visible cross-section")
    frames = [again.frame for again in part.corrections or ()]
    if twice := next((frame for frame in frames if frames.count(frame) > 1), None):
        finder.complain("camera.corrections", f"frame {twice} is there twice; give all points of a frame at once")
    masks, keypoints = finder.file("camera.masks", part.masks, folder=True), finder.file("camera.keypoints", part.keypoints)
    return replace(hints_of(part), masks=masks, keypoints=keypoints)


def hints_of(part: CameraPart) -> Hints:
    """What a person says of the first frame."""
    return Hints(
        clamp=part.clamp,
        tip=part.tip,
        centre_line=tuple(part.centre_line or ()),
        corrections=tuple(Correction(again.frame, tuple(again.points)) for again in part.corrections or ()),
        region=part.region,
        exclude=tuple(part.exclude or ()),
        colour=part.colour,
        marks=part.marks,
    )


def resolve_experiment(
    parsed: ExperimentFile, name: str, actuator: Actuator, reach: Reach, folders: Folders, files: Files
) -> tuple[ExperimentSpec, list[FileProblem]]:
    """Return the experiment as far as it can be resolved, and what is wrong with it."""
    role = parsed.role or "train"
    finder = Finder(reach, folders, files, name)
    video, track = _source(parsed, finder)
    camera, problems = None, []
    if parsed.camera is not None:
        camera, problems = resolve_camera(parsed.camera, reach, folders, files, name)
    if camera is None and not problems and video is not None:
        lacks = "is missing" if parsed.camera is None else f"does not tell how long a pixel of '{name}' is"
        finder.complain("camera", f"{lacks}; pictures need it: board and photos, an earlier calibration, or {SCALE_EXAMPLE}")
    section = (None if parsed.actuator is None else parsed.actuator.section) or SectionPart()
    pressure = _pressures(parsed.pressure, finder, tendon=section.tendon is not None)
    if section.kind != "tube" and section.chamber_area is None and section.tendon is None and pressure.acts:
        finder.complain(
            "actuator.section.chamber_area",
            "is missing; a pressure acts on it, for example 'chamber_area: 60 mm^2'. Where a tendon pulls and its tension is logged, "
            "write its distance from the middle, 'tendon: 8 mm'",
        )
    rig = _rig(parsed, actuator, finder)
    experiment = ExperimentSpec(
        rig=rig,
        name=name,
        folder=folders[0],
        role=role,
        actuator=actuator,
        camera=camera,
        video=video,
        track=track,
        pressure=pressure,
        sync=_sync(parsed.sync or SyncPart(), finder),
        repeat_of=parsed.repeat_of,
        recorded_at=parsed.recorded_at,
        memory=parsed.memory or "fresh",
        note=parsed.note or "",
    )
    return experiment, problems + finder.problems


def _source(parsed: ExperimentFile, finder: Finder) -> tuple[VideoSpec | None, TrackSpec | None]:
    """Return the one source of the track; an experiment's own source wins over one that the campaign shares."""
    given = {
        "video": parsed.video is not None and parsed.video.file is not None,
        "frames": parsed.frames is not None and parsed.frames.folder is not None,
        "track": parsed.track is not None and parsed.track.file is not None,
    }
    names = [key for key, there in given.items() if there]
    own = [key for key in names if (key,) in finder.files[0].lines]
    names = own if len(own) == 1 else names
    if len(names) != 1:
        found = f"found {' and '.join(names)}" if names else "found none"
        finder.complain(
            names[1] if names else "video",
            f"exactly one of video, frames and track with its file is needed, {found}; keep one",
        )
        return None, None
    if names == ["track"]:
        assert parsed.track is not None
        file = finder.file("track.file", parsed.track.file)
        return None, None if file is None else TrackSpec(file, parsed.track)
    if names == ["frames"]:
        assert parsed.frames is not None
        folder = finder.file("frames.folder", parsed.frames.folder, folder=True)
        table, rate = parsed.frames.times or "frames.csv", parsed.frames.rate
        needed = parsed.frames.times is not None or rate is None or any(is_file(at / table) for at in finder.folders)
        times = finder.file("frames.times", table) if needed else None
        within = finder.reach.within
        return VideoSpec(None, folder, times, rate, within), None
    assert parsed.video is not None
    return VideoSpec(finder.file("video.file", parsed.video.file), rate_Hz=parsed.video.rate), None


#: What has no meaning for a body of this kind.
_UNUSED = {
    "tube": {"section.chamber_area", "section.keeps", "section.tendon", "section.thickness", "section.width"},
    "rod": {"inner_radius", "section.thickness", "section.width"},
    "rectangle": {"inner_radius", "outer_radius"},
    "custom": {"inner_radius", "section.thickness", "section.width"},
}


def resolve_actuator(part: ActuatorPart) -> Actuator:
    """Return what is bent.

    Raises
    ------
    InputError
        If its dimensions do not make a section, or some are not of its kind.
    """
    section = part.section or SectionPart()
    given = part.model_fields_set | {f"section.{key}" for key, value in section if value is not None}
    for key in sorted(given & _UNUSED[section.kind]):
        raise InputError(f"actuator.{key} has no meaning in a section of the kind '{section.kind}'; leave it out")
    values = part.model_dump(exclude={"mass", "section", "material"})
    if section.kind == "tube" and "inner_radius" not in given and part.inner_radius >= part.outer_radius > 0:
        raise InputError(
            f"actuator.inner_radius is missing: that of the paper's tube, {1e3 * part.inner_radius:g} mm, is no smaller than "
            f"actuator.outer_radius, {1e3 * part.outer_radius:g} mm; give it, or 'section: {{kind: rod}}' for a body without a bore"
        )
    if part.mass is not None and part.mass_per_length is not None:
        raise InputError("actuator.mass stands beside actuator.mass_per_length; keep one of the two")
    if part.mass is not None:
        values["mass_per_length"] = part.mass / part.length
    if section.tendon is not None and section.keeps == "side":
        raise InputError("actuator.section.keeps stands beside section.tendon, whose lever counts from the middle; leave it out")
    if section.tendon is not None and section.chamber_area is not None:
        raise InputError("actuator.section.tendon stands beside actuator.section.chamber_area; keep that of what acts")
    if section.kind == "rectangle":
        if section.thickness is None:
            raise InputError("actuator.section.thickness is missing; that in the plane of motion, for example '30 mm'")
        values["outer_radius"] = section.thickness / 2
    if section.kind != "tube":
        area = section.chamber_area or (0.0 if section.tendon is None else TENDON_AREA)
        values["inner_radius"] = (area / pi) ** 0.5 or values["outer_radius"] / 2
    more: dict[str, Any] = section.model_dump(include={"kind", "width", "area", "second_moment", "tendon"})
    return Actuator(**values, **more, keeps=section.keeps or "middle", material=part.material or "")


def _rig(parsed: ExperimentFile, actuator: Actuator, finder: Finder) -> RigSpec:
    """Return how the run was set up."""
    gravity, plumb = 0.0, None
    given = "down" if parsed.rig is None else parsed.rig.gravity
    camera = parsed.camera
    if isinstance(given, PlumbPart):
        plumb = given.plumb
        if plumb[0] == plumb[1]:
            finder.complain(
                "rig.gravity.plumb", "its two points are one; give two far apart on the line, upper one first"
            )
        if camera is None or isinstance(camera.vertical, PlumbPart):
            finder.complain(
                "rig.gravity.plumb", "needs pictures, and in camera.vertical the axis of the rig: board, rest or image"
            )
    else:
        gravity = gravity_deg(given if isinstance(given, str) else given.angle, actuator.bends)
        if camera is not None and camera.vertical == "rest" and gravity is not None and gravity % 180 != 0:
            finder.complain(
                "camera.vertical", "a tube across gravity does not rest straight; use board, image or {plumb: ...}"
            )
    known: dict[str, float] = {}
    if parsed.conditions:
        from rfea_vision.options.given import read_conditions  # brings the effects with it

        try:
            known = read_conditions(parsed.conditions)
        except InputError as error:
            finder.complain("conditions", str(error))
    start = parsed.start
    until = None if start is None or start.held_until == "auto" else float(start.held_until)
    pulled = None if start is None or start.force is None else (start.force, start.direction)
    return RigSpec(gravity, plumb, start is not None, until, pulled, known)


def _pressures(given: PressurePart | list[PressurePart] | None, finder: Finder, *, tendon: bool) -> PressureSpec:
    """Return the one pressure, or those of all chambers; of tendons their tensions."""
    if given is None:
        return PressureSpec(folder=finder.folders[0])
    if isinstance(given, PressurePart):
        return replace(_pressure(given, finder), tendon=tendon)
    names = [part.chamber for part in given]
    if None in names or len(set(names)) < len(names):
        finder.complain("pressure", "each of several needs the name of its chamber, such as 'chamber: left'")
    odd = next((name for name in names if name is not None and not re.fullmatch(CHAMBER, name)), None)
    if odd is not None:
        finder.complain(
            "pressure.chamber", f"'{odd}' must begin with a letter and have no . @ or = in it, such as 'left'"
        )
    first, *further = (replace(_pressure(part, finder), tendon=tendon) for part in given)
    return replace(first, further=tuple(further))


def _pressure(part: PressurePart, finder: Finder) -> PressureSpec:
    if part.value is not None:
        if part.file is not None or part.url is not None:
            finder.complain("pressure.value", "stands beside a log; keep the log, or the constant value")
        return PressureSpec(keys=part.model_copy(update={"url": None}), folder=finder.folders[0])
    if (part.file is None) == (part.url is None):
        finder.complain(
            "pressure", "exactly one of 'file' and 'url' is needed; for example 'pressure: {file: pressure.csv}'"
        )
    if part.url is not None and part.query is None:
        finder.complain(
            "pressure.query", "is missing; a database needs a query such as 'SELECT t, p FROM log WHERE run = 7'"
        )
    file = finder.file("pressure.file", part.file)
    return PressureSpec(file, part.model_copy(update={"url": finder.database(part.url)}), finder.folders[0])


def _sync(part: SyncPart, finder: Finder) -> SyncPart:
    if part.method == "offset" and part.value is None:
        finder.complain(
            "sync.value",
            "is missing; the method 'offset' needs it, for example 'value: 12 ms' (log clock minus camera clock)",
        )
    if part.method != "offset" and part.value is not None:
        finder.complain(
            "sync.value", f"has no meaning with the method '{part.method}'; drop it or write 'method: offset'"
        )
    return part
