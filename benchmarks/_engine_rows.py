"""Rows of the engine's benchmark that need more than the engine: JAX, a C compiler."""

from __future__ import annotations

import ctypes
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from rfea_vision.dynamics.realtime import Stepper
from rfea_vision.dynamics.simulation import Excitation, Model
from rfea_vision.export import c_files
from rfea_vision.export.fmu import build_library, compiler

Timer = Callable[[Callable[[], Any], int], float]
TARGET_TIMES_JAX = 20


def jax_rows(
    model: Model, par: np.ndarray, run: Excitation, frames: np.ndarray, tips_fine: np.ndarray, timer: Timer
) -> list[dict[str, Any]]:
    """Same scheme, same tube in JAX: as few Newton iterations as stay within 0.01 mm at the tip."""
    name = "time of JAX over ours at the same tip error"
    try:
        import jax

        from testing import in_jax
    except ImportError:
        note = "JAX is not installed; pip install jax, then make benchmarks ONLY=engine"
        return [{"name": name, "value": "not run", "unit": "", "target": TARGET_TIMES_JAX, "against": note}]
    from rfea_vision.artefacts import Actuator
    from rfea_vision.dynamics.motion import Motion

    tube = in_jax.chain_numbers(model._bodies(par)[0], Actuator(), float(model.chain.arc[0]), model.gravity)
    rest = model.steady(par, float(run.pressure[0])).phi[1:]
    place = (frames - run.start_s) / run.step_s
    for iterations in (1, 2, 3, 4):

        def plain(count: int = iterations) -> Any:
            return in_jax.run(par, tube, rest, run.pressure, run.step_s, count).block_until_ready()

        angles = np.asarray(plain())
        grid = np.arange(len(angles))
        phi = np.column_stack([np.zeros(frames.size), *(np.interp(place, grid, column) for column in angles.T)])
        none = np.zeros((frames.size, phi.shape[1], 0))
        motion = Motion(0, "", phi, np.zeros_like(phi), np.zeros((frames.size, 8, 1)), none, np.zeros(0, np.int64))
        tips = model.centre_line(motion, np.array([1.0]))[0][:, 0]
        # Frames between the steps are read off linearly here: what counts is the error at the steps.
        on_step = np.abs(place - np.round(place)) < 1e-6
        error = float(np.linalg.norm(tips - tips_fine, axis=-1)[on_step].max() * 1e3)
        if error <= 0.01:
            break

    def forward() -> Any:
        return in_jax.sensitivities(par, tube, rest, run.pressure, run.step_s, iterations).block_until_ready()

    begun = time.perf_counter()
    forward()
    first = time.perf_counter() - begun
    theirs, with_seven = timer(plain, 3), timer(forward, 2)
    ours, ours_seven = (timer(lambda f=f: model.simulate(par, run, frames, f), 5) for f in ((), range(7)))
    return [
        {
            "name": name,
            "value": round(theirs / ours, 1),
            "unit": "",
            "target": TARGET_TIMES_JAX,
            "met": bool(theirs / ours >= TARGET_TIMES_JAX),
            "against": f"JAX {jax.__version__}: {theirs:.3f} s, {error:.4f} mm, {iterations} Newton iterations a stage",
        },
        {
            "name": "with 7 sensitivities, time of JAX over ours",
            "value": round(with_seven / ours_seven, 1),
            "unit": "",
            "against": f"JAX {jax.__version__}, jacfwd: {with_seven:.2f} s, and {first:.0f} s to compile the first time",
        },
    ]


def step_rows(model: Model, par: np.ndarray, run: Excitation) -> list[dict[str, Any]]:
    """Processor time of one step of 1 ms, in Python and as exported C: median, and what one in a thousand exceeds."""
    pressures = run.pressure[:5000].tolist()
    stepper = Stepper(model, par, run.step_s, pressure_Pa=pressures[0])
    calls: dict[str, Callable[[float], Any]] = {"Python": stepper.step}
    with tempfile.TemporaryDirectory() as folder:
        if compiler() is not None:
            header, source = c_files(model, par, "tube", run.step_s)
            (Path(folder) / "tube.h").write_text(header)
            (Path(folder) / "tube.c").write_text(source)
            build_library(Path(folder) / "tube.c", Path(folder) / "tube.so")
            library = ctypes.CDLL(str(Path(folder) / "tube.so"))
            state, seen = (ctypes.c_double * 20000)(), (ctypes.c_double * 4)()
            library.tube_init.argtypes = [ctypes.c_void_p, ctypes.c_double, ctypes.c_void_p]
            library.tube_step.argtypes = library.tube_init.argtypes
            library.tube_init(state, pressures[0], seen)
            calls["exported C"] = lambda pressure: library.tube_step(state, pressure, seen)
        rows = []
        for name, call in calls.items():
            spent = []
            for pressure in pressures:
                begun = time.thread_time()
                call(pressure)
                spent.append(time.thread_time() - begun)
            median, slow = (float(np.quantile(spent, share)) * 1e3 for share in (0.5, 0.999))
            rows.append(
                {
                    "name": f"one step of 1 ms, n = {model.chain.bodies}: {name}",
                    "value": round(median, 4),
                    "unit": "ms",
                    "target": 1.0,
                    "met": bool(slow <= 1.0),
                    "against": f"99.9 % of the steps within {slow:.3f} ms; the budget is the step itself",
                }
            )
    return rows
