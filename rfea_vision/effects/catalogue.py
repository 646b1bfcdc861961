"""Where effects are found: the files of this package, entry points of others, and a user's own file."""

from __future__ import annotations

import difflib
import importlib
import importlib.util
import pkgutil
import re
from collections.abc import Iterable, Sequence
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path

from rfea_vision.effects.base import HOOKS, LINE_HOOKS, Effect, EffectParameter
from rfea_vision.effects.permission import refuse_unnamed
from rfea_vision.effects.validation import validate
from rfea_vision.errors import InputError

_NOT_EFFECTS = {"base", "catalogue", "hooks", "permission", "typeset", "validation"}


def _effects_in(module: object) -> list[type[Effect]]:
    """Effects that stand in a module, and what has no id of its own, for effects to inherit from."""
    kinds = [item for item in vars(module).values() if isinstance(item, type)]
    return [kind for kind in kinds if issubclass(kind, Effect) and kind is not Effect]


@cache
def catalogue() -> dict[str, type[Effect]]:
    """Every effect on offer by id, those of this package first; other forms of an effect as ``id:form``, see `forms_of`."""
    return {name: effect for name, effect in _known().items() if not effect.form}


def forms_of(effect_id: str) -> tuple[str, ...]:
    """Names by which the other forms of an effect are asked for: ``mullins:linear``."""
    return tuple(name for name, effect in _known().items() if effect.form and effect.id == effect_id)


def look_alikes(effects: Sequence[Effect], name: str) -> list[str]:
    """Ids of those of some effects that are said to be mistaken for one, or the other way round."""
    said = {effect.id: set(re.findall(r"\w+", effect.mistaken_for)) for effect in effects}
    return [one for one in said if one != name and (one in said.get(name, ()) or name in said[one])]


@cache
def _known() -> dict[str, type[Effect]]:
    package = importlib.import_module("rfea_vision.effects")
    found: dict[str, type[Effect]] = {}
    for info in sorted(pkgutil.iter_modules(package.__path__), key=lambda item: item.name):
        if info.name not in _NOT_EFFECTS:
            for effect in _effects_in(importlib.import_module(f"rfea_vision.effects.{info.name}")):
                found[_called(effect)] = effect
    for point in entry_points(group="rfea.effects"):
        effect = point.load()
        found.setdefault(_called(effect), effect)
    return found


def _called(effect: type[Effect]) -> str:
    return f"{effect.id}:{effect.form}" if effect.form else effect.id


def load_effect_file(path: Path) -> list[type[Effect]]:
    """Effects that a user's file declares.

    Raises
    ------
    InputError
        The file is missing, was named by nobody, does not run, or declares no effect.
    """
    if not path.is_file():
        raise InputError(f"{path}: effect file not found; make one with `rfea effects new {path.name}`")
    refuse_unnamed(path)
    spec = importlib.util.spec_from_file_location(f"rfea_user_effect_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise InputError(f"{path}: not a Python file; make one with `rfea effects new my_effect.py`")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise InputError(f"{path}: {type(error).__name__}: {error}; mend the file") from error
    own = [kind for kind in _effects_in(module) if kind.__module__ == module.__name__]  # not what it imports
    for kind in own:
        kind.source_text = path.read_text(encoding="utf-8")
    effects = [kind for kind in own if hasattr(kind, "id")]
    if not effects:
        raise InputError(f"{path}: declares no effect; subclass rfea_vision.effects.base.Effect and give it an `id`")
    for effect in effects:
        try:
            validate(effect())
        except InputError as error:
            raise InputError(f"{path}: {error}") from error
        except Exception as error:
            raise InputError(f"{path}: effect {effect.id}: {type(error).__name__}: {error}; mend the law") from error
    return effects


def meant(name: str, known: Iterable[str]) -> str:
    """What to say after an id that nobody declares."""
    close = difflib.get_close_matches(name.lower(), list(known), n=1)
    return f"did you mean '{close[0]}'?" if close else "'rfea effects' lists the catalogue"


def parameters_of(effects: Iterable[Effect | type[Effect]]) -> dict[str, EffectParameter]:
    """Declared parameters of some effects by their full names, such as ``maxwell.k``."""
    return {f"{effect.id}.{name}": spec for effect in effects for name, spec in effect.parameters.items()}


def split_joint(text: str) -> tuple[str, str]:
    """Split ``coulomb@2`` into the effect and its joint; that of ``pressure_lag@right`` stays, with its chamber, the whole name."""
    name, _, place = text.partition("@")
    return (name, place) if place.isdigit() else (text, "")


def plain(effect: str) -> str:
    """The id of an effect without form and joint: ``coulomb`` of ``coulomb@2``; a chamber is part of the id."""
    name, at, chamber = split_joint(effect)[0].partition("@")
    return name.partition(":")[0] + at + chamber


def line_effects() -> tuple[str, ...]:
    """Ids of the effects that may act on one of several chambers."""
    return tuple(name for name, effect in catalogue().items() if _of_the_line(effect))


def _of_the_line(effect: type[Effect]) -> bool:
    return not effect.states and {name for name in HOOKS if effect.overrides(name)} <= set(LINE_HOOKS)


def _placed(effect: type[Effect], chamber: str) -> type[Effect]:
    """The effect of the line for one chamber alone."""
    if not chamber or not _of_the_line(effect):
        wanted = "the name of a chamber, or the number of a joint" if _of_the_line(effect) else "the number of a joint"
        raise InputError(f"effect '{effect.id}@{chamber}': what stands after @ must be {wanted}")
    own = {
        "__module__": effect.__module__,
        "__qualname__": effect.__qualname__,
        "id": f"{effect.id}@{chamber}",
        "chamber": chamber,
        "title": f"{effect.title}, chamber {chamber}",
        "exactly_tied_to": (),
        "parameters": {**effect.parameters, **effect.of_chamber},
    }
    return type(effect.__name__, (effect,), own)


def find_effects(ids: Sequence[str], effect_files: Sequence[Path] = ()) -> tuple[Effect, ...]:
    """Instances of the effects named, user files included; ``pressure_lag@right`` is that of one chamber.

    Raises
    ------
    InputError
        An id that nobody declares, or a chamber after an effect that is not one of the line.
    """
    known = dict(_known())
    for path in effect_files:
        for effect in load_effect_file(Path(path)):
            if effect.id in catalogue():
                raise InputError(
                    f"{path}: effect {effect.id}: the catalogue has one of this id; give yours another, as in 'my_{effect.id}'"
                )
            known[_called(effect)] = effect
    if "segments" in ids and "segments" not in known:
        raise InputError("effect 'segments' is no law but a finer chain; use --segments with a larger number")
    asked = [name.partition("@") for name in ids]
    missing = [name for name, _, _ in asked if name not in known]
    if missing:
        declared = ", ".join(name for name in known if name not in _known())
        where = f" ({' and '.join(map(str, effect_files))} declares: {declared})" if declared else ""
        raise InputError(f"effect '{missing[0]}' is unknown{where}; {meant(missing[0], known)}")
    return tuple((_placed(known[name], chamber) if at else known[name])() for name, at, chamber in asked)
