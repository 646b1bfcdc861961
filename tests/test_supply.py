"""What is shipped: wheels that are the same byte by byte, with a bill of materials that names what was tested."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from packaging.utils import canonicalize_name

_BUILD = "import sys; from hatchling.build import build_wheel; print(build_wheel(sys.argv[1]))"
_SOURCE = (
    "rfea_vision",
    "calib",
    "pipelines",
    "examples",
    "pyproject.toml",
    "README.md",
    "LICENSE",
    "requirements.txt",
    "hatch_build.py",
)


def _built(root: Path, folder: Path, mask: int) -> Path:
    """A wheel from a copy of the source, made at another place, another time and with other permissions."""
    source = folder / "source"
    source.mkdir(parents=True)
    for name in reversed(_SOURCE) if mask else _SOURCE:
        if (root / name).is_dir():
            shutil.copytree(
                root / name, source / name, ignore=shutil.ignore_patterns("__pycache__"), copy_function=shutil.copyfile
            )
        else:
            shutil.copyfile(root / name, source / name)
    environment = {**os.environ, "SOURCE_DATE_EPOCH": "1700000000", "TZ": "UTC" if mask else "Asia/Tokyo"}
    done = subprocess.run(
        [sys.executable, "-c", _BUILD, str(folder)],
        cwd=source,
        env=environment,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    return folder / done.stdout.split()[-1]


def test_a_wheel_is_the_same_byte_by_byte_and_says_what_it_was_tested_with(root: Path, tmp_path: Path) -> None:
    first, second = (_built(root, tmp_path / f"at-{mask}", mask) for mask in (0, 1))
    assert first.read_bytes() == second.read_bytes()
    with zipfile.ZipFile(first) as wheel:
        bill = json.loads(wheel.read("rfea_vision/data/sbom.cdx.json"))
        carried = {name for name in wheel.namelist() if name.startswith("rfea_vision/data/examples/")}
    example = root / "examples" / "hidden-effect"  # so that 'rfea demo' needs no checkout
    files = [path for path in example.rglob("*") if path.is_file() and "rfea" not in path.relative_to(example).parts]
    assert carried >= {
        f"rfea_vision/data/examples/hidden-effect/{path.relative_to(example).as_posix()}" for path in files
    }
    assert "rfea_vision/data/examples/hidden-effect-truth.json" in carried and len(files) > 10
    pins = [line.partition("==")[0] for line in (root / "requirements.txt").read_text().splitlines() if "==" in line]
    assert bill["bomFormat"] == "CycloneDX" and bill["metadata"]["component"]["name"] == "rfea-vision"
    assert [part["name"] for part in bill["components"]] == pins
    assert all(part["purl"].startswith("pkg:pypi/") and part["version"] for part in bill["components"])


@pytest.mark.parametrize("pins", ["requirements", "requirements-dev"])
def test_every_pin_has_its_hashes(root: Path, pins: str) -> None:
    """Names no host, and may be given to pip with --require-hashes; made again by the command in SECURITY.md."""
    lines = (root / f"{pins}.txt").read_text().splitlines()
    wanted = {
        canonicalize_name(line.partition("==")[0]): line.partition("==")[2].split()[0] for line in lines if "==" in line
    }
    found: dict[str, str] = {}
    hashes: dict[str, int] = {}
    for line in (root / f"{pins}.lock").read_text().splitlines():
        if match := re.fullmatch(r"([\w.-]+)==(\S+)(?: ;.*?)? \\", line):
            name = canonicalize_name(match[1])
            found[name] = match[2]
        else:
            assert re.fullmatch(r"    --hash=sha256:[0-9a-f]{64}(?: \\)?", line), line
            hashes[name] = hashes.get(name, 0) + 1
    assert wanted.items() <= found.items(), f"the pins changed: make {pins}.lock again (SECURITY.md)"
    assert all(hashes.get(name) for name in found)
