"""Real recordings of others, read where they lie beside the checkout; and small tables made here."""

import numpy as np
import pytest

from rfea_vision.artefacts import Actuator
from rfea_vision.dynamics.parameters import scaled
from rfea_vision.dynamics.simulation import Chain, Excitation, Model
from rfea_vision.errors import InputError
from testing.chain_diagnosis import ChainRecord, diagnose_chain, residual_torque
from testing.pressure_tip import fit_pressure_tip, fit_table
from testing.real_records import pressure_tables, published_friction, two_links
from testing.steady import steady_curve


@pytest.mark.parametrize("bends", ["left", "right"])
def test_pressure_tip_table_gives_back_the_stiffness(bends, published):
    actuator = Actuator(bends=bends)
    truth = scaled(published, 8, 16)
    truth[6] = 0.0035644
    pressure = np.linspace(0, 270e3, 10)
    tip = steady_curve(Model(Chain.tube(actuator, 16)), truth, pressure).tip_m * 1e3
    tip[:, 0] *= 1 if bends == "left" else -1
    rng = np.random.default_rng(1)
    fit = fit_pressure_tip(pressure, tip + rng.normal(0, 0.05, tip.shape), actuator)
    # k over r_hyd is what a steady state tells; r_hyd is held at the table's value, which is the truth's.
    for name, index in (("k_ref", 0), ("k_slope", 1)):
        assert abs(fit.parameters[name] - truth[index]) < 4 * fit.standard_error[name] < 0.1 * abs(truth[index])
    assert 0.03 < fit.rms_mm < 0.12 and fit.limit_Pa == pytest.approx(382e3, rel=0.02)
    assert np.allclose(fit.tip_mm + fit.residual_mm, tip, atol=0.3)


def test_pressure_tip_table_that_cannot_be_fitted_says_why(actuator):
    with pytest.raises(InputError, match="one x, y per pressure"):
        fit_pressure_tip([0, 1e5], [[0, -155]], actuator)
    with pytest.raises(InputError, match="not every value is a number"):
        fit_pressure_tip([0, 1e5], [[0, -155], [np.nan, -100]], actuator)
    with pytest.raises(InputError, match="cannot carry"):
        fit_pressure_tip([1e5], [[-20, -150]], actuator)
    with pytest.raises(InputError, match="k_reff is not a parameter"):
        fit_pressure_tip([0, 1e5], [[0, -155], [-40, -140]], actuator, free=("k_reff",))


def test_real_static_tips(shared_data):
    """A zig-zag pneumatic actuator: where one side is held it is an RSDA to 1 mm of 100; where both sides grow it is not."""
    tables = pressure_tables(shared_data)
    assert len(tables) == 53
    assert np.median([table.length_mm for table in tables.values()]) == pytest.approx(135.0, abs=0.01)
    bender = tables["DS10-DS10-0-1"]
    assert bender.length_mm == pytest.approx(135.0, abs=0.1)
    radius, fit = fit_table(bender)
    assert fit.rms_mm < 1.0 and fit.straight_rms_mm > 60
    assert 0.012 <= radius <= 0.020
    assert np.all(np.diff(fit.angle_deg) > 0) and 85 < fit.angle_deg[-1] < 100
    grower = tables["DS10-DS10-3-2"]  # strain-limiting layers on both sides: 30 mm longer, 15 mm sideways
    _, misfit = fit_table(grower)
    assert misfit.rms_mm > 10  # no RSDA tube lengthens along its hinge line
    assert np.abs(misfit.residual_mm[:, 1]).max() > 5 * np.abs(misfit.residual_mm[:, 0]).max()


@pytest.fixture(scope="module")
def links(shared_data):
    return two_links(shared_data)


def test_residual_torque_of_the_two_link_chain_falls_as_published(links):
    """Run 00, 15 Hz: 0.174 N m without friction, 0.082 with b v + 0.078 atan(100 v)."""
    residual = links.motions["00"].residual[:, 1]
    assert np.sqrt(np.mean(residual**2)) == pytest.approx(0.174, abs=0.004)
    left = residual - published_friction(links, "00", 2)
    assert np.sqrt(np.mean(left**2)) == pytest.approx(0.082, abs=0.004)


