"""One run whose log is off by a factor is told by its name; runs that the model follows badly are not."""

from types import SimpleNamespace

import numpy as np
import pytest

from rfea_vision.fitting import fit_model, odd_pressure
from tests.fitting.runs import OPTIONS, changed, noisy


@pytest.mark.parametrize("role", ["train", "validate", "none"])
def test_a_log_that_is_half_again_as_high_is_told_by_its_run(exact, role):
    """Nothing said so: `rfea check` doubts from a factor of four on, and effects were named for what was left."""
    data, actuator, _ = exact
    runs = noisy(data, 1)
    odd = next((name for name, run in runs.items() if run.role == role), "")
    if odd:
        runs |= changed({odd: runs[odd]}, lambda one: one.assign(pressure=1.45 * one["pressure"]))
    model = fit_model(runs, actuator, OPTIONS)
    said = [text for text in model.warnings if "is off as if its pressure" in text]
    told = {name: one.pressure_times for name, one in model.experiments.items() if one.pressure_times is not None}
    assert list(told) == [odd][: bool(odd)] and len(said) == bool(odd)
    if odd:
        assert told[odd] == pytest.approx(1.45, rel=0.05)
        assert said[0].startswith(f"run {odd} is off as if its pressure were logged 1.4") and "pressure.unit" in said[0]


@pytest.mark.parametrize(
    ("gains", "left", "span_kPa", "told"),
    [
        ((1.1, 1.12, 0.8, 1.11), 0.1, 90, True),
        ((1.1, 1.12, 0.95, 1.11), 0.1, 90, False),  # as a missing effect does
        ((1.2, 1.0, 0.8, 0.9), 0.1, 90, False),  # no run is like another
        ((1.1, 1.12, 0.8, 1.11), 0.5, 90, False),  # another pressure explains half of it
        ((1.1, 1.12, 0.8, 1.11), 0.1, 20, False),  # the only run of a small pressure: a tube may stiffen
        ((1.1, 0.8), 0.1, 90, False),  # of two neither is the odd one
    ],
)
def test_the_odd_run_stands_apart_from_runs_that_are_alike(monkeypatch, gains, left, span_kPa, told):
    def run(name, kPa):
        item = SimpleNamespace(name=name, excitation=SimpleNamespace(pressure=np.array([0.0, kPa * 1e3])))
        item.rough = lambda frames: item
        return item

    items = [run(str(k), span_kPa if gain == 0.8 else 90) for k, gain in enumerate(gains)]
    def own(_model, _par, item, _clock):
        gain = gains[int(item.name)]
        return float(np.log(gain)), left if gain == 0.8 else 0.9

    monkeypatch.setattr(odd_pressure, "_gain", own)
    found = odd_pressure.odd_pressure(None, None, items, np.zeros(len(items)))  # type: ignore[arg-type]
    assert found == ({"2": pytest.approx(1.11 / 0.8)} if told else {})
