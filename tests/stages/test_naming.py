"""A model keeps its name: another fit of other options is told apart, or refused."""

import json
from dataclasses import replace
from types import SimpleNamespace

import pytest
from campaign.campaigns import write_campaign

from rfea_vision.artefacts import Ladder, Rung
from rfea_vision.campaign import load_campaign
from rfea_vision.campaign.specs import CameraSpec
from rfea_vision.errors import DataError, InputError
from rfea_vision.options import CritiqueOptions, FitOptions
from rfea_vision.options.asking import as_record
from rfea_vision.progress import Listener
from rfea_vision.stages import Workspace, cameras, mechanics
from rfea_vision.stages.naming import climb_apart, fit_apart
from rfea_vision.stages.recipes import Recipe, run_recipe


class Heard(Listener):
    """Keeps what was said."""

    def __init__(self):
        self.said = []

    def note(self, sentence):
        self.said.append(sentence)


@pytest.fixture
def work(tmp_path):
    return Workspace(load_campaign(write_campaign(tmp_path / "c")), listener=Heard())


def store(work, options):
    file = work.out / "models" / options.name / "model.json"
    file.parent.mkdir(parents=True)
    file.write_text(json.dumps({"segments": options.segments}))
    work.cache.store(work.cache.finished(f"fit/{options.name}", "digest", [file], options={"fit": as_record(options)}))


def ladder(work, *models):
    keys = ("train_tip_rmse_mm", "validate_tip_rmse_mm", "delta_bic")
    rungs = [Rung(model=model, added=None, verdict="missing", **dict.fromkeys(keys)) for model in models]
    Ladder(rungs=rungs).save(work.out / Ladder.FILE)


def test_a_fit_of_other_options_takes_a_name_of_its_own(work):
    store(work, FitOptions())
    assert fit_apart(work, FitOptions()).name == "base"
    assert fit_apart(work, FitOptions(segments=8)).name == "base-2"
    assert "segments 16" in work.listener.said[-1] and "base-2" in work.listener.said[-1]
    store(work, FitOptions(segments=8, name="base-2"))
    assert fit_apart(work, FitOptions(segments=8)).name == "base-2"
    assert fit_apart(work, FitOptions(segments=4)).name == "base-3"


def test_a_name_that_was_asked_for_is_not_taken_from_another_model(work):
    store(work, FitOptions(name="mine"))
    with pytest.raises(InputError, match=r"--name mine: .* \(segments 16\)"):
        fit_apart(work, FitOptions(name="mine", segments=8))
    store(work, FitOptions())
    with pytest.raises(InputError, match=r"--name base: .* \(segments 16\)"):
        fit_apart(work, FitOptions(name="base", segments=8))
    assert fit_apart(work, FitOptions(name="base")).name == "base"
    work.force = {"fit"}
    assert fit_apart(work, FitOptions(name="mine", segments=8)).name == "mine"


def test_a_climb_leaves_the_fits_beside_it_alone(work):
    store(work, FitOptions(effects=("maxwell",), segments=8))
    assert climb_apart(work, FitOptions()).name == "base-2"
    assert "(segments 8 in base+maxwell); this one is base-2" in work.listener.said[-1]
    assert climb_apart(work, FitOptions(segments=8)).name == "base"


def test_a_fit_that_was_set_apart_from_a_rung_sends_no_climb_elsewhere(work):
    """After fit(segments=8, add="maxwell") beside a ladder, `improve` climbed all of it once more, as base-3."""
    store(work, FitOptions())
    store(work, FitOptions(effects=("maxwell",)))
    ladder(work, "base", "base+maxwell")
    beside = fit_apart(work, FitOptions(effects=("maxwell",), segments=8))
    assert beside.name == "base+maxwell-2"
    store(work, beside)
    assert climb_apart(work, FitOptions()).name == "base"


def test_a_file_of_effects_that_a_model_has_none_of_is_no_other_option(work, tmp_path):
    """After `improve`, `improve --effect-file my_effect.py` called all its models base-2, base-2+my_effect."""
    file, other = tmp_path / "my_effect.py", tmp_path / "other.py"
    file.touch(), other.touch()
    store(work, FitOptions())
    store(work, FitOptions(effects=("maxwell", "coulomb@2", "pressure_lag@right")))
    ladder(work, "base", "base+maxwell,coulomb@2,pressure_lag@right")
    assert climb_apart(work, FitOptions(effect_files=(file,))).name == "base" and not work.listener.said
    assert fit_apart(work, FitOptions(effect_files=(file,))).name == "base"
    own = FitOptions(effects=("mine",), effect_files=(file,))
    store(work, own)
    assert fit_apart(work, own).name == "base+mine"
    assert fit_apart(work, replace(own, effect_files=(other,))).name == "base+mine-2"


