"""The paper from its parameters to its figures, on a short twin of its tube."""

import csv
import re
from dataclasses import replace

import pytest

from rfea_vision.campaign import load_campaign
from rfea_vision.dynamics.parameters import PUBLISHED
from rfea_vision.stages import Workspace
from rfea_vision.stages.reproducing import reproduce

pytest.importorskip("matplotlib")
pytest.importorskip("mujoco")


@pytest.fixture(scope="module")
def paper(tmp_path_factory):
    from rfea_vision.twin import paper_campaign, simulate

    folder = tmp_path_factory.mktemp("paper") / "twin"
    simulate(folder, replace(paper_campaign(), duration_s=2.5))
    return folder


@pytest.mark.study
def test_table_figures_and_page(paper):
    files = reproduce(Workspace(load_campaign(paper)), formats=["svg"])
    first = {path: path.read_bytes() for path in files}
    rows = list(csv.DictReader((files[0].parent / "table-1.csv").open()))
    assert len(rows) == 14
    for row in rows:
        assert float(row["published"]) == pytest.approx(getattr(PUBLISHED[row["model"]], row["parameter"]), rel=1e-5)
        if row["lower_95"]:
            assert float(row["lower_95"]) <= float(row["found"]) <= float(row["upper_95"])
    arm = next(row for row in rows if row["model"] == "8-DoF" and row["parameter"] == "r_hyd")
    assert float(arm["found"]) == pytest.approx(float(arm["published"]), rel=0.1)  # the twin is the 8-DoF tube
    names = {path.name[:5] for path in files if path.name.startswith("fig")}
    assert names == {f"fig{number:02d}" for number in range(4, 11)}
    page = first[files[0]].decode()
    assert page.count("<svg") == len({path.stem for path in files if path.name.startswith("fig")})
    assert not re.search(r'(?:src|href)="https?://', page)
    assert ("ended at a bound" in page) == any(not row["lower_95"] for row in rows)
    again = reproduce(Workspace(load_campaign(paper)), formats=["svg"])
    assert {path: path.read_bytes() for path in again} == first
