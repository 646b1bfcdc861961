"""Mistakes of a beginner, each seeded into a campaign that is right: one true sentence names the place and the remedy."""

import pandas as pd
import pytest
from campaign.campaigns import write_campaign

from .console import rfea
from .mistakes import IN_COMMANDS, IN_FILES


@pytest.fixture
def campaign(tmp_path):
    return write_campaign(tmp_path / "tube-A")


def test_the_campaign_without_a_mistake_is_right(campaign):
    assert "0 errors, 0 warnings" in rfea("check", campaign).out


@pytest.mark.parametrize(("spoil", "code", "says"), [row[1:] for row in IN_FILES], ids=[row[0] for row in IN_FILES])
def test_a_mistake_in_a_file_is_told_with_its_remedy(campaign, spoil, code, says):
    spoil(campaign)
    answer = rfea("check", campaign)
    told = [line for line in answer.out.splitlines() if line.startswith(("error: ", "warning: "))]
    assert answer.code == code, answer.out
    assert len([line for line in told if says in line and str(campaign) in line]) == 1, told
    assert len(told) == 1 or "did you mean" not in says, told  # a misspelt key is not also a missing one
    assert answer.out.splitlines()[-1].startswith("next: rfea ") and "Traceback" not in answer.err


@pytest.mark.parametrize(("command", "says"), IN_COMMANDS, ids=[" ".join(command) for command, _ in IN_COMMANDS])
def test_a_mistake_in_a_command_is_told_before_anything_runs(campaign, command, says):
    answer = rfea(*(word.replace("CAMPAIGN", str(campaign)) for word in command))
    assert answer.code == 2 and says in answer.out + answer.err, answer
    assert "Traceback" not in answer.err and not (campaign / "rfea" / "models").exists()


def test_what_ails_every_run_alike_is_said_once(campaign):
    for run in ("steps", "sine"):
        path = campaign / run / "track.csv"
        table = pd.read_csv(path)
        table.rename(columns={"tip_x_mm": "tip_y_mm", "tip_y_mm": "tip_x_mm"}).to_csv(path, index=False)
    answer = rfea("check", campaign)
    assert answer.out.count("are x and y swapped?") == 1
    assert "(likewise steps)" in answer.out and "4 warnings" in answer.out, answer.out
