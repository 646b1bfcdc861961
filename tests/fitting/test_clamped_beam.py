"""A real beam of silicone, let go by hand, bare and with 52 g at its tip: by the commands that docs/formats.md tells of."""

import importlib.util

import pytest

from rfea_vision.artefacts import ModelFit
from rfea_vision.cli.root import run
from rfea_vision.critique import diagnose
from rfea_vision.stages import open_campaign


@pytest.fixture(scope="module")
def beam(shared_data, root, tmp_path_factory):
    """The campaign that examples/clamped_beam.py makes of the tables."""
    spec = importlib.util.spec_from_file_location("clamped_beam", root / "examples" / "clamped_beam.py")
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    folder = tmp_path_factory.mktemp("real") / "beam"
    tables = shared_data / "clamped-beam"
    bare, loaded = ([tables / f"{kind}_{run}.csv" for run in "ab"] for kind in ("gravity", "load52"))
    example.write(folder, bare, loaded)
    return folder


def test_the_load_is_weighed_and_the_held_out_run_met(beam, capsys):
    assert run(["fit", str(beam), "--segments", "6", "--add", "payload"]) == 0, capsys.readouterr().err
    found = ModelFit.load(beam / "rfea" / "models" / "base+payload" / "model.json")
    assert found.parameters["payload.m"].value == pytest.approx(0.052, rel=0.1)
    held_out = found.experiments["load52_b"]
    assert held_out.role == "validate" and held_out.tip_rmse_mm < 0.9  # of a swing of 34 mm, whose turns count, and a sag of 17
    assert found.experiments["gravity_b"].tip_rmse_mm < 0.6


@pytest.mark.study
def test_the_load_is_named(beam):
    """Of what could make a beam sag more and swing slower it is the mass, and nothing of a pressure that there is not."""
    work = open_campaign(beam)
    recordings = work.recordings("train", "validate")
    rivals = ("payload", "rest_curvature", "pressure_offset", "com_offset", "drag")
    diagnosis, _ = diagnose(work.fit(segments=4), recordings, candidates=rivals)
    assert diagnosis.named[0] == "payload"
    assert "pressure_offset" not in [row.effect for row in diagnosis.candidates]
