"""What a model is asked for. Kept apart from the fit's own options, so that an unchanged fit needs none of its libraries."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rfea_vision.errors import InputError
from rfea_vision.stages.cache import StageRecord, plain

if TYPE_CHECKING:
    from rfea_vision.artefacts import ModelFit
    from rfea_vision.fitting import FitOptions


AUTO = "auto"


@dataclass(frozen=True)
class ModelChoices:
    """The choices of a fit, as the command line, a recipe or a record of an earlier fit gives them.

    Attributes
    ----------
    name : folder of the model
    effects : ids of the effects beside the base model
    observe : what of the recordings is fitted; None takes the richest that all of them offer
    more : further options of the fit by name; ``fix``, ``prior`` and ``bound`` as people write them, see `given`
    """

    name: str = "base"
    segments: int = 16
    joints: str = "middle"
    effects: tuple[str, ...] = ()
    observe: str | None = None
    effect_files: tuple[Path, ...] = ()
    seed: int = 0
    more: Mapping[str, Any] = field(default_factory=dict)

    def for_rung(self, model: ModelFit) -> ModelChoices:
        """Return the same choices for another rung: its effects, and its segments where it has more."""
        return replace(self, name=model.name, effects=tuple(model.effects), segments=model.segments)

    def fit_options(self) -> FitOptions:
        """Return the options that the fit takes.

        Raises
        ------
        InputError
            If one of `more` is no option of the fit.
        """
        from rfea_vision.fitting import FitOptions
        from rfea_vision.stages.given import read_bounds, read_fixed, read_priors, units_of

        own: dict[str, Any] = {key: value for key, value in vars(self).items() if key != "more"}
        more: dict[str, Any] = dict(self.more)
        readers = {"fix": ("fixed", read_fixed), "prior": ("priors", read_priors), "bound": ("bounds", read_bounds)}
        if any(more.get(key) for key in readers):
            units = units_of(self.effect_files)
            more |= {name: read(more[key], units) for key, (name, read) in readers.items() if more.get(key)}
        own |= {key: tuple(value) if isinstance(value, list) else value for key, value in more.items()}
        try:
            return FitOptions(**{key: value for key, value in own.items() if key not in readers})
        except TypeError as error:
            raise InputError(f"fit: {error}; known are {', '.join(FitOptions.__dataclass_fields__)}") from error

    def as_record(self) -> dict[str, Any]:
        """Return plain values; paths in full, so that the fit can be done again."""
        return {**plain(self), "effect_files": [str(path) for path in self.effect_files]}


def choose(
    name: str | None = None, *, add: Sequence[str] = (), effect_files: Sequence[Path | str] = (), **choices: Any
) -> ModelChoices:
    """Return the choices of a model; without a name it is called after its effects.

    Raises
    ------
    InputError
        If an effect file is not there, or the name cannot name a folder.
    """
    effects = tuple(dict.fromkeys(add))
    files = tuple(Path(file).expanduser().resolve() for file in effect_files)
    for file in files:
        if not file.is_file():
            raise InputError(f"--effect-file {file}: not found; 'rfea effects new {file.name}' writes a template")
    name = name or "+".join(["base", *effects])
    if "/" in name or "\\" in name or name.startswith("."):
        raise InputError(f"--name {name}: cannot name a folder; use letters, digits and dashes")
    known = {key: choices.pop(key) for key in ("segments", "joints", "observe", "seed") if key in choices}
    if known.get("segments") == AUTO:
        known.pop("segments")
        choices["auto_segments"] = True
    # what is not asked for leaves no trace in the record, so that a fit stays fresh when an option is added to the tool
    choices = {key: value for key, value in choices.items() if value not in (None, False, (), [], 0.0, "auto")}
    return ModelChoices(name=name, effects=effects, effect_files=files, more=choices, **known)


def choices_of(record: StageRecord) -> ModelChoices | None:
    """Return the choices with which a model was fitted; None if the record does not say."""
    kept = record.options.get("fit")
    if not isinstance(kept, dict) or not set(kept) <= set(ModelChoices.__dataclass_fields__):
        return None
    files = tuple(Path(path) for path in kept.get("effect_files", ()))
    return ModelChoices(**{**kept, "effects": tuple(kept.get("effects", ())), "effect_files": files})
