"""A recording as NWB, Neurodata Without Borders: poses (ndx-pose) and pressure in one file (https://www.nwb.org)."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import xarray as xr
from ndx_pose import PoseEstimation, PoseEstimationSeries, Skeleton, Skeletons
from pynwb import NWBHDF5IO, NWBFile, TimeSeries

from rfea_vision.export.poses import movement_dataset
from rfea_vision.files import whole_file

#: NWB asks for the date of a recording, and neither films nor logs have to know one.
UNKNOWN_START = datetime(1970, 1, 1, tzinfo=UTC)
M_PER_MM = 1e-3  # unit conversion
PA_PER_KPA = 1e3  # unit conversion


def nwb_file(data: xr.Dataset, *, name: str, campaign: str, version: str) -> NWBFile:
    """Return the centre line of a recording as poses of one skeleton, and its pressure log as it was sampled, on one clock.

    Parameters
    ----------
    data : of a `Recording`: ``midline`` (time, node, xy) or ``tip`` (time, xy) in mm, ``pressure`` (log_time) and, of several
        chambers, ``chamber_pressure`` (chamber, log_time) in kPa
    name : of the run; it becomes the identifier
    campaign : its name
    version : of rfea-vision, which found the poses

    Returns
    -------
    pynwb.NWBFile
        Positions and pressure as numbers in mm and kPa, with NWB's ``conversion`` to m and Pa; ``confidence`` 1 where the frame is
        valid, 0 where it was set aside. Times in s are on the log's clock. The date is 1970-01-01: no file has to name it.

    Raises
    ------
    DataError
        If only an angle was measured.
    """
    poses = movement_dataset(data, name=name)
    time_s, keypoints = poses["time"].values, [str(keypoint) for keypoint in poses["keypoints"].values]
    file = NWBFile(
        session_description=f"Run {name} of the soft actuator {campaign}. The date is not known: 1970-01-01 stands for it.",
        identifier=name, session_start_time=UNKNOWN_START, timestamps_reference_time=UNKNOWN_START,
    )  # fmt: skip
    series = [
        PoseEstimationSeries(
            name=keypoint, data=poses["position"].values[:, :, index, 0], unit="meters", conversion=M_PER_MM, timestamps=time_s,
            reference_frame=poses.attrs["frame"], confidence=poses["confidence"].values[:, index, 0],
            confidence_definition="1 where the frame is valid, 0 where it was set aside",
        )
        for index, keypoint in enumerate(keypoints)
    ]  # fmt: skip
    ends = np.arange(len(keypoints) - 1, dtype=np.uint8)
    line = Skeleton(name="tube", nodes=keypoints, edges=np.stack([ends, ends + 1], axis=1) if ends.size else None)
    found = PoseEstimation(
        pose_estimation_series=series, skeleton=line, description="Centre line of the tube, from its clamp to its tip.",
        source_software="rfea-vision", source_software_version=version,
    )  # fmt: skip
    behavior = file.create_processing_module("behavior", "The measured motion of the tube.")  # pyright: ignore[reportAttributeAccessIssue] # pynwb makes its methods as it is imported
    behavior.add([Skeletons(skeletons=[line]), found])
    pressures = {"pressure": data["pressure"].values}
    if "chamber_pressure" in data:
        by_chamber = zip(data["chamber"].values, data["chamber_pressure"].values, strict=True)
        pressures |= {f"pressure of {chamber}": values for chamber, values in by_chamber}
    for label, values in pressures.items():
        log = TimeSeries(
            name=label, data=values, unit="pascals", conversion=PA_PER_KPA, timestamps=data["log_time"].values,
            description="gauge; of several chambers 'pressure' is the sum, each times its sign",
        )  # fmt: skip
        file.add_acquisition(log)  # pyright: ignore[reportCallIssue]
    return file


def write_nwb(path: Path, data: xr.Dataset, *, name: str, campaign: str, version: str) -> None:
    """Write the recording of `nwb_file` as NWB 2 in HDF5. Identifiers in it are drawn anew each time."""
    with whole_file(path) as temporary, NWBHDF5IO(temporary, "w") as file:  # pyright: ignore[reportCallIssue]
        file.write(nwb_file(data, name=name, campaign=campaign, version=version))  # pyright: ignore[reportCallIssue]
