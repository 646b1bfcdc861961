"""Which effects are looked for at all, by the body, its chambers and whether a pressure moves it; which get a second glance."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from rfea_vision.artefacts import Actuator
from rfea_vision.critique.screening import offered
from rfea_vision.critique.trials import FAINT, GLANCES, Trial, Trials


def _fitted(**ended_inside: bool) -> SimpleNamespace:
    """A fit without effects, by the names of what it turned, and whether that ended off its bounds."""
    inside = np.array(list(ended_inside.values()), dtype=bool)
    return SimpleNamespace(
        model=SimpleNamespace(effects=()),
        coordinates=SimpleNamespace(names=tuple(ended_inside), inside=lambda y: inside),
        solution=SimpleNamespace(y=np.zeros(inside.size)),
    )


@pytest.mark.parametrize(
    ("kind", "moving", "looked_for"), [("tube", True, False), ("rod", True, True), ("rod", False, False)]
)
def test_a_stretch_is_looked_for_where_a_body_can_and_a_pressure_moves_it(kind, moving, looked_for, monkeypatch):
    monkeypatch.setattr("rfea_vision.critique.screening.pushed", lambda items: moving)
    run = SimpleNamespace(clock_sigma=0.0, excitation=SimpleNamespace(chambers={}))
    problem = SimpleNamespace(actuator=Actuator(kind=kind), train=[run])
    fitted = _fitted()
    found = {effect.id for effect in offered(problem, fitted, None, ())}
    assert ("stretch" in found) == looked_for and "payload" in found
    assert "tendon_friction" not in found
    bore = {"variable_mass", "virtual_work", "compressibility", "radial_expansion"}
    assert bore & found == (bore if kind == "tube" else set())
    assert ("pressure_lag" in found) == moving
    # without a push there is no log whose clock could differ
    assert bool({"time_offset", "clock_drift"} & found) == moving


@pytest.mark.parametrize(("chambers", "placed"), [(["one"], set()), (["one", "two"], {"one", "two"})])
def test_the_line_of_an_only_chamber_is_offered_once(chambers, placed, monkeypatch):
    monkeypatch.setattr("rfea_vision.critique.screening.pushed", lambda items: True)
    run = SimpleNamespace(
        clock_sigma=0.0, excitation=SimpleNamespace(chambers=dict.fromkeys(chambers, (1.0, np.zeros(2))))
    )
    problem = SimpleNamespace(actuator=Actuator(), train=[run])
    fitted = _fitted()
    found = [effect.id for effect in offered(problem, fitted, None, ())]
    assert {one.split("@")[1] for one in found if one.startswith("pressure_lag@")} == placed and "pressure_lag" in found


@pytest.mark.parametrize(
    ("fitted", "looked_for"), [(_fitted(), True), (_fitted(r_hyd=True), False), (_fitted(r_hyd=False), True)]
)
def test_a_gain_is_looked_for_where_the_lever_cannot_make_up_for_it(fitted, looked_for, monkeypatch):
    """A lever that is held, or that ended at its bound, cannot."""
    monkeypatch.setattr("rfea_vision.critique.screening.pushed", lambda items: True)
    run = SimpleNamespace(clock_sigma=0.0, excitation=SimpleNamespace(chambers={}))
    problem = SimpleNamespace(actuator=Actuator(), train=[run])
    assert ("pressure_gain" in [effect.id for effect in offered(problem, fitted, None, ())]) == looked_for


def test_all_effects_get_a_glance_and_the_better_half_a_second_from_where_the_first_ended(monkeypatch):
    ends_at = {"drag": 4.0, "payload": 2.0, "maxwell": 1.0, "coulomb": 3.0, "contact": None}
    asked = []

    def near(self, options, values, like, most):
        name = next(iter(options.effects))
        asked.append((name, most, values["start"]))
        if ends_at[name] is None:  # it cannot be simulated
            return None
        left = ends_at[name] / most
        return SimpleNamespace(solution=SimpleNamespace(mean_square=left), values={"start": left})

    monkeypatch.setattr(Trials, "_near", near)
    monkeypatch.setattr(Trials, "_derive_law", lambda self, options: None)
    monkeypatch.setattr(Trials, "_options", lambda self, base, key: SimpleNamespace(effects=key))
    base = SimpleNamespace(effects=frozenset(), fitted=SimpleNamespace(values={}))
    starts = {name: {"start": 0.0} for name in ends_at}
    looks = Trials(SimpleNamespace()).glances(base, starts, 1)
    first, second = GLANCES
    assert list(looks) == ["maxwell", "payload", "coulomb", "drag"]  # the best first, by their last glance
    # side by side, so in any order
    assert sorted(asked[:5]) == sorted((name, first, 0.0) for name in ends_at)
    assert sorted(asked[5:]) == [("maxwell", second, 1.0 / first), ("payload", second, 2.0 / first)]
    assert len(Trials(SimpleNamespace()).glances(base, starts, 3)) == 4
    assert {name for name, most, _ in asked[12:] if most == second} == {"maxwell", "payload", "coulomb"}


def test_from_a_bent_model_a_refit_begins_at_the_best_fit_and_again_where_that_has_come_nearer(monkeypatch):
    def trial(cost, *effects, **values):
        solution = SimpleNamespace(cost=cost)
        return SimpleNamespace(
            effects=frozenset(effects), cost=cost, fitted=SimpleNamespace(values=values, solution=solution)
        )

    base = trial(1e6, k_ref=0.1)
    began, begins = [], []

    def from_(self, options, starts, like):
        began.append((like, starts[-1]))
        begins.append(starts)
        return SimpleNamespace(solution=SimpleNamespace(cost=1e5 / len(began)))

    monkeypatch.setattr(Trials, "_from", from_)
    monkeypatch.setattr(Trials, "_options", lambda self, own, key: None)
    monkeypatch.setattr(Trials, "_amplitudes", lambda self, options: {"drag.c": (0.0, 1.0)})
    monkeypatch.setattr("rfea_vision.critique.trials.errors_of", lambda problem, fitted: None)
    monkeypatch.setattr("rfea_vision.critique.trials._at_bound", lambda fitted: False)
    trials = Trials(SimpleNamespace(), done={base.effects: base}, bent=True)
    first = trials.refit(base, ("drag",), {"drag.c": 900.0})
    assert began == [(base.fitted, {"drag.c": 900.0, "k_ref": 0.1})] and first.cost == 1e5
    assert trials.refit(base, ("drag",), {}) is first and len(began) == 1  # nothing has come nearer
    better = trials.done[frozenset({"payload"})] = trial(100.0, "payload", **{"k_ref": 0.2, "payload.m": 0.01})
    again = trials.refit(base, ("drag",), {"drag.c": 900.0})
    assert began[1] == (better.fitted, {"k_ref": 0.2}) and again.cost == 5e4  # what it shares, and no more
    assert trials.refit(base, ("drag",), {}) is again and len(began) == 2
    # elsewhere at the model as it stands, and one effect also where nothing has been absorbed
    trials.bent, trials.stiff = False, {"k_ref": 9.0}
    trials.refit(base, ("maxwell",), {"drag.c": 900.0})
    trials.refit(base, ("maxwell", "coulomb"), {"drag.c": 900.0})
    assert began[2][0] is base.fitted
    assert begins[2] == [{"drag.c": 900.0, "k_ref": 0.1}, {"drag.c": 900.0, "k_ref": 9.0}]
    assert begins[3] == [{"drag.c": 900.0, "k_ref": 0.1}]


def test_what_contains_a_set_that_came_out_better_is_fitted_again_from_there(monkeypatch):
    """A nested model is never worse: also where the smaller one was fitted last."""

    def trial(cost, *effects, **values):
        solution = SimpleNamespace(cost=cost)
        return Trial(frozenset(effects), SimpleNamespace(values=values, solution=solution), None)

    began = []

    def from_(self, options, starts, like):
        began.append((like, starts))
        return trial([40.0, 30.0, 50.0][len(began) - 1], **starts[-1]).fitted

    def amplitudes(self, options):
        return {f"{name}.c": (0.0, 1.0) for name in sorted(options.effects)}

    monkeypatch.setattr(Trials, "_from", from_)
    monkeypatch.setattr(Trials, "_options", lambda self, own, key: SimpleNamespace(effects=key))
    monkeypatch.setattr(Trials, "_amplitudes", amplitudes)
    monkeypatch.setattr("rfea_vision.critique.trials.errors_of", lambda problem, fitted: None)
    monkeypatch.setattr("rfea_vision.critique.trials._at_bound", lambda fitted: False)
    base = trial(100.0)
    done = [
        base,
        trial(80.0, "drag", "payload", **{"drag.c": 5.0, "payload.c": 7.0}),
        trial(40.001, "coulomb", "drag"),
        trial(20.0, "drag", "maxwell"),
        trial(90.0, "payload"),
    ]
    trials = Trials(SimpleNamespace(), done={one.effects: one for one in done})
    smaller = trials.refit(base, ("drag",), {"drag.c": 3.0})
    # what stood far above it: again from its optimum, what is new faint; what stands above by less than fits converge to: as it is
    assert began[1:] == [(smaller.fitted, [{"drag.c": 3.0, "payload.c": pytest.approx(FAINT * 7.0)}])]
    costs = {one.effects: trials.done[one.effects].cost for one in done}
    assert list(costs.values()) == [100.0, 30.0, 40.0, 20.0, 90.0] and smaller.cost == 40.0
