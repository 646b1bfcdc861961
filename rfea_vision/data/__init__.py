"""What people edit, boards, camera profiles and recipes, found alike in a checkout and in an installed wheel."""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import Any

import yaml

from rfea_vision.errors import InputError

_PACKAGE = Path(__file__).resolve().parent
_CHECKOUT = _PACKAGE.parent.parent


def data_folder(name: str) -> Path:
    """Return the folder `name` ("calib", "pipelines" or "examples").

    In a checkout it stands at the top; a wheel carries "calib" and "pipelines" inside the package.

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


def list_boards() -> tuple[str, ...]:
    """Return the names of the boards in calib/boards."""
    return tuple(sorted(path.stem for path in (data_folder("calib") / "boards").glob("*.yaml")))


def read_board(name: str) -> dict[str, Any]:
    """Return the keys of a board in calib/boards, as they would stand under ``camera.board``.

    Raises
    ------
    ValueError
        If there is no such board.
    """
    boards = list_boards()
    if name not in boards:
        close = difflib.get_close_matches(name, boards, n=1)
        hint = f"did you mean '{close[0]}'?" if close else f"there are {', '.join(boards)}"
        raise ValueError(f"no board '{name}' in calib/boards; {hint}")
    text = (data_folder("calib") / "boards" / f"{name}.yaml").read_text(encoding="utf-8")
    return {key: value for key, value in yaml.safe_load(text).items() if key != "title"}


def list_recipes() -> dict[str, Path]:
    """Return the recipes in pipelines/, by name."""
    return {path.stem: path for path in sorted(data_folder("pipelines").glob("*.yaml"))}


def board_titles() -> dict[str, str]:
    """Return what each board of calib/boards is, by name."""
    folder = data_folder("calib") / "boards"
    pages = {name: yaml.safe_load((folder / f"{name}.yaml").read_text(encoding="utf-8")) for name in list_boards()}
    return {name: str(page.get("title", "")) for name, page in pages.items()}
