"""A law ready to run: derived once, kept as source in the user's cache folder, compiled by Numba.

What is derived of a law is kept under a hash of the effects' sources, so a law is derived once per machine. Its compiled
loops are kept under a hash of their own text: laws that differ only in what is evaluated once a run (mass, gravity, clamp,
line, camera, clock) share them, and so do the same effects in another order.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib.util
import inspect
import os
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import platformdirs

from rfea_vision.dynamics.system import FIXED
from rfea_vision.effects import base
from rfea_vision.files import write_text
from rfea_vision.loops import one_at_a_time

if TYPE_CHECKING:
    from rfea_vision.effects.base import Effect

#: What the folder may hold, in bytes. A law takes about 0.1 MB with its compiled loops, and a campaign some hundred laws.
MOST_BYTES = 200_000_000


class Loops(NamedTuple):
    """What is compiled of a law: joints, their derivatives by the parameters, hidden states at rest, forces on the bodies."""

    joint_law: Any
    joint_law_parameters: Any
    relaxed_states: Any
    body_force: Any


@dataclass(frozen=True)
class CompiledLaw:
    """A law ready to run: compiled joint law and body force, and NumPy functions for what is evaluated once a run.

    Each hook that is evaluated once a run is an attribute by its name: a function of (par, con, *its own symbols) that
    returns the value(s) with the derivatives with respect to every parameter behind them. `active` are those of these
    hooks that an effect changes. `effects` are in the order of the parameters. `chambers` are those with effects of their
    own: `line` has what these make of the hooks.
    """

    effects: tuple[str, ...]
    parameters: tuple[str, ...]
    state_count: int
    loops: Loops
    once: ModuleType
    has_body_force: bool
    has_added_mass: bool
    active: frozenset[str]
    chambers: tuple[str, ...]

    def __getattr__(self, hook: str) -> Callable[..., Any]:
        if hook.startswith("_") or hook not in base.HOOKS:
            raise AttributeError(hook)
        return getattr(self.once, hook)

    def line(self, hook: str, chamber: str) -> Callable[..., Any]:
        """What a hook is in the line of one chamber, by that chamber's own effects."""
        return getattr(self.once, f"{hook}_{self.chambers.index(chamber)}")

    def changes(self, *hooks: str) -> bool:
        """Whether an effect changes one of these hooks."""
        return not self.active.isdisjoint(hooks)

    @property
    def columns(self) -> int:
        """How many values and derivatives the joint law gives for each joint; their order is told in `system`."""
        return FIXED + 5 * self.state_count + self.state_count**2


def _cache_folder() -> Path:
    folder = Path(os.environ.get("RFEA_CACHE_DIR") or platformdirs.user_cache_dir("rfea")) / "laws"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except OSError:
        return Path(tempfile.mkdtemp(prefix="rfea-laws-"))


@cache
def _prune(folder: Path) -> None:
    """Remove what was used longest ago until the folder holds `MOST_BYTES`, once a process: what is missing is derived again."""
    files = []
    for path in (*folder.glob("*.py"), *folder.glob("__pycache__/*")):
        with contextlib.suppress(OSError):  # another process prunes, too
            state = path.stat()
            files.append((max(state.st_atime, state.st_mtime), state.st_size, path))
    excess = sum(size for _, size, _ in files) - MOST_BYTES
    for _, size, path in sorted(files):
        if excess <= 0:
            return
        with contextlib.suppress(OSError):
            path.unlink(missing_ok=True)
        excess -= size


def _key(effects: Sequence[Effect]) -> str:
    digest = hashlib.sha256()
    here, hooks = Path(__file__).parent, Path(base.__file__).parent
    for file in (
        here / "laws.py",
        here / "generation.py",
        here / "formulas.py",
        here / "compilation.py",
        hooks / "base.py",
        hooks / "hooks.py",
    ):
        digest.update(file.read_bytes())
    digest.update(version("sympy").encode())
    for effect in effects:
        kind = type(effect)
        digest.update(f"{effect.id} {effect.form} {kind.__module__} {kind.__qualname__}".encode())
        # A form inherits from its effect, and one of a person's file from any.
        for one in kind.__mro__[: kind.__mro__.index(base.Effect)]:
            digest.update(_source(one))
    return digest.hexdigest()[:24]


