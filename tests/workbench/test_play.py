"""A look says what the fit says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rfea_vision.artefacts import Actuator, ModelFit
from rfea_vision.artefacts.rows import UNUSED_BY_BEAMS
from rfea_vision.errors import InputError
from rfea_vision.fitting.observed import MM
from rfea_vision.fitting.residuals import predict_observed
from rfea_vision.report.collect import collect
from rfea_vision.workbench.play import LONGEST_STEP_S, TIP, Chosen, Player, quickened, start_vector
from rfea_vision.workbench.sliders import sliders_of


@pytest.fixture(scope="module")
def player(fitted):
    return Player({item.name: item for item in collect(fitted / "rfea").experiments})


@pytest.fixture(scope="module")
def base(fitted):
    return ModelFit.load(fitted / "rfea" / "models" / "base" / "model.json")


def test_a_look_at_fitted_values_has_the_errors_of_the_fit(player, base):
    chosen = Chosen(base, ())
    exact, _ = player.play(chosen, {}, "mixed-3", exact=True)
    quick, _ = player.play(chosen, {}, "mixed-3")
    assert exact["train"] == pytest.approx(base.metrics["train"].tip_rmse_mm, abs=1e-6)
    for name, score in base.experiments.items():
        assert exact["runs"][name] == pytest.approx(score.tip_rmse_mm, abs=1e-6)
        assert quick["runs"][name] == pytest.approx(score.tip_rmse_mm, abs=2e-3)


def test_a_log_with_noise_is_looked_at_in_longer_steps_that_the_noise_does_not_shake(player, base):
    """Every fourth sample has the whole of a log's noise: where a fit said 0.00645 mm a look said 0.00756."""
    item = player.runs["mixed-3"].item
    clean, model = item.excitation, Chosen(base, ()).model()
    noise = np.random.default_rng(1).normal(0, 300, clean.pressure.size)  # Pa
    noisy = replace(item, excitation=replace(clean, pressure=clean.pressure + noise))
    quick = quickened(noisy)
    assert quick.excitation.step_s == pytest.approx(LONGEST_STEP_S) and clean.step_s == pytest.approx(1e-3)
    par = np.array([base.parameters[name].value for name in model.names])
    tips = []
    for one in (noisy, quick):
        seen = predict_observed(model, par, one, (), 0.0, TIP)
        assert seen is not None
        tips.append(seen.points[:, -1] / MM)
    assert np.sqrt(np.mean((tips[0] - tips[1]) ** 2)) < 0.01


def test_an_effect_of_the_catalogue_is_absent_until_its_slider_moves(player, base):
    chosen = Chosen(base, ("maxwell",))
    sliders = {slider.name: slider for slider in player.open(chosen)}
    amplitude = sliders["maxwell.k1"]
    assert amplitude.value == amplitude.zero == 0.0 and amplitude.low <= 0.0 < amplitude.high
    absent, _ = player.play(chosen, {}, "mixed-3", exact=True)
    there, _ = player.play(chosen, {"maxwell.k1": 0.2, "maxwell.T": 0.5}, "mixed-3")
    assert absent["validate"] == pytest.approx(base.metrics["validate"].tip_rmse_mm, abs=1e-6)
    assert abs(there["validate"] - absent["validate"]) > 0.1


def test_every_slider_holds_its_fitted_value_and_interval(player, base):
    for slider in player.open(Chosen(base, ())):
        known = base.parameters[slider.name]
        assert slider.low < slider.value < slider.high and slider.value == known.value and slider.unit == known.unit
        assert slider.interval is None or slider.interval == known.interval_95


def test_what_a_beam_has_no_use_for_has_no_slider(base):
    """Of a rod four sliders moved nothing."""
    held = {name: base.parameters[name].model_copy(update={"value": 0.0, "fixed": True}) for name in UNUSED_BY_BEAMS}
    rod = base.model_copy(update={"actuator": base.actuator | {"kind": "rod"}, "parameters": base.parameters | held})
    model = Chosen(rod, ()).model()
    sliders = sliders_of(rod, model, start_vector(model, Actuator(**rod.actuator), rod.segments))
    assert [slider.name for slider in sliders] == ["k_ref", "b_pos_ref", "r_hyd"]


def test_the_torque_of_a_stiff_body_has_a_slider_that_reaches_as_far_as_a_fit(base):
    """An arm eight times as wide could rub with no more than the paper's tube."""
    wide = {key: 8 * value if key.endswith("radius") else value for key, value in base.actuator.items()}
    reach = []
    for actuator in (base.actuator, wide):
        chosen = Chosen(base.model_copy(update={"actuator": actuator}), ("coulomb",))
        model = chosen.model()
        sliders = sliders_of(chosen.fit, model, start_vector(model, Actuator(**actuator), base.segments))
        reach += [slider.high for slider in sliders if slider.name == "coulomb.tau_c"]
    assert reach[1] > 100 * reach[0]


def test_a_test_run_or_an_unknown_one_is_not_shown(player, base):
    with pytest.raises(InputError, match="no training or held-out run"):
        player.play(Chosen(base, ()), {}, "elsewhere")
