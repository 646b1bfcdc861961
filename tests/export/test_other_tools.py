"""What is taken out for other tools is read again: by our own readers, and by those tools where they are installed."""

import hashlib
import json
from urllib.parse import unquote

import numpy as np
import pytest
import xarray as xr

from rfea_vision.artefacts import ModelFit
from rfea_vision.artefacts.judgement import Parameter
from rfea_vision.campaign.schema import TrackPart
from rfea_vision.errors import DataError
from rfea_vision.export.crate import write_crate
from rfea_vision.export.poses import write_movement
from rfea_vision.readers.tracks import read_track


def recording():
    time = np.arange(50) / 25.0
    line = np.stack([np.zeros((50, 5)), -np.linspace(0, 100, 5)[None] * np.ones((50, 1))], axis=2)
    line[:, :, 0] = -np.linspace(0, 20, 5) * np.sin(time)[:, None]
    valid = np.ones(50, dtype=np.int8)
    valid[7] = 0
    log_time = np.arange(500) / 250.0 - 0.1
    return xr.Dataset(
        {
            "midline": (("time", "node", "xy"), line),
            "valid": ("time", valid),
            "pressure": ("log_time", 50.0 + 40.0 * np.sin(log_time)),
        },
        {"time": time, "xy": ["x", "y"], "log_time": log_time},
    )


def test_poses_come_back(tmp_path):
    data = recording()
    write_movement(tmp_path / "run.nc", data, name="steps")
    track = read_track(tmp_path / "run.nc", spec=TrackPart(points="all"))
    assert not track.valid[7] and track.valid.sum() == 49
    np.testing.assert_allclose(
        track.dataset["tip"].values[track.valid], data["midline"].values[track.valid, -1], atol=1e-6
    )
    with xr.open_dataset(tmp_path / "run.nc", engine="h5netcdf") as poses:
        assert poses["position"].dims == ("time", "space", "keypoints", "individuals") and poses.attrs["fps"] == 25.0
        assert [str(name) for name in poses["keypoints"].values] == ["clamp", "node01", "node02", "node03", "tip"]


def test_movement_reads_the_poses_and_takes_them_on_to_nwb(tmp_path):
    reason = "the package movement is not installed"
    inputs = pytest.importorskip("movement.validators.datasets", reason=reason)
    from movement.io import load_poses, save_poses
    from movement.kinematics import compute_speed
    from pynwb import NWBHDF5IO

    from rfea_vision.export.nwb import write_nwb

    data = recording()
    write_movement(tmp_path / "run.nc", data, name="steps")
    poses = xr.load_dataset(tmp_path / "run.nc", engine="h5netcdf")
    inputs.ValidPosesInputs.validate(poses)
    tip_x = data["midline"].values[:, -1, 0]
    speed = compute_speed(poses["position"]).sel(keypoints="tip").values.ravel()
    np.testing.assert_allclose(speed, np.abs(np.gradient(tip_x, data["time"].values)), atol=1e-6)
    with NWBHDF5IO(tmp_path / "theirs.nwb", "w") as file:
        file.write(save_poses.to_nwb_file(poses))
    write_nwb(tmp_path / "ours.nwb", data, name="steps", campaign="tube-A", version="0.6")
    for path in (tmp_path / "theirs.nwb", tmp_path / "ours.nwb"):
        again = load_poses.from_nwb_file(path)
        assert [str(name) for name in again["keypoints"].values] == [str(name) for name in poses["keypoints"].values]
        np.testing.assert_array_equal(again["position"].values, poses["position"].values)
        np.testing.assert_array_equal(again["confidence"].values, poses["confidence"].values)


