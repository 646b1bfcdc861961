"""The kinds of files there are, and which of them a file is. A new one is a file in `kinds/` and a line here."""

from __future__ import annotations

from pathlib import Path

from rfea_vision.errors import InputError
from rfea_vision.readers.apart import ask, isolated, serving
from rfea_vision.readers.kinds import capture, columns, labview, matlab, own, poses, ros, text
from rfea_vision.readers.kinds.base import Kind, Points, Table

KINDS: tuple[Kind, ...] = (
    *own.KINDS,
    *poses.KINDS,
    *capture.KINDS,
    *text.KINDS,
    *columns.KINDS,
    *matlab.KINDS,
    *labview.KINDS,
    *ros.KINDS,
)
"""Of kinds that share an ending, the first that recognises the file's content reads it."""


def endings() -> tuple[str, ...]:
    """Return the endings of all kinds, each once."""
    return tuple(dict.fromkeys(ending for kind in KINDS for ending in kind.endings))


def kind_of(path: Path) -> Kind:
    """Return the kind of a file by the ending of its name and, where kinds share one, by its content.

    Raises
    ------
    InputError
        If the file is missing, empty or of an unknown kind.
    """
    fitting = [kind for kind in KINDS if path.suffix.lower() in kind.endings]
    if not fitting:
        raise InputError(f"{path}: unknown kind of table '{path.suffix}'; save it as CSV, or as one of {', '.join(endings())}")
    if not path.is_file():
        raise InputError(f"{path}: not found; correct the name or put the file there")
    if path.stat().st_size == 0:
        raise InputError(f"{path}: is empty; record or export it again")
    found = next((kind for kind in fitting if kind.is_mine(path)), None)
    if found is None:
        titles = ", ".join(kind.title for kind in fitting)
        raise InputError(f"{path}: cannot be read as {path.suffix} (it is none of {titles}); export it again")
    return found


def _apart(path: Path) -> bool:
    """Whether a process of its own reads the file: even to tell kinds apart may need the parser that is not trusted."""
    return any(kind.apart for kind in KINDS if path.suffix.lower() in kind.endings)


def read_table(path: Path) -> Table:
    """Read a table, or poses.

    Raises
    ------
    InputError
        If the file is missing, empty, of an unknown kind or cannot be read, or an extra is needed.
    """
    if isolated() or (_apart(path) and not serving()):
        found = ask("table", path)
        points = {name: Points(**{**item, "names": tuple(item["names"])}) for name, item in found.pop("points").items()}
        return Table(**found, points=points)
    kind = kind_of(path)
    try:
        table = kind.read(path)
    except InputError:
        raise
    except ImportError as error:
        need = f"{kind.title} needs the Python module '{error.name}'"
        remedy = f"pip install 'rfea-vision[{kind.extra}]'" if kind.extra else f"pip install {error.name}"
        raise InputError(f"{path}: {need}; install it with: {remedy}") from error
    except Exception as error:
        # Each of the parsers has its own family of exceptions; all mean that the file is not what its name says.
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{path}: cannot be read as {path.suffix} ({reason[:200]}); export it again") from error
    if not table.columns:
        raise InputError(f"{path}: holds no columns; export it again with a header line")
    return table
