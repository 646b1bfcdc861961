"""One campaign that is open: its artefacts as the page wants them, and the player of its models."""

from __future__ import annotations

import threading
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from rfea_vision.artefacts import ModelFit
from rfea_vision.campaign import Campaign, ExperimentSpec, load_campaign
from rfea_vision.campaign.loading import OUTPUT_FOLDER
from rfea_vision.errors import InputError
from rfea_vision.report.collect import Evidence, collect
from rfea_vision.workbench.evidence import DRAWN, evidence_packet, stamps
from rfea_vision.workbench.loading import loaded

if TYPE_CHECKING:
    from rfea_vision.workbench.play import Chosen, Player


class OpenedCampaign:
    """Reads the results of a campaign anew when they have changed."""

    def __init__(self, folder: Path, out: Path | None) -> None:
        self.folder = folder
        self.out = out if out is not None else folder / OUTPUT_FOLDER
        self._lock = threading.Lock()
        self._read: tuple[object, Evidence, bytes] | None = None
        self._campaign: tuple[object, Campaign] | None = None
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
        age = stamps(self.folder, "campaign.yaml", "experiment.yaml", "*/experiment.yaml")
        with self._lock:
            if self._campaign is None or self._campaign[0] != age:
                self._campaign = (age, load_campaign(self.folder, self.out))
            return self._campaign[1]

    def experiment(self, number: int) -> ExperimentSpec:
        """An experiment by its number on the page: those with the role `ignore` are not counted.

        Raises
        ------
        InputError
            If there is none of this number.
        """
        active = [item for item in self.campaign().experiments if item.role != "ignore"]
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


@lru_cache(maxsize=32)
def load_fit(file: Path, changed: int) -> ModelFit:
    """A model, read once as long as its file does not change."""
    return ModelFit.load(file)
