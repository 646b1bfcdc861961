"""A few kills at random moments; ``make benchmarks ONLY=kills`` makes 200."""

from __future__ import annotations

from pathlib import Path

from testing.kills import kill_often
from tests.campaign.campaigns import write_campaign


def test_a_killed_command_run_again_ends_as_if_nothing_had_been(tmp_path: Path) -> None:
    found = kill_often("track", write_campaign(tmp_path / "campaign"), range(2))
    assert [kill for kill in found if kill.different or kill.half_written or kill.redone] == []
    assert len(found) == 2
