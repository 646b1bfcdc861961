"""Writes the bill of materials into the wheel: what the package was tested with, as CycloneDX 1.5 JSON.

Made from requirements.txt and pyproject.toml alone, with no time and no random number in it: the same source gives the
same bytes.
"""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

SBOM = "rfea_vision/data/sbom.cdx.json"


class CustomBuildHook(BuildHookInterface):
    """Adds the bill of materials to what is built."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Write the file and have it included; an editable install has none."""
        if version == "editable":
            return
        root = Path(self.root)
        core = self.metadata.core
        path = Path(tempfile.mkdtemp(prefix="rfea-sbom-")) / "sbom.cdx.json"
        pins = (root / "requirements.txt").read_text(encoding="utf-8")
        content = bill(core.name, self.metadata.version, core.license_expression or str(core.license), pins)
        path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
        build_data["force_include"][str(path)] = SBOM


def bill(name: str, version: str, licence: str, pins: str) -> dict[str, Any]:
    """Make the bill of materials from the pins of requirements.txt."""
    parts = []
    for line in pins.splitlines():
        pin = line.split("#")[0].split(";")[0].split("--hash")[0].strip(" \\")
        if "==" not in pin:
            continue
        part, number = (text.strip() for text in pin.split("=="))
        address = f"pkg:pypi/{part.lower().replace('_', '-')}@{number}"
        parts.append({"type": "library", "bom-ref": address, "name": part, "version": number, "purl": address})
    own = f"pkg:pypi/{name}@{version}"
    return {
        "$schema": "http://cyclonedx.org/schema/bom-1.5.schema.json",
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "version": 1,
        "metadata": {
            "component": {
                "type": "application",
                "bom-ref": own,
                "name": name,
                "version": version,
                "purl": own,
                "licenses": [{"expression": licence}],
            }
        },
        "components": parts,
        "dependencies": [{"ref": own, "dependsOn": [part["bom-ref"] for part in parts]}],
    }