def _source(kind: type[Effect]) -> bytes:
    """The whole file in which an effect is declared: its law may call what stands beside it."""
    return kind.source_text.encode() if kind.source_text else Path(inspect.getfile(kind)).read_bytes()


def _load(path: Path) -> ModuleType:
    name = f"rfea_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise ImportError(path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # Numba's cache looks its functions up by module name
    spec.loader.exec_module(module)
    return module


def compile_law(effects: Sequence[Effect] = ()) -> CompiledLaw:
    """Compose, differentiate and compile; from the cache where this has been done before.

    Raises
    ------
    InputError
        A law with symbols the hook does not offer, or one that cannot be differentiated.
    """
    key = _key(effects)
    if key not in _compiled:
        _compiled[key] = _compile(effects, key)
    return _compiled[key]


_compiled: dict[str, CompiledLaw] = {}
_loops: dict[str, Any] = {}


def _compile(effects: Sequence[Effect], key: str) -> CompiledLaw:
    folder = _cache_folder()
    path = folder / f"law_{key}.py"
    with one_at_a_time(folder / f"{key[0]}.lock"):  # sixteen of them: few wait for another law
        if not path.exists():
            _derive(effects, path)
        once = _load(path)
        if not all((folder / f"{module}.py").exists() for module in once.LOOPS.values()):
            _derive(effects, path)
            once = _load(path)
    loops = {name: _loop(folder / f"{module}.py", name) for name, module in once.LOOPS.items()}
    return CompiledLaw(loops=Loops(**loops), once=once, **once.FACTS)


def _derive(effects: Sequence[Effect], path: Path) -> None:
    """Write what is derived of a law, and the loops that are not there yet: Numba keeps compiled code by the age of the file."""
    # SymPy takes half a second to import, and is not needed for a law that is in the cache.
    from rfea_vision.dynamics.generation import generate, generate_numpy
    from rfea_vision.dynamics.laws import compose

    _prune(path.parent)
    law = compose(effects)
    modules = {}
    for name, text in generate(law).items():
        modules[name] = f"{name}_{hashlib.sha256(text.encode()).hexdigest()[:24]}"
        loop = path.with_name(f"{modules[name]}.py")
        if not loop.exists():
            write_text(loop, text)
    write_text(path, generate_numpy(law, modules))


def _loop(path: Path, name: str) -> Any:
    if path.stem not in _loops:
        with one_at_a_time(path.with_name(f"{path.stem[-1]}.lock")):
            _loops[path.stem] = _with_known_addresses(getattr(_load(path), name))
    return _loops[path.stem]


def _with_known_addresses(loop: Any) -> Any:
    """The loop, whose addresses Numba looks up once: at every call that is handed it, that takes three quarters of a steady state."""
    loop.get_compile_result = cache(loop.get_compile_result)
    for result in loop.overloads.values():
        result.library.get_pointer_to_function = cache(result.library.get_pointer_to_function)
    return loop


def constants(
    count: float,
    outer_radius: float,
    inner_radius: float,
    fluid_density: float,
    tube_length: float,
    mirror: float,
    offset: float,
    bore_offset: float,
    linear_density: float,
    opposed: float = 0.0,
) -> np.ndarray:
    """The vector (10,) of constants, SI, in the order of `laws.CONSTANTS`; the last varies within a run of several chambers."""
    tube = (count, outer_radius, inner_radius, fluid_density, tube_length, mirror, offset, bore_offset, linear_density)
    return np.array([*tube, opposed])