def test_critique_names_dry_friction_at_joint_2(links):
    every = diagnose_chain(links.chain, list(links.motions.values()), gravity=links.published["g"])
    first = every.named[0]
    assert (first.effect, first.joint) == ("coulomb", 2)
    # The published law, cf atan(100 v), saturates at cf pi / 2.
    assert abs(first.amplitude * 2 / np.pi / links.published["cf2"] - 1) < 0.30
    assert every.rms_after[1] < 0.55 * every.rms_before[1]
    runner_up = next(c for c in every.candidates[1:] if c.joint == 2)
    assert first.bic < runner_up.bic - 100  # viscous friction is no match
    # Joint 1 as it is: most of its residual stays, whatever is named.
    assert every.rms_before[0] > 0.25 and every.rms_after[0] > 0.85 * every.rms_before[0]
    assert any("joint 1" in sentence for sentence in every.sentences)


@pytest.mark.parametrize("run", ["00", "12"])
def test_each_run_by_itself_names_the_same(links, run):
    alone = diagnose_chain(links.chain, [links.motions[run]], gravity=links.published["g"], most=1)
    assert (alone.named[0].effect, alone.named[0].joint) == ("coulomb", 2)
    assert alone.named[0].amplitude * 2 / np.pi == pytest.approx(links.published["cf2"], rel=0.35)


def _driven_chain(hidden=None, seed=0):
    """A small chain driven by known torques, in our own engine, with or without friction at one joint."""
    from rfea_vision.effects.catalogue import catalogue

    chain = Chain.general([0.3, 0.2], [0.56, 0.6], [0.2, 0.18], [0.004, 0.004])
    time = np.arange(0, 8, 2e-3)
    drive = np.column_stack([0.6 * np.sin(2.1 * time) + 0.3 * np.sin(5.3 * time), 0.5 * np.sin(3.2 * time + 1)])
    excitation = Excitation(0.0, 2e-3, np.zeros(time.size), drive)
    effects, at = (), {}
    par = np.zeros(7)
    if hidden is not None:
        effects, at = (catalogue()["coulomb"](),), {"coulomb": hidden}
        par = np.append(par, [0.05, 0.1])
    model = Model(chain, effects, order=3, at=at)
    motion = model.simulate(par, excitation, time[:-1], start=(np.zeros(2), np.zeros(2)))
    assert motion.ok
    rng = np.random.default_rng(seed)
    noisy = motion.theta + rng.normal(0, 2e-4, motion.theta.shape)
    return chain, ChainRecord(time[:-1], noisy, drive[:-1] + rng.normal(0, 0.01, motion.theta.shape))


def test_chain_with_nothing_missing_is_given_no_name():
    chain, record = _driven_chain()
    found = diagnose_chain(chain, [residual_torque(chain, record)])
    assert not found.named and "nothing on offer" in found.sentences[-1]


@pytest.mark.parametrize("joint", [1, 2])
def test_friction_hidden_at_one_joint_is_found_there_with_its_size(joint):
    chain, record = _driven_chain(joint)
    found = diagnose_chain(chain, [residual_torque(chain, record)])
    assert [(c.effect, c.joint) for c in found.named] == [("coulomb", joint)]
    assert found.amplitudes[0] == pytest.approx(0.05, abs=3 * found.standard_errors[0])
    assert found.standard_errors[0] < 0.005


def test_record_that_does_not_fit_the_chain_says_so():
    chain, record = _driven_chain()
    with pytest.raises(InputError, match="one column per joint"):
        residual_torque(chain, ChainRecord(record.time_s, record.angle[:, :1], record.torque))
    with pytest.raises(InputError, match="time does not rise"):
        residual_torque(chain, ChainRecord(record.time_s[::-1], record.angle, record.torque))
