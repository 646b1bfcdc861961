"""A fit as an RO-Crate: its files with hashes, what it was made from, with what, and what came out.

RO-Crate 1.1 (https://w3id.org/ro/crate/1.1): a folder with a JSON-LD file that describes all others. Raw inputs are described by their
hashes and not copied: films are large, and the campaign keeps them.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterable, Mapping
from pathlib import Path
from urllib.parse import quote

from rfea_vision.artefacts import ModelFit
from rfea_vision.artefacts.judgement import Parameter
from rfea_vision.files import sha256_of, write_text
from rfea_vision.units import counted

_Entity = Mapping[str, object]
_CONTEXT = "https://w3id.org/ro/crate/1.1/context"
_PROFILE = "https://w3id.org/ro/crate/1.1"
_PAPER = {
    "@id": "#paper", "@type": "ScholarlyArticle", "author": "M. Momeni Kelageri et al.",
    "name": "Kinematics and Dynamic Modeling of a Planar Hydraulic Elastomer Actuator",
}  # fmt: skip
_KINDS = {".json": "application/json", ".nc": "application/x-netcdf", ".yaml": "application/yaml", ".csv": "text/csv"}


def write_crate(
    folder: Path,
    fit: ModelFit,
    files: Mapping[str, Path],
    *,
    name: str,
    made_on: str,
    versions: Iterable[tuple[str, str]],
) -> Path:
    """Write the crate.

    Parameters
    ----------
    folder : the crate; files in it of the same names are replaced
    fit : the model
    files : what is copied into the crate, by path inside it
    name : of the campaign
    made_on : day of the crate, ISO 8601; the same fit gives the same bytes on one day
    versions : names and versions of the software that made it

    Returns
    -------
    Path
        ``ro-crate-metadata.json``.
    """
    parts = [_copied(folder, inside, path) for inside, path in files.items()]
    raw = [
        {"@id": f"#raw/{quote(path)}", "@type": "CreativeWork", "name": path, "sha256": digest,
         "description": "raw input, kept in the campaign's folder"}
        for path, digest in sorted(fit.inputs.items())
    ]  # fmt: skip
    values = [_value(key, item) for key, item in fit.parameters.items()]
    tools = [
        {"@id": f"#software/{quote(tool)}", "@type": "SoftwareApplication", "name": tool, "version": version}
        for tool, version in versions
    ]
    made = {
        "@id": "#fit", "@type": "CreateAction", "name": f"fit of {fit.name}", "description": fit.message,
        "object": _references(raw), "result": _references(parts), "instrument": _references(tools),
    }  # fmt: skip
    root = {
        "@id": "./", "@type": "Dataset", "name": f"{name}: {fit.name}", "datePublished": made_on,
        "description": f"The RSDA model fitted to {name}, {counted(fit.segments, 'segment')}"
        + (f", with {', '.join(fit.effects)}" if fit.effects else "") + ".",
        "hasPart": _references(parts), "mentions": _references([made]), "variableMeasured": _references(values),
        "citation": _references([_PAPER])[0], "license": "the owner of the data decides",
    }  # fmt: skip
    about = {
        "@id": "ro-crate-metadata.json", "@type": "CreativeWork", "about": {"@id": "./"}, "conformsTo": {"@id": _PROFILE},
    }  # fmt: skip
    page = {"@context": _CONTEXT, "@graph": [about, root, *parts, *raw, *values, *tools, made, _PAPER]}
    path = folder / "ro-crate-metadata.json"
    write_text(path, json.dumps(page, indent=1, ensure_ascii=False) + "\n")
    return path


def _copied(folder: Path, inside: str, path: Path) -> _Entity:
    """A file that is copied into the crate, as it is described there."""
    target = folder / inside
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(path, target)
    kind = _KINDS.get(path.suffix, "application/octet-stream")
    return {
        "@id": quote(inside), "@type": "File", "name": Path(inside).name, "encodingFormat": kind,
        "contentSize": str(target.stat().st_size), "sha256": sha256_of(target),
    }  # fmt: skip


def _value(name: str, item: Parameter) -> _Entity:
    """A parameter with its unit and, where it has one, its interval."""
    found: dict[str, object] = {"@id": f"#parameter/{quote(name)}", "@type": "PropertyValue", "name": name}
    found |= {"value": item.value, "unitText": item.unit}
    if item.interval_95:
        low, high = item.interval_95
        found |= {"minValue": low, "maxValue": high, "description": "95 % interval"}
    return found


def _references(entities: Iterable[_Entity]) -> list[_Entity]:
    """What stands for entities where others refer to them."""
    return [{"@id": entity["@id"]} for entity in entities]
