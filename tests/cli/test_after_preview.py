"""Which tracks are drawn, and what is proposed once they have been."""

import os
from types import SimpleNamespace

from campaign.campaigns import write_campaign

from rfea_vision.artefacts.judgement import TRACK_UNCERTAIN, UNCERTAIN
from rfea_vision.cli.model import _say_after
from rfea_vision.stages import measurement
from rfea_vision.stages.stored import Stored

from .console import rfea


def test_a_preview_that_is_there_is_looked_at_and_not_drawn_again(tmp_path, capsys):
    """`rfea track --preview` was proposed after it had been run, and then had nothing to do."""
    judged = SimpleNamespace(outcome=UNCERTAIN, uncertain_because=TRACK_UNCERTAIN)
    track, preview = tmp_path / "run" / "track.nc", tmp_path / "run" / "preview.mp4"
    track.parent.mkdir()
    track.touch()
    _say_after(judged, tmp_path, tmp_path)
    assert "rfea track" in capsys.readouterr().out
    preview.touch()
    _say_after(judged, tmp_path, tmp_path)
    assert "next: look at" in (told := capsys.readouterr().out) and "preview.mp4" in told and "rfea track" not in told
    os.utime(preview, (1.0, 1.0))  # of an earlier track
    _say_after(judged, tmp_path, tmp_path)
    assert "rfea track" in capsys.readouterr().out


def test_one_broken_run_does_not_keep_the_others_from_being_drawn(tmp_path, monkeypatch):
    """They were tracked, and none had a preview until the broken one was set aside."""
    campaign, drawn = write_campaign(tmp_path / "c", {"one": "train", "two": "train", "three": "validate"}), []
    (campaign / "one" / "track.csv").write_text("time_s,tip_x_mm\n0,1\n")
    monkeypatch.setattr(measurement, "preview", lambda work, run: Stored.of(drawn.append(run.name) or work.out))
    answer = rfea("track", campaign, "-e", "one", "-e", "two", "-e", "three", "--preview")
    assert answer.code == 2 and "(2 of 3 experiments were tracked; " in answer.err
    assert drawn == ["two", "three"]


def test_runs_without_any_log_have_a_page_of_their_motion(tmp_path):
    """A lab that films and logs nothing was told to name a pressure, and had no page."""
    campaign = write_campaign(tmp_path / "c")
    for file in campaign.glob("*/experiment.yaml"):
        lines = file.read_text().splitlines(keepends=True)
        file.write_text("".join(line for line in lines if not line.startswith(("pressure", "sync"))))
    assert rfea("report", campaign).code == 0
    page = (campaign / "rfea" / "report" / "index.html").read_text(encoding="utf-8")
    assert "The motion is measured; no model has been fitted yet." in page and "/track.nc" in page
    assert "legend" in page and "recording.nc" not in page.partition("Tables and figures")[2].partition("</section>")[0]
    again = rfea("report", campaign)
    assert again.code == 0 and "nothing changed" in again.out
