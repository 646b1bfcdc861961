"""The drive with a tube on it: our engine, and the twin; valve commands from a file and from a duty cycle."""

import numpy as np
import pandas as pd
import pytest

from rfea_vision.artefacts import Actuator
from rfea_vision.cli.root import run
from rfea_vision.drive import Drive, DutyControl, read_commands
from rfea_vision.dynamics.parameters import PUBLISHED
from rfea_vision.dynamics.realtime import Stepper
from rfea_vision.dynamics.simulation import Chain, Model
from rfea_vision.errors import InputError


def _drive_tube(at, seconds, step=1e-3):
    """Time, line pressure, bending angle, flow of a tube on the drive."""
    stepper = Stepper(Model(Chain.tube(Actuator(), 8)), PUBLISHED["8-DoF"].vector(), step)
    drive, flow, rows = Drive(), 0.0, []
    first = drive.water_m3()
    for k in range(round(seconds / step)):
        supply, drain = at(k * step, drive.state.pressure_Pa)
        pressure = drive.step(step, supply=supply, drain=drain, tube_flow_m3_s=flow)
        moment = stepper.step(pressure)
        assert moment.settled
        flow = moment.flow_m3_s
        rows.append(((k + 1) * step, pressure, moment.angle_rad, flow))
    assert drive.water_m3() == pytest.approx(first, abs=1e-15)
    return np.array(rows), drive


def test_water_in_the_tube_is_its_bend():
    """What the drive has given is pi r_o^3 times the bend, by dV/dtheta."""
    rows, drive = _drive_tube(lambda t, p: (float(0.05 < t < 0.12), float(0.6 < t < 0.63)), 1.2)
    assert drive.state.tube_m3 == pytest.approx(np.pi * 0.004**3 * rows[-1, 2], rel=1e-2)
    # Filling overshoots what is held: the tube bends on after the valve has closed, and takes pressure out of the line.
    closing, later = rows[120, 1], rows[590, 1]
    assert 20e3 < later < closing - 1e3
    assert rows[-1, 1] < later


def test_coupling_does_not_hang_on_the_step():
    def valves(t, p):
        return float(0.05 - 1e-9 < t < 0.1 - 1e-9), 0.0

    coarse, fine = (_drive_tube(valves, 0.4, step)[0] for step in (1e-3, 2.5e-4))
    assert np.abs(coarse[:, 1] - fine[3::4, 1]).max() < 4e3
    assert abs(coarse[-1, 1] - fine[-1, 1]) < 500


def test_duty_cycle_follows_its_target():
    rows, _ = _drive_tube(DutyControl(lambda t: 150e3 if t > 0.1 else 0.0).at, 1.5)
    held = rows[rows[:, 0] > 1.0]
    assert held[:, 1] == pytest.approx(150e3, abs=8e3)


def test_commands_hold_from_row_to_row(tmp_path):
    file = tmp_path / "valves.csv"
    file.write_text("time_s,supply,drain\n0.1,1,0\n0.2,0,0\n0.5,0,1\n")
    commands = read_commands(file)
    assert [commands.at(t) for t in (0.0, 0.1, 0.15, 0.2, 0.6)] == [(0, 0), (1, 0), (1, 0), (0, 0), (0, 1)]


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("time_s,supply\n0,1\n", "no column 'drain'"),
        ("time_s,supply,drain\n0,1,0\n0,0,0\n", "time_s must rise"),
        ("time_s,supply,drain\n0,1,0\n1,0.5,0\n", r"row 2: supply must be 0 \(closed\) or 1 \(open\)"),
        ("time_s,supply,drain\n0,on,0\n", "row 1: supply must be"),
    ],
)
def test_broken_commands_are_refused_in_one_sentence(text, sentence, tmp_path):
    file = tmp_path / "valves.csv"
    file.write_text(text)
    with pytest.raises(InputError, match=sentence):
        read_commands(file)
    with pytest.raises(InputError, match="not found"):
        read_commands(tmp_path / "none.csv")


def test_simulate_drives_the_twin_from_a_file(tmp_path, capsys):
    pytest.importorskip("mujoco", reason="MuJoCo is not installed (extra: twin)")
    valves = tmp_path / "valves.csv"
    valves.write_text("time_s,supply,drain\n0.2,1,0\n0.25,0,0\n0.8,0,1\n0.83,0,0\n")
    options = ["--experiments", "1", "--duration", "1s", "--observe", "tip", "--noise", "0.001mm"]
    assert run(["simulate", str(tmp_path / "tube"), "--drive", str(valves), *options]) == 0
    (folder,) = (tmp_path / "tube").glob("*-1")
    pressure = pd.read_csv(folder / "pressure.csv")
    told = pd.read_csv(folder / "valves.csv")
    assert list(told["supply"]) == [0, 1, 0, 0, 0] and list(told["drain"]) == [0, 0, 0, 1, 0]
    at = np.interp([0.19, 0.3, 0.75, 0.9], pressure["time_s"], pressure["pressure_kPa"])
    assert abs(at[0]) < 0.3 and at[1] > 30 and at[2] > 20 and at[3] < at[2] - 10
    track = pd.read_csv(folder / "track.csv")
    assert track["tip_x_mm"].iloc[0] > -5 and track["tip_x_mm"].min() < -15
    hidden = ["--hidden", "pressure_lag.T=20ms"]
    assert run(["simulate", str(tmp_path / "other"), "--drive", str(valves), *options, *hidden]) == 2
    assert "pressure_lag cannot hide behind --drive" in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "other").exists()


def test_simulate_with_a_duty_cycle_follows_the_drawn_pressure(tmp_path):
    pytest.importorskip("mujoco", reason="MuJoCo is not installed (extra: twin)")
    options = ["--experiments", "1", "--duration", "1s", "--observe", "tip"]
    for name, more in (("drive", ["--drive"]), ("smooth", [])):
        assert run(["simulate", str(tmp_path / name), *options, *more]) == 0
    logs = [pd.read_csv(tmp_path / name / "steps-1" / "pressure.csv") for name in ("drive", "smooth")]
    gap = logs[0]["pressure_kPa"] - np.interp(logs[0]["time_s"], logs[1]["time_s"], logs[1]["pressure_kPa"])
    assert 1 < gap.std() < 25 and abs(gap.mean()) < 5
