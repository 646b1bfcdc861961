"""Recipes: stages with their options, one after the other, in a YAML file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, ValidationError, model_validator

from rfea_vision.campaign.problems import unknown_key, validation_problems
from rfea_vision.campaign.yaml_file import read_yaml
from rfea_vision.data import list_recipes
from rfea_vision.errors import InputError
from rfea_vision.stages.workspace import Workspace
from rfea_vision.units import parse_quantity


class _Step(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class MeasureStep(_Step):
    """Options of track and sync."""

    names: tuple[str, ...] = ()


class EmptyStep(_Step):
    """Options of a step that has none."""


def _items(value: object) -> object:
    """Take ``{r_hyd: 3.6 mm}`` for what the command line writes as ``r_hyd=3.6 mm``."""
    return tuple(f"{name}={text}" for name, text in value.items()) if isinstance(value, dict) else value


Items = Annotated[tuple[str, ...], BeforeValidator(_items)]


class ModelStep(_Step):
    """What fit and improve have in common."""

    segments: int | Literal["auto"] = 16
    joints: Literal["middle", "start"] = "middle"
    observe: Literal["tip_y", "tip", "midline", "angle"] | None = None
    effect_files: tuple[str, ...] = ()
    seed: int = 0
    fix: Items = ()
    prior: Items = ()
    bound: Items = ()
    loss: Literal["auto", "linear", "huber"] = "auto"
    pressure_zero: Annotated[
        float | None, BeforeValidator(lambda value: parse_quantity(value, "Pa", example="1 kPa"))
    ] = None


class FitStep(ModelStep):
    """Options of fit."""

    name: str | None = None
    add: tuple[str, ...] = ()
    study_segments: bool = False
    profile: tuple[str, ...] = ()
    leave_one_out: bool = False


class CompareStep(_Step):
    """Options of compare; no models means all there are."""

    models: tuple[str, ...] = ()


class DiagnoseStep(_Step):
    """Options of diagnose; no model means the one fitted last."""

    model: str | None = None
    effect_files: tuple[str, ...] = ()
    seed: int = 0


class ImproveStep(ModelStep):
    """Options of improve."""

    budget: Annotated[float, BeforeValidator(lambda value: parse_quantity(value, "s", example="5 min"))] = 300.0


_STEPS: dict[str, type[_Step]] = {
    "calibrate": EmptyStep,
    "track": MeasureStep,
    "sync": MeasureStep,
    "fit": FitStep,
    "compare": CompareStep,
    "diagnose": DiagnoseStep,
    "improve": ImproveStep,
    "report": EmptyStep,
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
        for step in self.steps:
            for name in [step] if isinstance(step, str) else step:
                if name not in _STEPS:
                    raise ValueError(unknown_key(name, _STEPS).replace("key", "step"))
        return self

    def calls(self) -> list[tuple[str, _Step]]:
        """Return each step's stage and options.

        Raises
        ------
        ValidationError
            If an option is unknown or of the wrong kind.
        """
        pairs = [(step, {}) if isinstance(step, str) else next(iter(step.items())) for step in self.steps]
        return [(name, _STEPS[name].model_validate(options or {})) for name, options in pairs]


def load_recipe(name_or_path: str) -> Recipe:
    """Return a recipe of pipelines/ by name, or one's own by path.

    Raises
    ------
    InputError
        If there is no such recipe, or something in it is wrong.
    """
    path = Path(name_or_path).expanduser()
    if path.suffix not in (".yaml", ".yml"):
        recipes = list_recipes()
        if name_or_path not in recipes:
            raise InputError(
                f"recipe '{name_or_path}': is unknown; there are {', '.join(recipes)}, or give a .yaml file"
            )
        path = recipes[name_or_path]
    file = read_yaml(path)
    try:
        recipe = Recipe.model_validate(file.content)
    except ValidationError as error:
        raise InputError(str(validation_problems(error, Recipe, (file,))[0])) from error
    for index, step in enumerate(recipe.steps):
        try:
            Recipe(steps=(step,)).calls()
        except ValidationError as error:
            name = step if isinstance(step, str) else next(iter(step))
            problem = validation_problems(error, _STEPS[name], (file,))[0]
            line = file.line_of(("steps", index))
            raise InputError(f"{path}:{line}: {name}: {problem.key}: {problem.message}") from error
    return recipe


def run_recipe(work: Workspace, recipe: Recipe) -> dict[str, Any]:
    """Run the steps in order and return what the last of each kind gave."""
    results: dict[str, Any] = {}
    for name, options in recipe.calls():
        arguments = options.model_dump()
        if isinstance(options, ModelStep):
            arguments["pressure_zero_sd"] = arguments.pop("pressure_zero")
        if isinstance(options, CompareStep):
            results[name] = work.compare(*options.models)
        elif isinstance(options, ImproveStep):
            results[name] = work.improve(budget_s=arguments.pop("budget"), **arguments)
        else:
            results[name] = getattr(work, name)(**arguments)
    return results
