"""What is proposed once the tracks have been drawn."""

import os
from types import SimpleNamespace

from rfea_vision.artefacts.judgement import UNCERTAIN
from rfea_vision.cli.model import _say_after


def test_a_preview_that_is_there_is_looked_at_and_not_drawn_again(tmp_path, capsys):
    """`rfea track --preview` was proposed after it had been run, and then had nothing to do."""
    judged = SimpleNamespace(outcome=UNCERTAIN, uncertain_because="the floor is high")
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
