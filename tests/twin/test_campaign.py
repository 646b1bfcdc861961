"""What the twin writes is a campaign, its answer is beside it, and a wrong request leaves nothing behind."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from rfea_vision.artefacts import Actuator
from rfea_vision.errors import DataError, InputError
from rfea_vision.twin import BaseParameters, TwinOptions, parse_hidden, simulate

QUICK = {"joints": 12, "step_s": 0.002, "duration_s": 0.7, "roles": ("train", "validate")}


def table(folder: Path) -> pd.DataFrame:
    return pd.read_csv(next(folder.glob("steps-1/track.csv")))


def test_hidden_effects_are_read_with_their_units() -> None:
    assert parse_hidden(["maxwell.k1=0.03", "maxwell.T=1200 ms"]) == {"maxwell.k1": 0.03, "maxwell.T": 1.2}
    assert parse_hidden(["payload.m=2g"])["payload.m"] == pytest.approx(0.002)
    assert parse_hidden(["gravity_tilt.angle = 3 deg"])["gravity_tilt.angle"] == pytest.approx(math.radians(3))
    assert parse_hidden(["hysteresis.tau_h=0.3 mN*m"])["hysteresis.tau_h"] == pytest.approx(3e-4)
    assert parse_hidden(["pressure_offset.p0=2 kPa"])["pressure_offset.p0"] == 2000
    assert parse_hidden(["virtual_work.a=5e-1"]) == {"virtual_work.a": 0.5}


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("maxwell", "write effect.parameter=value"),
        ("maxwell.T=1.2", "no unit"),
        ("maxwell.T=1.2 mm", "converts to 's'"),
        ("maxwell.x=1", "maxwell.k1, maxwell.T"),
        ("ghost.a=1", "known are"),
        ("payload.m=", "not a number"),
        ("virtual_work.a=nan", "not a number"),
    ],
)
def test_a_wrong_hidden_effect_is_refused_in_one_sentence(text: str, complaint: str) -> None:
    with pytest.raises(InputError, match=complaint) as caught:
        parse_hidden([text])
    assert "--hidden" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_campaign_follows_the_formats(tmp_path: Path) -> None:
    out = tmp_path / "tube"
    truth = simulate(out, TwinOptions(hidden=parse_hidden(["payload.m=1g"]), seed=4, exact_tracks=True, **QUICK))
    campaign = yaml.safe_load((out / "campaign.yaml").read_text())
    assert campaign["format"] == "rfea-campaign/1"
    assert campaign["actuator"]["outer_radius"] == "4 mm"
    assert sorted(path.name for path in out.iterdir()) == ["campaign.yaml", "multisine-2", "steps-1"]
    experiment = yaml.safe_load((out / "steps-1" / "experiment.yaml").read_text())
    assert experiment["format"] == "rfea-experiment/1"
    assert (experiment["role"], experiment["sync"]) == ("train", {"method": "motion"})
    track, log = table(out), pd.read_csv(out / "steps-1" / "pressure.csv")
    assert list(track.columns[:3]) == ["time_s", "x00_mm", "y00_mm"]
    assert track.shape == (168, 2 + 2 * 33)
    assert track["time_s"].diff()[1:].to_numpy() == pytest.approx(1 / 240, abs=2e-6)
    assert list(log.columns) == ["time_s", "pressure_kPa"]
    assert log["time_s"].diff()[1:].to_numpy() == pytest.approx(0.001, abs=1e-9)
    offset = truth["experiments"]["steps-1"]["offset_s"]
    assert 0.01 < abs(offset) < 0.1
    assert log["time_s"].iloc[0] < offset < track["time_s"].iloc[-1] + offset < log["time_s"].iloc[-1]
    assert json.loads((tmp_path / "tube-truth.json").read_text()) == truth
    assert truth["effects"] == ["payload"]
    assert truth["parameters"]["payload.m"] == pytest.approx(1e-3)
    for path in out.rglob("*.*"):
        assert "payload" not in path.read_text()
    assert (tmp_path / "tube-truth" / "steps-1.nc").exists()


def test_same_seed_same_campaign_and_another_seed_another(tmp_path: Path) -> None:
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        simulate(tmp_path / name, TwinOptions(seed=seed, **QUICK))
    a, b, c = (table(tmp_path / name).to_numpy() for name in "abc")
    assert np.array_equal(a, b)
    assert not np.allclose(a, c, atol=1.0)


def test_noise_is_what_was_asked_for(tmp_path: Path) -> None:
    options = {**QUICK, "seed": 3, "duration_s": 3.0, "roles": ("train",), "exact_tracks": True}
    clean = None
    for name, correlation in (("white", 0.0), ("slow", 0.8)):
        simulate(tmp_path / name, TwinOptions(noise_mm=0.05, noise_correlation=correlation, **options))
        quiet = tmp_path / f"{name}-quiet"
        simulate(quiet, TwinOptions(noise_mm=0.0, **options))
        clean = table(quiet).to_numpy()[:, 1:-1]
        noise = table(tmp_path / name).to_numpy()[:, 1:-1] - clean
        assert noise.std() == pytest.approx(0.05, rel=0.05)
        measured = float(np.mean(noise[1:] * noise[:-1]) / noise.var())
        assert measured == pytest.approx(correlation, abs=0.05)


def test_a_tube_that_bends_right_is_the_mirror_of_one_that_bends_left(tmp_path: Path) -> None:
    for side in ("left", "right"):
        options = TwinOptions(seed=6, noise_mm=0.0, actuator=Actuator(bends=side), **QUICK)
        simulate(tmp_path / side, options)
    left, right = (table(tmp_path / side) for side in ("left", "right"))
    assert right["x32_mm"].to_numpy() == pytest.approx(-left["x32_mm"].to_numpy())
    assert right["y32_mm"].to_numpy() == pytest.approx(left["y32_mm"].to_numpy())
    assert left["x32_mm"].min() < -10


def test_resting_tube_hangs_down_its_length_and_grows_as_it_bends(tmp_path: Path) -> None:
    simulate(tmp_path / "a", TwinOptions(seed=6, noise_mm=0.0, **QUICK))
    track = table(tmp_path / "a")
    nodes = track.to_numpy()[:, 1:-1].reshape(len(track), 33, 2)
    assert nodes[0, 0] == pytest.approx([0, 0], abs=1e-4)
    assert nodes[0, -1] == pytest.approx([0, -155], abs=0.2)
    steps = np.hypot(*np.moveaxis(np.diff(nodes, axis=1), 2, 0))
    assert steps.std(axis=1).max() < 0.005  # evenly spaced along the centre line
    furthest = np.argmin(nodes[:, -1, 0])
    tangent = nodes[furthest, -1] - nodes[furthest, -2]
    angle = math.atan2(-tangent[0], -tangent[1])
    assert steps[furthest].sum() - 155 == pytest.approx(4 * angle, abs=0.2)  # s = r_o theta


def test_clock_effects_hide_in_the_claimed_offset_and_not_in_the_motion(tmp_path: Path) -> None:
    late = simulate(tmp_path / "late", TwinOptions(hidden={"time_offset.dt": 0.01}, seed=7, **QUICK))
    claimed = yaml.safe_load((tmp_path / "late" / "steps-1" / "experiment.yaml").read_text())["sync"]
    true = late["experiments"]["steps-1"]["offset_s"]
    assert claimed["method"] == "offset"
    assert float(claimed["value"].split()[0]) == pytest.approx(1e3 * (true - 0.01), abs=1e-3)
    simulate(tmp_path / "plain", TwinOptions(seed=7, **QUICK))
    assert np.array_equal(table(tmp_path / "late").to_numpy(), table(tmp_path / "plain").to_numpy())
    simulate(tmp_path / "drift", TwinOptions(hidden={"clock_drift.d": 0.02}, seed=7, **QUICK))
    difference = table(tmp_path / "drift").to_numpy() - table(tmp_path / "plain").to_numpy()
    assert np.abs(difference[:3]).max() < np.abs(difference[-30:]).max()


def test_camera_effects_change_what_is_seen(tmp_path: Path) -> None:
    simulate(tmp_path / "plain", TwinOptions(seed=8, noise_mm=0.0, **QUICK))
    simulate(tmp_path / "large", TwinOptions(hidden={"camera_scale.s": 0.01}, seed=8, noise_mm=0.0, **QUICK))
    simulate(tmp_path / "tilted", TwinOptions(hidden={"plane_tilt.b": 0.2}, seed=8, noise_mm=0.0, **QUICK))
    simulate(tmp_path / "rolled", TwinOptions(hidden={"camera_roll.angle": 0.02}, seed=8, noise_mm=0.0, **QUICK))
    plain, large, tilted, rolled = (table(tmp_path / name).to_numpy()[:, 1:-1] for name in ("plain", "large", "tilted", "rolled"))
    assert large == pytest.approx(1.01 * plain, abs=2e-4)
    y = plain[:, 1::2]
    turned = (plain[:, 0::2] + 1j * y) * np.exp(-0.02j)
    assert turned[:, -1].real.mean() < plain[:, -2].mean() < 0.0, "it is turned to where it bends"
    assert rolled[:, 0::2] + 1j * rolled[:, 1::2] == pytest.approx(turned, abs=3e-4)
    assert tilted[:, 1::2] == pytest.approx(y * (1 + 0.2e-3 * y), abs=2e-4)


@pytest.mark.parametrize(("observe", "column"), [("tip", "tip_x_mm"), ("angle", "angle_deg")])
def test_other_observations(tmp_path: Path, observe: str, column: str) -> None:
    simulate(tmp_path / "a", TwinOptions(seed=9, observe=observe, **QUICK))
    assert column in table(tmp_path / "a").columns


def test_a_repeat_has_the_same_motion_and_other_noise(tmp_path: Path) -> None:
    simulate(tmp_path / "a", TwinOptions(seed=9, repeat=True, **QUICK))
    again = yaml.safe_load((tmp_path / "a" / "steps-1-again" / "experiment.yaml").read_text())
    assert again["repeat_of"] == "steps-1"
    first = table(tmp_path / "a").to_numpy()[:, 1:-1]
    second = pd.read_csv(tmp_path / "a" / "steps-1-again" / "track.csv").to_numpy()[:, 1:-1]
    assert (first - second).std() == pytest.approx(0.06 * math.sqrt(2), rel=0.05)


def test_nothing_is_overwritten_and_nothing_is_left_half_written(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("keep")
    with pytest.raises(InputError, match="not empty"):
        simulate(tmp_path / "mine", TwinOptions(**QUICK))
    weak = BaseParameters(k_ref=1e-6, k_slope=0.0)
    with pytest.raises(DataError, match="or take another tube"):
        simulate(tmp_path / "weak", TwinOptions(base=weak, **QUICK))

    def interrupt(done: int, total: int) -> None:
        if done > 0.3 * total:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate(tmp_path / "stopped", TwinOptions(**QUICK), interrupt)
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


def test_video_campaign_is_complete(tmp_path: Path) -> None:
    options = TwinOptions(
        seed=5, video=True, frame_size=(180, 320), photos=3, joints=12, step_s=0.002, duration_s=0.1, roles=("train",)
    )
    seen: list[tuple[int, int]] = []
    simulate(tmp_path / "film", options, lambda done, total: seen.append((done, total)))
    camera = yaml.safe_load((tmp_path / "film" / "campaign.yaml").read_text())["camera"]
    assert camera["board"]["inner_corners"] == [9, 6]
    photos = sorted(path.name for path in (tmp_path / "film" / "calibration").iterdir())
    assert photos == ["board_01.jpg", "board_02.jpg", "board_03.jpg", "plane.jpg"]
    assert (tmp_path / "film" / "steps-1" / "video.mp4").stat().st_size > 1000
    assert not (tmp_path / "film" / "steps-1" / "track.csv").exists()
    assert seen[-1][0] == seen[-1][1]
    assert [done for done, _ in seen] == sorted(done for done, _ in seen)


def test_a_tube_that_stands_at_no_pressure_says_what_was_hidden_and_why(tmp_path: Path) -> None:
    """A weak ring of negative stiffness was said to bend too far, without a word on what had been asked for."""
    with pytest.raises(DataError, match=r"with kink\.at=0\.35, kink\.c=2\.5 the tube stands at no pressure \(stiffness or damping"):
        simulate(tmp_path / "out", TwinOptions(hidden=parse_hidden(["kink.c=2.5"]), **QUICK))
    assert not (tmp_path / "out").exists()