def test_a_model_that_is_only_brought_up_to_date_is_not_the_one_fitted_last(work, monkeypatch):
    """After a change of the data a report fitted all models again, and `rfea export` took along whichever it did last."""
    store(work, FitOptions())
    store(work, FitOptions(effects=("maxwell",)))
    assert mechanics.last_model(work) == "base+maxwell"
    again = lambda runner, options: runner.cache.store(replace(runner.cache.record(f"fit/{options.name}"), digest="new"))  # noqa: E731
    monkeypatch.setattr(mechanics, "fit", again)
    mechanics.fitted(work, "base")
    assert work.cache.record("fit/base").digest == "new" and mechanics.last_model(work) == "base+maxwell"
    again(work, FitOptions())  # as `rfea fit` asks for it
    assert mechanics.last_model(work) == "base"


def test_a_climb_goes_on_though_a_rung_took_more_segments(work):
    store(work, FitOptions())
    store(work, FitOptions(effects=("maxwell",), segments=32))
    ladder(work, "base", "base+maxwell")
    assert climb_apart(work, FitOptions()).name == "base"
    assert climb_apart(work, FitOptions(segments=8, loss="linear")).name == "base-2"
    assert work.listener.said[-1].count("loss ") == 1 and "base+maxwell" not in work.listener.said[-1]


def test_a_finer_rung_of_an_earlier_ladder_is_no_other_option(work):
    """Of base, which has 8 segments, it was said that it had 16."""
    store(work, FitOptions(segments=8))
    store(work, FitOptions(name="base+segments", segments=16))
    ladder(work, "base-2")
    assert climb_apart(work, FitOptions(segments=8)).name == "base" and not work.listener.said


def test_a_climb_takes_no_rung_of_a_ladder_that_begins_with_another_model(work, monkeypatch):
    """The climb was said to be of base-2, 16 segments, and ended as that of base, 4 segments, which stood there before."""
    store(work, FitOptions(segments=4))
    ladder(work, "base")
    monkeypatch.setattr(work, "has", lambda stage: True)
    read = {"load": lambda path: SimpleNamespace(name=path.parent.name, segments=4, effects=[])}
    monkeypatch.setattr(mechanics, "ModelFit", SimpleNamespace(**read))
    monkeypatch.setattr(mechanics, "Diagnosis", SimpleNamespace(**read))
    asked = (FitOptions(segments=4), FitOptions(name="base-2"))
    assert [len(mechanics._Climb(work, one, CritiqueOptions(), {}, None).finished()) for one in asked] == [1, 0]


def test_a_run_that_is_called_as_its_campaign_has_a_calibration_of_its_own(tmp_path, monkeypatch):
    campaign = write_campaign(tmp_path / "c", {"tube-A": "train"})
    work = Workspace(load_campaign(campaign))
    monkeypatch.setattr(cameras, "calibrate", lambda work, camera, path, subject, **_: subject)
    run = replace(work.campaign.experiments[0], name=work.campaign.name)
    own, shared = (replace(run, camera=CameraSpec(vertical=vertical)) for vertical in ("rest", "board"))
    work.campaign = replace(work.campaign, camera=shared.camera)
    assert cameras.calibration_of(work, shared) == work.campaign.name != cameras.calibration_of(work, own)


def test_why_each_of_several_experiments_failed_is_said(work):
    """Of all but the first only the names were."""

    def fails(experiment):
        raise DataError(f"{experiment.name} is broken")

    with pytest.raises(DataError, match=r"^sine is broken; also failed: steps"):
        work.each([], fails, "tracked")
    assert "steps: steps is broken" in work.listener.said


def test_why_a_run_failed_has_its_name_once(work):
    def fails(experiment):
        raise DataError(f"{experiment.name}: sync: broken")

    with pytest.raises(DataError, match=r"^sine: sync: broken; also failed: steps"):
        work.each([], fails, "tracked")
    assert "steps: sync: broken" in work.listener.said


def test_a_recipe_that_says_nothing_keeps_the_ladder_as_it_was_climbed(work, monkeypatch):
    """After `improve --segments 8 --joints start` a batch climbed by the defaults, and its ladder replaced that one."""
    own = FitOptions(segments=8, joints="start")
    ladder(work, "base")
    record = {"fit": as_record(own), "critique": as_record(CritiqueOptions())}
    work.cache.store(work.cache.finished("improve/ladder", "digest", [work.out / Ladder.FILE], options=record))
    climbed = []
    monkeypatch.setattr(mechanics, "improve", lambda _, *asked: climbed.append(asked) or SimpleNamespace(value=None))
    run_recipe(work, Recipe(steps=("improve",)))
    assert climbed == [(own, CritiqueOptions())]
    assert "with --segments 8 --joints start, and so it stays; --force" in work.listener.said[-1]
    run_recipe(work, Recipe(steps=({"improve": {"segments": 4}},)))
    work.force = {"improve"}
    run_recipe(work, Recipe(steps=("improve",)))
    assert climbed[1:] == [(FitOptions(segments=4), CritiqueOptions()), (FitOptions(), CritiqueOptions())]
