"""Every command line that the documents show is run, in the order in which a reader would, on a small campaign."""

from __future__ import annotations

import shlex
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from rfea_vision.cli.root import run
from rfea_vision.critique import screening
from rfea_vision.effects.catalogue import catalogue
from rfea_vision.twin import TwinOptions, simulate
from tests.test_docs import ROOT, blocks, commands

#: What a line is not run for; everything else is.
LEFT_OUT = {
    "examples/hidden-effect": "is what `make demo` does",
    "--video": "films for a minute; the tests of the twin film",
}
#: What a page leaves to the reader's choice.
CHOSEN = {"CAMPAIGN": "tube-A", "MODEL": "base", "OUT": "out"}
#: What a critique chooses among here: that a line runs does not hang on how many effects there are, that of the whole catalogue is
#: tested with the commands.
EFFECTS = ("gravity_tilt", "maxwell", "payload")


#: Every line once, where it stands first.
LINES = list({line: (page, line) for page, line in reversed(commands()) if page != "commands.md"}.values())[::-1]


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A folder with a small campaign and the files that the pages speak of."""
    folder = tmp_path_factory.mktemp("desk")
    options = TwinOptions(
        hidden={"gravity_tilt.angle": -0.08},
        seed=7,
        roles=("train", "validate"),
        duration_s=1.5,
        rate_Hz=60.0,
        joints=10,
        write_truth=False,
    )
    simulate(folder / "tube-A", options)
    readme = ROOT / "README.md"
    (folder / "my_effect.py").write_text(blocks(readme, "py")[0], encoding="utf-8")
    (folder / "valves.csv").write_text(
        "time_s,supply,drain\n0,0,0\n0.5,1,0\n0.53,0,0\n0.8,0,1\n1,0,0\n", encoding="utf-8"
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        few = {name: catalogue()[name] for name in EFFECTS}
        patch.setattr(screening, "catalogue", lambda: few)
        yield folder


@pytest.mark.parametrize(("page", "line"), LINES)
def test_every_command_line_of_the_documents_runs(desk, page, line, capsys):
    for part, why in LEFT_OUT.items():
        if part in line:
            pytest.skip(f"{part} {why}")
    words = [CHOSEN.get(word, word) for word in shlex.split(line)[1:]]
    if words[0] == "init":
        words[1] = "another-tube"
    if words[0] == "simulate":
        words = [w for w in words if w]
        words += [] if "--like" in words else ["--duration", "1s", "--experiments", "1"]
        words[1] = f"{words[1]}-{len(list(desk.iterdir()))}"
    if words[0] in ("fit", "improve") and "--segments" not in words and "--paper" not in words:
        words += ["--segments", "4"]  # the page speaks of the line, not of how fine the chain is
    if words[0] == "open":
        serves_until_interrupted(words)
        return
    code = run(words)
    assert code == 0, f"{page}: {line}\n{capsys.readouterr().err}"


def serves_until_interrupted(words: list[str]) -> None:
    """Run a command that serves a page until Ctrl-C: it prints its address, and ends cleanly."""
    command = [sys.executable, "-m", "rfea_vision", *words, "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        try:
            address = server.stdout.readline()
            server.send_signal(signal.SIGINT)
            assert server.wait(timeout=60) == 0
        finally:
            server.kill()
    assert address.startswith("http://127.0.0.1:")
