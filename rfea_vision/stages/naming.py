"""What a fit is called: a model is never overwritten by one with other options under its name."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import fields, replace
from itertools import count

from rfea_vision.artefacts import Ladder
from rfea_vision.errors import InputError
from rfea_vision.options import FitOptions
from rfea_vision.options.asking import as_record, from_record
from rfea_vision.stages.cache import StageRecord, as_json
from rfea_vision.stages.runner import Runner

#: What may differ between the rungs of one ladder: what they are called, what they add, and what is studied beside them.
_OF_A_RUNG = ("name", "effects", "study_segments", "profile", "leave_one_out")


def fitted_with(record: StageRecord | None) -> FitOptions | None:
    """Return the options with which a model was fitted, or a ladder climbed; None if no record says."""
    return from_record(FitOptions, record.options.get("fit")) if record is not None else None


def fit_apart(work: Runner, options: FitOptions) -> FitOptions:
    """Return `options` under a name that no other model has: base, base-2, ...

    Raises
    ------
    InputError
        If a name was asked for that belongs to a model fitted with other options, and nothing says to replace it.
    """
    other = _others(work, options.name, options)
    if "fit" in work.force or not other:
        return options
    if options.named:
        raise InputError(
            f"--name {options.name}: that model was fitted with other options ({', '.join(other)}); choose another name, or "
            "replace it with --force"
        )
    return _renamed(work, options, lambda name: _others(work, name, options))


def climb_apart(work: Runner, options: FitOptions) -> FitOptions:
    """Return `options` under a name with which no rung of the ladder takes the name of another fit."""

    def taken(name: str) -> list[str]:
        records = work.cache.records("fit")
        known = [record.key.partition("/")[2] for record in records]
        # base+maxwell-2 is what a fit beside base+maxwell was called: no rung takes such a name
        rest = [own for own in known if own.startswith(f"{name}+") and re.sub(r"-\d+$", "", own) not in {*known} - {own}]
        asked = replace(options, name=name)
        return _others(work, name, asked, _OF_A_RUNG, rungs) or [
            f"{key} in {own}" for own in rest for key in _others(work, own, asked, _OF_A_RUNG, rungs)
        ]

    path = work.out / Ladder.FILE
    rungs = [rung.model for rung in Ladder.load(path).rungs[1:]] if path.is_file() else []
    return options if "improve" in work.force or not taken(options.name) else _renamed(work, options, taken)


def _renamed(work: Runner, options: FitOptions, taken: Callable[[str], list[str]]) -> FitOptions:
    """Return the options under the first free name, and tell so."""
    other = taken(options.name)
    name = next(name for number in count(2) if not taken(name := f"{options.name}-{number}"))
    if not (work.out / "models" / name / "model.json").is_file():
        said = f"{options.name} stays as it is: it was fitted with other options ({', '.join(dict.fromkeys(other))})"
        work.tell(f"{said}; this one is {name}")
    return replace(options, name=name)


def _others(
    work: Runner, name: str, options: FitOptions, leave: tuple[str, ...] = ("name",), rungs: list[str] | None = None
) -> list[str]:
    """Options that differ from those of the model that was fitted under this name; empty where there is none."""
    before = fitted_with(work.cache.record(f"fit/{name}"))
    if before is None or not (work.out / "models" / name / "model.json").is_file():
        return []
    finer = name in (rungs or ()) or "segments" in name.split("+")  # also of an earlier ladder, whose chain was made finer
    left = {*leave, "segments", "auto_segments"} if finer else set(leave)
    if before.effect_files != options.effect_files and not _has_own_effects(before):
        left.add("effect_files")
    old, new = (as_json(as_record(one)) for one in (before, options))
    keys: list[str] = [field.name for field in fields(FitOptions) if field.name not in left]
    return [f"{key} {_shown(before, key)}" for key in keys if old.get(key) != new.get(key)]


def _has_own_effects(options: FitOptions) -> bool:
    """Whether an effect that was fitted comes from a file: to a model that has none, a file is no other option."""
    if not options.effects:
        return False
    from rfea_vision.effects.catalogue import catalogue, plain  # takes a second

    return any(plain(effect).partition("@")[0] not in catalogue() for effect in options.effects)


def _shown(options: FitOptions, key: str) -> object:
    value = getattr(options, key)
    return value.name if hasattr(value, "name") else "none" if value in (None, (), {}) else value