def test_nwb_opens_a_run_and_finds_no_fault_in_it(tmp_path):
    from pynwb import NWBHDF5IO, validate

    from rfea_vision.export.nwb import write_nwb

    data = recording()
    data["chamber_pressure"] = (("chamber", "log_time"), np.stack([data["pressure"].values, np.zeros(500)]))
    data = data.assign_coords(chamber=["left", "right"])
    write_nwb(tmp_path / "steps.nwb", data, name="steps", campaign="tube-A", version="0.6")
    assert validate(path=tmp_path / "steps.nwb") == []
    with NWBHDF5IO(tmp_path / "steps.nwb", "r") as file:
        run = file.read()
        assert run.identifier == "steps" and "tube-A" in run.session_description
        poses = run.processing["behavior"]["PoseEstimation"]
        assert poses.source_software_version == "0.6"
        assert list(poses.skeleton.nodes[:]) == ["clamp", "node01", "node02", "node03", "tip"]
        assert poses.skeleton.edges[:].tolist() == [[0, 1], [1, 2], [2, 3], [3, 4]]
        for index, keypoint in enumerate(poses.skeleton.nodes[:]):
            places = poses[keypoint]
            np.testing.assert_allclose(places.data[:] * places.conversion, data["midline"].values[:, index] * 1e-3, atol=1e-9)
            np.testing.assert_array_equal(places.confidence[:], data["valid"].values)
        np.testing.assert_array_equal(poses["tip"].timestamps[:], data["time"].values)
        for label, values in (("pressure", data["pressure"]), ("pressure of left", data["pressure"]), ("pressure of right", 0)):
            log = run.acquisition[label]
            np.testing.assert_allclose(log.data[:] * log.conversion, np.zeros(500) + values * 1e3)
            np.testing.assert_array_equal(log.timestamps[:], data["log_time"].values)
        assert log.unit == "pascals" and places.unit == "meters"


def test_an_angle_alone_has_no_poses(tmp_path):
    with pytest.raises(DataError, match="only its bend angle was measured"):
        write_movement(tmp_path / "run.nc", xr.Dataset({"valid": ("time", [1])}, {"time": [0.0]}), name="steps")


def test_a_crate_describes_every_file_and_value(tmp_path):
    fit = ModelFit(name="base", segments=8, effects=[], status="converged", message="in 5 steps",
                   parameters={"r_hyd": Parameter(value=0.0036, unit="m", interval_95=(0.0035, 0.0037))},
                   metrics={}, experiments={}, inputs={"steps/video.mp4": "ab" * 32})  # fmt: skip
    (tmp_path / "model.json").write_text("{}")
    path = write_crate(
        tmp_path / "crate",
        fit,
        {"models/my model/model.json": tmp_path / "model.json"},
        name="tube",
        made_on="2026-03-01",
        versions=[("numpy", "2")],
    )
    assert not any(" " in item["@id"] for item in json.loads(path.read_text())["@graph"])
    graph = {item["@id"]: item for item in json.loads(path.read_text())["@graph"]}
    for item in graph.values():
        if item["@type"] == "File":
            assert hashlib.sha256((tmp_path / "crate" / unquote(item["@id"])).read_bytes()).hexdigest() == item["sha256"]
    assert graph["./"]["datePublished"] == "2026-03-01"
    assert graph["#parameter/r_hyd"]["minValue"] == 0.0035 and graph["#raw/steps/video.mp4"]["sha256"] == "ab" * 32

    def references(value):
        if isinstance(value, dict):
            return {value["@id"]} if set(value) == {"@id"} else set().union(*map(references, value.values()), set())
        return set().union(*map(references, value), set()) if isinstance(value, list) else set()

    used = set().union(*(references(item) for item in graph.values()))
    assert used - {"https://w3id.org/ro/crate/1.1"} <= set(graph)
    again = path.read_bytes()
    write_crate(
        tmp_path / "crate",
        fit,
        {"models/my model/model.json": tmp_path / "model.json"},
        name="tube",
        made_on="2026-03-01",
        versions=[("numpy", "2")],
    )
    assert path.read_bytes() == again
    crate = pytest.importorskip(
        "rocrate.rocrate", reason="the package rocrate is not installed: only the graph was checked"
    )
    read = crate.ROCrate(tmp_path / "crate")
    assert [entity.id for entity in read.data_entities] == ["models/my%20model/model.json"]
    assert read.datePublished.date().isoformat() == "2026-03-01"
