"""What people edit, boards, camera profiles and recipes, found alike in a checkout and in an installed wheel."""

from __future__ import annotations

import difflib
from functools import cache
from pathlib import Path

import yaml

from rfea_vision.errors import InputError

_PACKAGE = Path(__file__).resolve().parent
_CHECKOUT = _PACKAGE.parent.parent


def data_folder(name: str) -> Path:
    """Return the folder `name` ("calib", "pipelines" or "examples").

    In a checkout it stands at the top; a wheel carries them inside the package, of the examples the one of 'rfea demo'.

    Raises
    ------
    InputError
        If this installation does not carry the folder.
    """
    in_checkout = (_CHECKOUT / "pyproject.toml").is_file() and (_CHECKOUT / name).is_dir()
    folder = _CHECKOUT / name if in_checkout else _PACKAGE / name
    if not folder.is_dir():
        raise InputError(f"'{name}' is not part of this installation of rfea-vision; use a checkout of its sources")
    return folder


def read_board(name: str) -> dict[str, object]:
    """Return the keys of a board in calib/boards, as they would stand under ``camera.board``.

    Raises
    ------
    ValueError
        If there is no such board.
    """
    return {key: value for key, value in _read_page("boards", name).items() if key != "title"}


def read_camera_profile(name: str) -> dict[str, object]:
    """Return a camera profile of calib/cameras: title, lens and notes.

    Raises
    ------
    ValueError
        If there is no such profile.
    """
    return _read_page("cameras", name)


def board_titles() -> dict[str, str]:
    """Return what each board of calib/boards is, by name."""
    return {name: str(_read_page("boards", name).get("title", "")) for name in _pages("boards")}


def _pages(kind: str) -> list[str]:
    return sorted(path.stem for path in (data_folder("calib") / kind).glob("*.yaml"))


def _read_page(kind: str, name: str) -> dict[str, object]:
    known = _pages(kind)
    if name not in known:
        close = difflib.get_close_matches(name, known, n=1)
        hint = f"did you mean '{close[0]}'?" if close else f"there are {', '.join(known)}"
        raise ValueError(f"no '{name}' in calib/{kind}; {hint}")
    return yaml.safe_load((data_folder("calib") / kind / f"{name}.yaml").read_text(encoding="utf-8"))


def list_recipes() -> dict[str, Path]:
    """Return the recipes in pipelines/, by name."""
    return {path.stem: path for path in sorted(data_folder("pipelines").glob("*.yaml"))}


def template(name: str) -> str:
    """Text of a file to be filled in: ``campaign.yaml``, ``experiment.yaml`` or ``effect.py.txt``."""
    return (_PACKAGE / "templates" / name).read_text(encoding="utf-8")


@cache
def column_words() -> dict[str, tuple[str, ...]]:
    """Words by which columns and files are told apart where nobody says what they are, by meaning."""
    text = (_PACKAGE / "column_words.yaml").read_text(encoding="utf-8")
    return {meaning: tuple(words) for meaning, words in yaml.safe_load(text).items()}
