"""Commands left of the recording: calibrate, track, sync."""

from __future__ import annotations

from collections.abc import Collection
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rfea_vision.artefacts.rows import CalibrationQuality
from rfea_vision.cli.console import drawn_previews, print_json, print_table, say, say_next, up_to_date
from rfea_vision.cli.options import PATH, Command, campaign_options, opened
from rfea_vision.errors import DataError
from rfea_vision.units import to_error

if TYPE_CHECKING:
    from rfea_vision.artefacts import Track
    from rfea_vision.campaign import ExperimentSpec
    from rfea_vision.stages import Workspace
    from rfea_vision.stages.stored import Stored


def experiment_option(command: Command) -> Command:
    """Add -e NAME."""
    return click.option(
        "-e", "--experiment", "names", multiple=True, metavar="NAME", help="Only this experiment; may be repeated."
    )(command)


@click.command("calibrate")
@campaign_options
@click.option("--ros", type=PATH, help="Also write the lens as a ROS camera_info file.")
def calibrate_command(campaign: Path, out: Path | None, force: bool, as_json: bool, ros: Path | None) -> None:
    """Lens and plane of motion from the photos of the board."""
    with opened(campaign, out, "calibrate", force=force) as work:
        calibration = work.calibrate()
        outcomes = work.outcomes
    if calibration is None:
        summary: dict[str, Any] = {
            "status": "nothing to do",
            "sentence": "no experiment has pictures, so no camera is needed",
        }
    else:
        matrix = calibration.camera_matrix
        summary = {
            "status": outcomes[0]["outcome"],
            "file": str(work.out / "calibration" / "camera.yaml"),
            "model": calibration.model,
            "rms_px": calibration.rms_px,
            "fx": float(matrix[0, 0]),
            "fy": float(matrix[1, 1]),
            "cx": float(matrix[0, 2]),
            "cy": float(matrix[1, 2]),
            "plane_tilt_deg": calibration.plane_tilt_deg,
            "photos": list(calibration.photos),
            "quality": calibration.quality,
        }
    if calibration is not None and ros is not None:
        from rfea_vision.calibration.storage import save_ros

        save_ros(ros, calibration)
        summary["ros"] = str(ros)
    if as_json:
        print_json(summary)
    elif calibration is None:
        say(summary["sentence"])
        say_next("rfea sync", campaign)
    elif ros is None and up_to_date(work):
        say_next("rfea track", campaign, *([] if drawn_previews(work.out) else ["--preview"]))
    else:
        photos = sorted(calibration.photos, key=lambda photo: (not photo["used"], -(photo.get("rms_px") or 0.0)))
        rows = [
            [photo["file"], "yes" if photo["used"] else "no", photo.get("rms_px"), photo.get("reason") or ""]
            for photo in photos
        ]
        if rows:
            print_table("worst first", ["photo", "used", "RMS px", "reason"], rows, left=2)
        lens = ", ".join(f"{key} {summary[key]:.1f}" for key in ("fx", "fy", "cx", "cy"))
        fit = f", RMS {calibration.rms_px:.3f} px" if isfinite(calibration.rms_px) else ""
        tilt = "no photo of the plane of motion"
        if isfinite(calibration.plane_tilt_deg):
            error = calibration.quality.get("plane", {}).get("tilt_stderr_deg")
            tilt = f"plane tilted by {calibration.plane_tilt_deg:.2f} deg"
            tilt += f" (standard error {error:.2f} deg)" if error is not None else ""
        say(f"{calibration.model}: {lens} px{fit}, {tilt}")
        for sentence in _judgement(calibration.quality):
            say(sentence)
        say_next("rfea track", campaign, *([] if drawn_previews(work.out) else ["--preview"]))


def _judgement(quality: CalibrationQuality) -> list[str]:
    """What the calibration says of itself, warnings last."""
    said = [
        quality.get("lens_reason"),
        quality.get("region", {}).get("sentence"),
        quality.get("cross_validation", {}).get("sentence") or quality.get("cross_validation", {}).get("note"),
        quality.get("advice"),
    ]
    return [text for text in said if text] + [f"warning: {text}" for text in quality.get("warnings", [])]


