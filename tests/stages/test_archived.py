"""A film, or what a track was read from, that is gone once it was tracked."""

import shutil

from campaign.campaigns import write_campaign
from cli.console import rfea


def test_who_has_put_the_film_away_goes_on_from_a_copy_of_its_track(tmp_path):
    """Every command refused, and the tool's own track.nc was no track to it."""
    campaign = write_campaign(tmp_path / "c")
    assert rfea("sync", campaign).code == 0
    run, kept = campaign / "steps", campaign / "rfea" / "steps" / "track.nc"
    file, before = run / "experiment.yaml", kept.read_bytes()
    tracked = file.read_text()
    file.write_text(tracked.replace("track: {file: track.csv}", "video: {file: film.mp4}"))
    said = rfea("sync", campaign).err
    assert f"no file 'film.mp4' in {run}; " in said
    assert f"go on from its track: copy {kept} into {run} and write 'track: {{file: track.nc}}' in place of video" in said
    file.write_text(tracked.replace("track.csv", "rfea/steps/track.nc"))
    assert "track.file: 'track.nc' is in" in rfea("sync", campaign).err
    shutil.copy(kept, run / "track.nc")
    (run / "track.csv").unlink()
    file.write_text(tracked.replace("track.csv", "track.nc"))
    assert "0 errors" in rfea("check", campaign).out
    again = rfea("sync", campaign)
    assert again.code == 0 and "sync steps: unchanged" in again.err
    assert kept.read_bytes() == before
