"""An FMU (FMI 2.0, co-simulation) of a fitted model: a zip of its description, its C sources and a library for this system.

Source: Functional Mock-up Interface for Model Exchange and Co-Simulation, version 2.0.
"""

from __future__ import annotations

import hashlib
import io
import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
import zipfile
from importlib.resources import files
from pathlib import Path
from xml.sax.saxutils import quoteattr

from rfea_vision.arrays import FloatArray
from rfea_vision.dynamics.realtime import NEWTON_ITERATIONS
from rfea_vision.dynamics.simulation import Model
from rfea_vision.errors import DataError
from rfea_vision.export.c_source import c_files, filled, one_line

_OUTPUTS = (
    ("tip_x_m", "m", "tip of the centre line, to the camera's right of the clamp"),
    ("tip_y_m", "m", "tip of the centre line, above the clamp"),
    ("angle_rad", "rad", "direction of the tip, 0 hanging, positive towards the bend"),
    ("flow_m3_s", "m3/s", "flow into the tube"),
    ("last_change_rad", "rad", "what the last Newton iteration of the last step still changed"),
)
_UNITS = {"Pa": 'kg="1" m="-1" s="-2"', "m": 'm="1"', "rad": 'rad="1"', "m3/s": 'm="3" s="-1"'}


def compiler() -> list[str] | None:
    """The C compiler of this machine, as words: what the variable CC says, else cc, gcc or clang; None if there is none."""
    said = [shlex.split(os.environ.get("CC", "")), ["cc"], ["gcc"], ["clang"]]
    return next(([found, *words[1:]] for words in said if words and (found := shutil.which(words[0]))), None)


def build_library(source: Path, target: Path) -> None:
    """Compile one C file to a shared library.

    Raises
    ------
    DataError
        There is no compiler, or it refuses the file.
    """
    program = compiler()
    if program is None:
        raise DataError("export: no C compiler found; install one (gcc or clang), or name it in the variable CC")
    command = [*program, "-std=c99", "-O2", "-shared", "-fPIC", "-o", str(target), str(source), "-lm"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        said = next(iter(done.stderr.strip().splitlines()), f"exit code {done.returncode}")
        raise DataError(f"export: {Path(program[0]).name} refuses {source.name}: {said}")


def _platform() -> tuple[str, str]:
    """Folder of this system in an FMU, and the suffix of its libraries."""
    bits = "64" if sys.maxsize > 2**32 else "32"
    if sys.platform == "win32":
        return f"win{bits}", ".dll"
    if sys.platform == "darwin":
        return f"darwin{bits}", ".dylib"
    machine = platform.machine()
    return (f"linux{bits}" if machine in ("x86_64", "i686", "i386") else f"{machine}-linux"), ".so"


def _description(name: str, guid: str, step_s: float, about: str) -> str:
    """`modelDescription.xml`."""
    units = "".join(f'    <Unit name="{unit}"><BaseUnit {base}/></Unit>\n' for unit, base in _UNITS.items())
    variables = (
        '    <ScalarVariable name="pressure_Pa" valueReference="0" causality="input" variability="continuous" '
        'description="gauge pressure at the end of the communication step"><Real unit="Pa" start="0"/></ScalarVariable>\n'
    )
    for index, (variable, unit, text) in enumerate(_OUTPUTS, 1):
        variables += (
            f'    <ScalarVariable name="{variable}" valueReference="{index}" causality="output" variability="continuous" '
            f'initial="calculated" description={quoteattr(text)}><Real unit="{unit}"/></ScalarVariable>\n'
        )
    unknowns = "".join(f'      <Unknown index="{index}"/>\n' for index in range(2, len(_OUTPUTS) + 2))
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="{name}" guid="{guid}" description={quoteattr(one_line(about))}
    generationTool="rfea-vision" variableNamingConvention="flat" numberOfEventIndicators="0">
  <CoSimulation modelIdentifier="{name}" canHandleVariableCommunicationStepSize="true">
    <SourceFiles><File name="fmu.c"/><File name="{name}.c"/></SourceFiles>
  </CoSimulation>
  <UnitDefinitions>
{units}  </UnitDefinitions>
  <DefaultExperiment stepSize="{step_s!r}"/>
  <ModelVariables>
{variables}  </ModelVariables>
  <ModelStructure>
    <Outputs>
{unknowns}    </Outputs>
    <InitialUnknowns>
{unknowns}    </InitialUnknowns>
  </ModelStructure>
</fmiModelDescription>
"""


def fmu_content(model: Model, par: FloatArray, name: str, step_s: float, about: str = "", iterations: int = NEWTON_ITERATIONS) -> bytes:
    """The FMU as the content of its file; arguments as for `c_files`.

    Raises
    ------
    InputError
        An effect that cannot be exported.
    DataError
        There is no C compiler for the library.
    """
    header, source = c_files(model, par, name, step_s, about, iterations)
    guid = "{" + hashlib.sha256((header + source).encode()).hexdigest()[:32] + "}"
    words = {"NAME": name, "NAME_UPPER": name.upper(), "STEP_S": repr(float(step_s)), "GUID": guid}
    wrapper = filled(files("rfea_vision.export").joinpath("fmu.c").read_text(encoding="utf-8"), words)
    sources = {f"{name}.h": header, f"{name}.c": source, "fmu.c": wrapper}
    place, suffix = _platform()
    with tempfile.TemporaryDirectory() as folder:
        for file, text in sources.items():
            (Path(folder) / file).write_text(text, encoding="utf-8")
        both = Path(folder) / "both.c"
        both.write_text(f'#include "{name}.c"\n#include "fmu.c"\n', encoding="utf-8")
        build_library(both, Path(folder) / f"{name}{suffix}")
        library = (Path(folder) / f"{name}{suffix}").read_bytes()
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("modelDescription.xml", _description(name, guid, step_s, about))
        archive.writestr(f"binaries/{place}/{name}{suffix}", library)
        for file, text in sources.items():
            archive.writestr(f"sources/{file}", text)
    return content.getvalue()
