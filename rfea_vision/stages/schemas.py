"""JSON Schema of every file that goes in or comes out."""

from __future__ import annotations

from pydantic import BaseModel

from rfea_vision.artefacts import Comparison, Diagnosis, Ladder, ModelFit
from rfea_vision.campaign.schema import CampaignFile, ExperimentFile
from rfea_vision.stages.recipes import Recipe

_FILES: dict[str, type[BaseModel]] = {
    "campaign.yaml": CampaignFile,
    "experiment.yaml": ExperimentFile,
    "recipe.yaml": Recipe,
    "model.json": ModelFit,
    "comparison.json": Comparison,
    "diagnosis.json": Diagnosis,
    "ladder.json": Ladder,
}


def schemas() -> dict[str, dict[str, object]]:
    """Return the schema of each file by its name."""
    return {
        name: {"$schema": "https://json-schema.org/draft/2020-12/schema", **model.model_json_schema(by_alias=True)}
        for name, model in _FILES.items()
    }
