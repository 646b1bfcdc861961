"""The paper from its parameters to its figures, on a short twin of its tube."""

import csv
import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

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


def kept(folder: Path) -> dict[str, bytes]:
    """All that a campaign's folder holds, but for what is remembered of when its raw files were last changed."""
    files = (path for path in folder.rglob("*") if path.is_file() and path.name != "hashes.json")
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


def test_fitted_twice_it_is_twice_the_same_bytes(tmp_path):
    """Twin, fits, table, drawings and page, from nothing, at another place."""
    from rfea_vision.twin import paper_campaign, simulate

    found = []
    for place in ("here", "elsewhere/on a disk"):
        folder = tmp_path / place / "twin"
        simulate(folder, replace(paper_campaign(), duration_s=0.8, rate_Hz=60))
        reproduce(Workspace(load_campaign(folder)), formats=["svg"])
        found.append(kept(folder))
    assert found[0] == found[1]
    assert {"rfea/reproduce/index.html", "rfea/models/eight-bodies/prediction.nc"} <= found[0].keys()


@pytest.mark.study
def test_the_example_from_photos_and_films_to_its_page_is_twice_the_same_bytes(root, tmp_path):
    found = []
    for number, threads in (("0", "1"), ("1", "1"), ("2", "2")):  # as people would: another shell, other threads, another hour
        folder = tmp_path / f"person {number}" / "tube"
        shutil.copytree(root / "examples" / "hidden-effect", folder)
        own = {"PYTHONHASHSEED": number, "OMP_NUM_THREADS": threads, "OPENBLAS_NUM_THREADS": threads, "TZ": f"UTC-{number}"}
        command = [sys.executable, "-m", "rfea_vision", "reproduce", str(folder)]
        subprocess.run(command, env={**os.environ, **own}, check=True, capture_output=True)
        found.append(kept(folder))
    found = found[1:]  # the first may have compiled the loops, whose last bits may then be others than those of loops that were kept
    assert found[0].keys() == found[1].keys()
    assert [name for name, content in found[0].items() if content != found[1][name]] == []
    assert len([name for name in found[0] if name.startswith("rfea/reproduce/fig")]) == 56  # 14 drawings, as PDF, SVG, PNG and CSV


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
