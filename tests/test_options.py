"""An option is declared once: what the command line, a recipe and a record make of it is the same object."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from pydantic import ValidationError

from rfea_vision.errors import InputError
from rfea_vision.options import CritiqueOptions, FitOptions
from rfea_vision.options.asking import as_record, from_record, options_of, read, read_flags, written
from rfea_vision.options.given import read_conditions, read_values
from rfea_vision.stages.recipes import Recipe, load_recipe

RECIPE: dict[str, Any] = {
    "add": ["maxwell", "coulomb"],
    "segments": "auto",
    "fix": {"r_hyd": "3.6 mm"},
    "prior": {"modulus": "2 MPa ± 0.3 MPa"},
    "bound": {"maxwell.k1": "1% .. 3%"},
    "pressure_zero": "1 kPa",
    "leave_one_out": True,
}


def test_flags_recipe_and_record_say_the_same():
    asked = read(FitOptions, RECIPE, "fit")
    flags = {
        **RECIPE,
        "add": ("maxwell,coulomb",),
        "fix": ("r_hyd=3.6mm",),
        "prior": ("modulus=2MPa+-0.3MPa",),
        "bound": ("maxwell.k1=1%..3%",),
    }
    assert read_flags(FitOptions, flags, "fit") == asked
    assert asked.effects == ("maxwell", "coulomb") and asked.auto_segments and asked.name == "base+maxwell+coulomb"
    assert asked.fixed == {"r_hyd": pytest.approx(3.6e-3)} and asked.pressure_zero_sd == 1e3
    assert from_record(FitOptions, as_record(asked)) == asked
    assert as_record(FitOptions()) == {"name": "base"}, "what is not asked for leaves no trace"


def test_pure_numbers_need_no_unit_and_are_finite():
    assert read_conditions({"pressure_gain": 0.98}) == {"pressure_gain.g": 0.98}
    assert read_conditions({"pressure_gain": "98 %"}) == {"pressure_gain.g": pytest.approx(0.98)}
    for text in ("nan", "inf", "1e999"):
        with pytest.raises(InputError, match=f"'{text}' is no finite number"):
            read_values("--fix", [f"pressure_gain.g={text}"], {"pressure_gain.g": "1"})


def test_what_was_asked_for_is_written_as_it_is_read():
    asked = replace(read(FitOptions, RECIPE, "fit"), auto_segments=False, segments=8)
    words = written("fit", asked)
    assert "--segments 8" in words and "--add maxwell --add coulomb" in words and "--leave-one-out" in words
    assert "--fix r_hyd=0.0036m" in words and "--pressure-zero 1000Pa" in words
    assert (
        written("improve", FitOptions(), CritiqueOptions(budget_s=300, stand_ins=True)) == "--stand-ins --budget 300s"
    )
    assert written("fit", FitOptions(segments="auto")) == "--segments auto"  # type: ignore[arg-type]


def test_options_are_closed():
    with pytest.raises(ValidationError):
        FitOptions(segmets=4)  # type: ignore[call-arg]
    with pytest.raises(InputError, match=r"--pressure-zero 5: 5 has no unit; write for example '5kPa'"):
        read_flags(FitOptions, {"pressure_zero": 5}, "fit")
    assert from_record(FitOptions, {"name": "base", "more": {}}) is None


@pytest.mark.parametrize("kind", [FitOptions, CritiqueOptions])
def test_every_option_is_described(kind):
    assert [option.name for option in options_of(kind) if not option.info.description] == []


def test_the_schema_of_a_recipe_knows_the_options_of_its_steps():
    steps = Recipe.model_json_schema()["properties"]["steps"]["items"]["anyOf"][1]["properties"]
    assert set(RECIPE) <= set(steps["fit"]["properties"]) and steps["fit"]["additionalProperties"] is False
    assert "budget" not in steps["fit"]["properties"] and "name" not in steps["improve"]["properties"]
    assert steps["improve"]["properties"]["budget"]["type"] == "string", "quantities are written with their unit"
    assert all(option["description"] for step in steps.values() for option in step["properties"].values())


@pytest.mark.parametrize(("step", "says"), [("{compare: , report: }", "names compare and report"), ("{}", "no stage")])
def test_a_step_of_a_recipe_is_one_stage(tmp_path, step, says):
    file = tmp_path / "mine.yaml"
    file.write_text(f"steps:\n  - sync\n  - {step}\n")
    with pytest.raises(InputError, match=rf"mine\.yaml.*step 2 .*{says}"):
        load_recipe(str(file))
