"""The photos of the board from which a camera is calibrated, looked at before it is: whether they can be read, and are its own."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from rfea_vision.campaign.problems import FileProblem
from rfea_vision.campaign.specs import CameraSpec, Campaign, ExperimentSpec
from rfea_vision.campaign.tubes import of_square
from rfea_vision.errors import RfeaError
from rfea_vision.files import sha256_of

if TYPE_CHECKING:
    from rfea_vision.artefacts import Actuator
    from rfea_vision.calibration.board import Board

_UNREADABLE = "{} is not a readable picture; take it out or copy it again"


@dataclass
class Look:
    """A file of the campaign while what it names is looked at, for one run or for all, and what is wrong."""

    file: Path
    name: str | None
    problems: list[FileProblem] = field(default_factory=list, kw_only=True)

    def warn(self, key: str, *texts: str) -> None:
        """Note warnings."""
        self.problems += [FileProblem(self.file, text, key, severity="warning", experiment=self.name) for text in texts]

    def refuse(self, key: str, text: str) -> None:
        """Note an error."""
        self.problems.append(FileProblem(self.file, text, key, experiment=self.name))


def camera_problems(
    camera: CameraSpec, campaign: Campaign, experiment: ExperimentSpec | None, *, tube_known: bool = True
) -> list[FileProblem]:
    """Read an earlier calibration, and look for the board in every photo: the campaign's, or that of an `experiment` with its own."""
    from rfea_vision.calibration.storage import load_calibration

    look = Look(campaign.root / "campaign.yaml", None) if experiment is None else Look(experiment.file, experiment.name)
    if camera.file is not None:
        try:
            load_calibration(camera.file)
        except RfeaError as error:
            look.refuse("camera.file", str(error))
    if camera.board is not None:
        if text := of_another_camera(camera):
            look.refuse("camera.plane", text)
        _look_at_photos(look, camera, camera.board)
        if camera.plane is not None:
            _look_at_plane(look, camera, camera.board, (experiment or campaign).actuator if tube_known else None)
    return look.problems


def _look_at_photos(look: Look, camera: CameraSpec, board: Board) -> None:
    """Look for the board in the photos of the lens: three with it are needed."""
    from rfea_vision.calibration.corners import Refused, find_corners
    from rfea_vision.readers.pictures import read_grey

    seen, refused = 0, dict[str, list[str]]()
    for photo in (item for item in camera.photos if item != camera.plane):
        grey = read_grey(photo)
        if grey is None:
            look.refuse("camera.photos", _UNREADABLE.format(photo))
        elif isinstance(found := find_corners(photo, grey, board), Refused):
            refused.setdefault(found.reason, []).append(photo.name)
        else:
            seen += 1
    for reason, (first, *more) in refused.items():  # what ails many photos alike is said once
        some = f"{1 + len(more)} photos ({first} to {more[-1]})" if more else first
        look.warn("camera.photos", f"{some}: {reason}")
    if camera.photos and seen < 3:
        text = f"{seen} of {len(camera.photos)} photos show the board, 3 are needed; check camera.board or take more"
        look.refuse("camera.photos", text)


def _look_at_plane(look: Look, camera: CameraSpec, board: Board, tube: Actuator | None) -> None:
    """Look for the board in the photo of the plane of motion, and how large the tube is beside it."""
    from rfea_vision.calibration.corners import Refused, find_corners
    from rfea_vision.readers.pictures import read_grey

    plane = camera.plane
    grey = None if plane is None else read_grey(plane)
    if plane is None or grey is None:
        look.refuse("camera.plane", _UNREADABLE.format(plane))
        return
    if twin := _same_picture(plane, camera.photos):
        text = f"{plane.name} is {twin} once more; photograph the board lying in the plane in which the tube moves"
        look.warn("camera.plane", text)
    found = find_corners(plane, grey, board)
    if isinstance(found, Refused):
        look.refuse("camera.plane", f"{plane.name}: {found.reason}")
    elif tube is not None and (text := of_square(found.board_mm, found.pixels, grey.shape, tube)):
        look.warn("camera.board.square", text)


def of_another_camera(camera: CameraSpec) -> str:
    """Why the photo of the plane is not by the camera, or in the mode, of the others; empty where it is, or cannot be read."""
    from rfea_vision.calibration.photos import read_photo, unlike_film

    plane = None if camera.plane is None else read_photo(camera.plane)
    first = None if plane is None or not camera.photos else read_photo(camera.photos[0])
    if plane is None or first is None:
        return ""
    own, other = plane.shown().shape[::-1], first.shown(plane).shape[::-1]
    if not unlike_film(own, other):
        return ""
    sizes = f"{plane.file.name} has {own[0]} x {own[1]} px, and {first.file.name} {other[0]} x {other[1]}"
    return f"{sizes}; photograph the board in the plane with the camera, and in the mode, that films"


def _same_picture(photo: Path, others: tuple[Path, ...]) -> str:
    """The name of another photo that is this one, byte by byte; empty where there is none."""
    size = photo.stat().st_size
    alike = (item for item in others if item != photo and item.stat().st_size == size)
    return next((item.name for item in alike if sha256_of(item) == sha256_of(photo)), "")


def unlike_camera(camera: CameraSpec | None, film_px: tuple[int, int]) -> str:
    """Why photos or an earlier calibration do not hold for a film of this size; empty where they do, or cannot be read."""
    from rfea_vision.calibration.photos import reference_photo, unlike_film
    from rfea_vision.calibration.storage import load_calibration

    if camera is not None and camera.file is not None:
        try:
            earlier = load_calibration(camera.file)
        except RfeaError:  # is said of the camera
            return ""
        return unlike_film((earlier.image_width, earlier.image_height), film_px)
    photo = None if camera is None else reference_photo(camera.photos, camera.plane)
    if camera is None or photo is None or of_another_camera(camera):  # the latter is said of the camera
        return ""
    height, width = photo.shown().shape
    return unlike_film((width, height), film_px, photos=True)
