"""Recipes: stages with their options, one after the other, in a YAML file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic.dataclasses import dataclass

from rfea_vision.artefacts import Ladder
from rfea_vision.campaign.problems import unknown_key, validation_problems
from rfea_vision.campaign.yaml_file import read_yaml
from rfea_vision.data import list_recipes
from rfea_vision.errors import InputError
from rfea_vision.options import CritiqueOptions, FitOptions
from rfea_vision.options.asking import CLOSED, Asked, asked_by, explain, json_schema, read, written
from rfea_vision.stages.publishing import asked_of_ladder
from rfea_vision.stages.workspace import Workspace


@dataclass(frozen=True, kw_only=True, config=CLOSED)
class Subjects:
    """What a step works on, where it is not everything."""

    names: Annotated[tuple[str, ...], Asked(("track", "sync"))] = Field(
        default=(), description="These experiments alone."
    )
    models: Annotated[tuple[str, ...], Asked(("compare",))] = Field(
        default=(), description="These models; default all there are."
    )
    model: Annotated[str | None, Asked(("diagnose",))] = Field(
        default=None, description="The model; default the one fitted last."
    )


#: What each step may be told.
STEPS: dict[str, tuple[type, ...]] = {
    "calibrate": (),
    "track": (Subjects,),
    "sync": (Subjects,),
    "fit": (FitOptions,),
    "compare": (Subjects,),
    "diagnose": (Subjects, CritiqueOptions),
    "improve": (FitOptions, CritiqueOptions),
    "report": (),
}


class Recipe(BaseModel):
    """A recipe: each step is the name of a stage, alone or with a mapping of its options."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    format: Literal["rfea-recipe/1"] = "rfea-recipe/1"
    title: str = ""
    steps: tuple[str | dict[str, dict[str, Any] | None], ...]

    @model_validator(mode="after")
    def _steps_are_known(self) -> Recipe:
        if not self.steps:
            raise ValueError("steps is empty; name at least one stage, for example '- improve'")
        for number, step in enumerate(self.steps, 1):
            names = [step] if isinstance(step, str) else list(step)
            for name in names:
                if name not in STEPS:
                    raise ValueError(unknown_key(name, STEPS).replace("key", "step"))
            if len(names) != 1:
                raise ValueError(f"step {number} names {' and '.join(names) or 'no stage'}; give each stage a '-' of its own")
        return self

    def calls(self) -> list[tuple[str, tuple[object, ...]]]:
        """Return each step's stage, and what it is told: one object of each of its classes in `STEPS`.

        Raises
        ------
        InputError
            If an option is unknown or of the wrong kind.
        """
        pairs = [(step, {}) if isinstance(step, str) else next(iter(step.items())) for step in self.steps]
        return [(name, _told(name, options or {})) for name, options in pairs]

    @classmethod
    def __get_pydantic_json_schema__(cls, core: Any, handler: Any) -> dict[str, Any]:
        schema = handler.resolve_ref_schema(handler(core))
        options = {name: json_schema(name, *kinds) for name, kinds in STEPS.items()}
        one = {"type": "object", "properties": options, "additionalProperties": False, "minProperties": 1, "maxProperties": 1}
        schema["properties"]["steps"]["items"] = {"anyOf": [{"enum": list(STEPS)}, one]}
        return schema


def _told(name: str, options: Mapping[str, object]) -> tuple[object, ...]:
    known = {option.key for option in asked_by(name, *STEPS[name])}
    for key in options:
        if key not in known:
            raise InputError(unknown_key(key, known) if known else f"unknown key '{key}'; {name} has no options")
    try:
        return tuple(read(kind, options, name) for kind in STEPS[name])
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise InputError(f"{first['loc'][0]}: {explain(first, *STEPS[name])}") from error


def recipe_file(name_or_path: str) -> Path | None:
    """Return the whole path of a recipe of one's own; None for the name of one of pipelines/."""
    path = Path(name_or_path).expanduser()
    return path.resolve() if path.suffix in (".yaml", ".yml") else None


def load_recipe(name_or_path: str) -> Recipe:
    """Return a recipe of pipelines/ by name, or one's own by path.

    Raises
    ------
    InputError
        If there is no such recipe, or something in it is wrong.
    """
    path = recipe_file(name_or_path)
    if path is None:
        recipes = list_recipes()
        if name_or_path not in recipes:
            raise InputError(
                f"recipe '{name_or_path}': is unknown; there are {', '.join(recipes)}, or give a .yaml file"
            )
        path = recipes[name_or_path]
    file = read_yaml(path)
    _look_beside(path.parent.resolve(), file.content.get("steps"))
    try:
        recipe = Recipe.model_validate(file.content)
    except ValidationError as error:
        raise InputError(str(validation_problems(error, Recipe, (file,))[0])) from error
    for index, step in enumerate(recipe.steps):
        try:
            Recipe(steps=(step,)).calls()
        except InputError as error:
            name = step if isinstance(step, str) else next(iter(step))
            raise InputError(f"{path}:{file.line_of(('steps', index))}: {name}: {error}") from error
    return recipe


def _look_beside(folder: Path, steps: object) -> None:
    """Resolve the effect files of steps against the recipe's own `folder`: the recipe may run elsewhere."""
    for step in steps if isinstance(steps, list) else ():
        for options in step.values() if isinstance(step, dict) else ():
            if isinstance(options, dict) and isinstance(options.get("effect_files"), list):
                files = [folder / Path(str(item)).expanduser() for item in options["effect_files"]]
                options["effect_files"] = [str(file) for file in files]


def run_recipe(work: Workspace, recipe: Recipe) -> dict[str, Any]:
    """Run the steps in order and return what the last of each kind gave."""
    return {name: _RUN[name](work, *told) for name, told in recipe.calls()}


def _improve(work: Workspace, fit: FitOptions, critique: CritiqueOptions) -> Ladder:
    """Climb as a recipe says; where it says nothing, as the ladder that is there was climbed: somebody has chosen that."""
    kept = None if "improve" in work.force or (fit, critique) != (FitOptions(), CritiqueOptions()) else asked_of_ladder(work)
    if kept is not None and (given := written("improve", *kept)):
        work.tell(f"improve: the ladder that is there was climbed with {given}, and so it stays; --force climbs it as the recipe says")
    return work.improve(*(kept or (fit, critique)))


_RUN: dict[str, Callable[..., object]] = {
    "calibrate": Workspace.calibrate,
    "track": lambda work, which: work.track(which.names),
    "sync": lambda work, which: work.sync(which.names),
    "fit": Workspace.fit,
    "compare": lambda work, which: work.compare(*which.models),
    "diagnose": lambda work, which, options: work.diagnose(which.model, options),
    "improve": _improve,
    "report": Workspace.report,
}