@click.command("track")
@campaign_options
@experiment_option
@click.option("--preview", is_flag=True, help="Also write preview.mp4: the track drawn over the video.")
def track_command(
    campaign: Path, out: Path | None, force: bool, as_json: bool, names: tuple[str, ...], preview: bool
) -> int:
    """The tube in every frame, with its standard errors.

    Centre line, edges, width, curvature, tip, bend angle and elongation go to track.nc.
    """
    from rfea_vision.stages import measurement

    previews: dict[str, Path] = {}
    with opened(campaign, out, "track", "clip", force=force, only=names) as work:

        def of(experiment: ExperimentSpec) -> Stored[Track]:
            tracked = work.track_of(experiment)
            if preview and (names or experiment.video is not None):
                previews[experiment.name] = measurement.preview(work, experiment).value
            return tracked

        tracks = work.each(names, of, "tracked")
        facts = {name: track.facts or measurement.facts_of_track(track.value) for name, track in tracks.items()}
    summary = [
        {
            "experiment": name,
            "file": str(work.out / name / "track.nc"),
            "status": work.outcome("track", name),
            **{key: value for key, value in facts[name].items() if key != "too_little"},
            **({"preview": str(previews[name])} if name in previews else {}),
        }
        for name in tracks
    ]
    lacking = {name: said["too_little"] for name, said in facts.items() if said["too_little"]}
    if as_json:
        print_json({"tracks": summary, "too_little": lacking})
    elif not lacking and up_to_date(work):
        _say_what_follows(work, campaign, tracks, previews)
    else:
        rows = [
            [
                row["experiment"],
                row["frames"],
                row["valid"],
                ", ".join(f"{count} {reason}" for reason, count in row["reasons"].items()),
                row["file"],
            ]
            for row in summary
        ]
        print_table("", ["experiment", "frames", "valid", "rejected", "file"], rows)
        for name, few in lacking.items():
            say(f"{name}: {few}")
        if lacking:
            say_next(
                "rfea track", campaign, "-e", next(iter(lacking)), "--preview", why="draws what was seen over the video"
            )
        else:
            _say_what_follows(work, campaign, tracks, previews)
    return DataError.exit_code if lacking else 0


def _say_what_follows(work: Workspace, campaign: Path, tracked: Collection[str], previews: Collection[str]) -> None:
    """What can be done with tracks: those of runs with a log go on one clock with it, others are looked at, and taken out."""
    runs = [work.campaign.experiment(name) for name in tracked]
    logged = [run.name for run in runs if not run.pressure.missing]
    if logged:
        alone = any(run.pressure.missing for run in work.active())
        return say_next("rfea sync", campaign, *(word for name in logged if alone for word in ("-e", name)))
    needed = "a model needs a log: 'pressure: {file: pressure.csv}' in experiment.yaml"
    if any(run.video is not None for run in runs) and not (previews or drawn_previews(work.out)):
        return say_next("rfea track", campaign, "--preview", why=f"draws the track over the film; {needed}")
    return say_next("rfea export", campaign, "OUT", "--csv", why=f"the tip over time; {needed}")


@click.command("sync")
@campaign_options
@experiment_option
def sync_command(campaign: Path, out: Path | None, force: bool, as_json: bool, names: tuple[str, ...]) -> None:
    """Track and pressure on one clock."""
    from rfea_vision.stages.measurement import facts_of_recording

    with opened(campaign, out, "sync", force=force, only=names) as work:
        recordings = work.each(names, work.recording_of, "synchronised")
        facts = {name: found.facts or facts_of_recording(found.value) for name, found in recordings.items()}
    summary = [
        {
            "experiment": name,
            "file": str(work.out / name / "recording.nc"),
            "status": work.outcome("sync", name),
            **facts[name],
        }
        for name in recordings
    ]
    if as_json:
        print_json({"recordings": summary})
        return
    if not up_to_date(work):
        rows = [
            [
                row["experiment"],
                row["method"],
                to_error(row["offset_s"] * 1e3, row["offset_stderr_s"] * 1e3),
                row["offset_stderr_s"] * 1e3,
                row.get("drift_ppm") or None,  # none was looked for, or none stood out of its error
            ]
            for row in summary
        ]
        print_table(
            "offset = log clock minus camera clock",
            ["experiment", "method", "offset ms", "std. error ms", "drift ppm"],
            rows,
            left=2,
        )
    say_next("rfea improve", campaign, why="or step by step: rfea fit, compare, diagnose")
