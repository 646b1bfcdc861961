"""One campaign that is open: its artefacts as the page wants them, and the player of its models."""

from __future__ import annotations

import threading
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from rfea_vision.artefacts import ModelFit
from rfea_vision.campaign import Campaign, ExperimentSpec, Reading, load_campaign, read_campaign
from rfea_vision.campaign.loading import OUTPUT_FOLDER
from rfea_vision.errors import InputError
from rfea_vision.report.collect import Evidence, collect
from rfea_vision.workbench.evidence import DRAWN, evidence_packet, stamps
from rfea_vision.workbench.loading import loaded
from rfea_vision.workbench.state import runs_of

if TYPE_CHECKING:
    from rfea_vision.workbench.play import Chosen, Player


class OpenedCampaign:
    """Reads the results of a campaign anew when they have changed."""

    def __init__(self, folder: Path, out: Path | None) -> None:
        self.folder = folder
        self.out = out if out is not None else folder / OUTPUT_FOLDER
        self._lock = threading.Lock()
        self._read: tuple[object, Evidence, bytes] | None = None
        self._reading: tuple[object, Reading] | None = None
        self._player: tuple[object, Player] | None = None

    def evidence(self) -> tuple[Evidence, bytes]:
        """The artefacts, and the packet that the page draws."""
        runs = None
        with suppress(InputError):  # of a campaign that is being mended, all that there is
            runs = [item.name for item in self.campaign().experiments if item.role != "ignore"]
        with self._lock:
            age = (runs, stamps(self.out, *DRAWN))
            if self._read is None or self._read[0] != age:
                evidence = collect(self.out, runs)
                self._read = (age, evidence, evidence_packet(evidence, self.folder.name))
            return self._read[1], self._read[2]

    def campaign(self) -> Campaign:
        """The campaign as its files now say.

        Raises
        ------
        InputError
            If they cannot be read.
        """
        reading = self._read_files()
        if reading.campaign is None or _errors(reading):
            return load_campaign(self.folder, self.out)  # which says what is wrong
        return reading.campaign

    def as_far_as_read(self) -> Campaign:
        """The campaign as its files now say, though some of what they say be wrong: one may still point at its films.

        Raises
        ------
        InputError
            If nothing of it can be read.
        """
        return self._read_files().campaign or self.campaign()

    def _read_files(self) -> Reading:
        age = stamps(self.folder, "campaign.yaml", "experiment.yaml", "*/experiment.yaml")
        with self._lock:
            # what is wrong may be mended elsewhere than in these files: a film that was lacking is there
            if self._reading is None or self._reading[0] != age or _errors(self._reading[1]):
                self._reading = (age, read_campaign(self.folder, self.out))
            return self._reading[1]

    def experiment(self, number: int) -> ExperimentSpec:
        """An experiment by its number on the page: those with the role `ignore` are not counted, those with mistakes are.

        Raises
        ------
        InputError
            If there is none of this number.
        """
        active = runs_of(self._read_files())
        if not 0 <= number < len(active):
            raise InputError(f"{self.folder}: has no experiment {number + 1}")
        return active[number]

    def player(self) -> Player:
        """The player of the recordings as they now are."""
        evidence, _ = self.evidence()
        with self._lock:
            age = (sorted(item.name for item in evidence.experiments), stamps(self.out, "*/recording.nc"))
            if self._player is None or self._player[0] != age:
                self._player = age, loaded("workbench.play").Player({item.name: item for item in evidence.experiments})
            return self._player[1]

    def chosen(self, model: str, effects: tuple[str, ...], files: tuple[Path, ...]) -> Chosen:
        """A model to play with.

        Raises
        ------
        InputError
            If there is no such model.
        """
        known = {file.parent.name: file for file in self.out.glob("models/*/model.json")}
        if model not in known:
            raise InputError(f"{model}: no such model yet; 'rfea fit' makes one")
        return loaded("workbench.play").Chosen(load_fit(known[model], known[model].stat().st_mtime_ns), effects, files)


def _errors(reading: Reading) -> bool:
    return any(problem.severity == "error" for problem in reading.problems)


@lru_cache(maxsize=32)
def load_fit(file: Path, changed: int) -> ModelFit:
    """A model, read once as long as its file does not change."""
    return ModelFit.load(file)
