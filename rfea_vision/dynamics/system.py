"""What the compiled code works on: the chain with one set of parameters, and its working space. Legend as in `engine`."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numba import boolean, float64, int64, njit, types, void

from rfea_vision.loops import forget_stale_loops

forget_stale_loops(Path(__file__).parent)

# Arrays of compiled code, row by row
VECTOR = float64[::1]
MATRIX = float64[:, ::1]
CUBE = float64[:, :, ::1]
INDEX = int64[::1]
# Signatures are spelled out so that laws enter as function pointers and one compiled engine serves them all.
JOINT_LAW = types.FunctionType(void(VECTOR, VECTOR, MATRIX, float64, VECTOR, VECTOR, MATRIX, VECTOR, VECTOR, MATRIX))
JOINT_CUBE = types.FunctionType(void(VECTOR, VECTOR, MATRIX, float64, VECTOR, VECTOR, MATRIX, VECTOR, VECTOR, CUBE))
FORCE_LAW = types.FunctionType(void(MATRIX, VECTOR, VECTOR, VECTOR, CUBE))

# Columns of `chain`
LENGTH, MASS, ALONG, ACROSS, INERTIA, FORCE_ALONG, FORCE_ACROSS, ADDED_ALONG = range(8)
OPPOSED = 9  # place in `con` of what all chambers' pressures are beyond the one that bends, written at every stage of a run
# Columns of the joint law's output
TAU, TAU_THETA, TAU_RATE, TAU_PRESSURE, ADDED, ADDED_THETA, FIXED = range(7)
# Columns of `body`, the working array with one row per body (n + 2, BODY_COLUMNS). A joint's entry stands in the row of
# the body behind it. K (3 x 7) maps d to what body and everything beyond it pass on; E is d(d of the next)/dx.
PHI, OM, AL, UX, UY, ACX, ACY, FX, FY, TORQUE, RESIDUAL, BETA, XFX, XFY = range(14)
STIFF, TAU_P, Z_TORQUE, STEP, LINE_RHS, LINE_STEP, KX, GAMMA, E, K = 14, 15, 16, 17, 18, 19, 20, 23, 30, 37
ADX, ADY = 58, 59
BODY_COLUMNS = 60

OK, NOT_CONVERGED, BLOWN_UP = 0, 1, 2  # statuses of the engine
OPTIONS = {"cache": True, "nogil": True, "error_model": "numpy", "fastmath": {"contract", "reassoc", "nsz", "arcp"}}
# The parts of a step are compiled into the entry points (`integrate`, `equilibrium`, `advance`, `joint_torques`), and only
# these are kept in Numba's cache.
#
# Parts that allocate nothing are compiled without reference counts: counting the arrays that they hand to one another took
# a third of a run.
# Nor can Python call them: what would translate its arguments took longer to compile than many a part.
ALLOCATING = {**OPTIONS, "cache": False, "forceinline": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
INLINE = {**ALLOCATING, "_nrt": False}


class System(NamedTuple):
    """A chain and one set of parameters; read, never written, but for `con[OPPOSED]`.

    chain (n, 8) by the columns above; dchain (n, 4, parameters) derivative of mass, along, across and inertia
    line (4,) flow resistance, flow inertance, compliance of the clamp, how far the point about which it turns lies outside
        the hinge line (m); dline (4, parameters)
    gravity (2,); dgravity (2, parameters); position, arc, length (n,); weights (n, effects)
    par, con : parameters and constants of the law; columns, states : of the law's output, hidden states per joint
    volume_rate : fluid volume per bending angle (m^3/rad)
    """

    chain: Any
    dchain: Any
    base_length: Any
    line: Any
    dline: Any
    gravity: Any
    dgravity: Any
    position: Any
    arc: Any
    length: Any
    weights: Any
    par: Any
    con: Any
    columns: Any
    states: Any
    with_force: Any
    with_base: Any
    with_line: Any
    with_added: Any
    volume_rate: Any


SYSTEM = types.NamedTuple(
    (
        *(MATRIX, CUBE, float64, VECTOR, MATRIX, VECTOR, MATRIX),
        *(VECTOR, VECTOR, VECTOR, MATRIX, VECTOR, VECTOR),
        *(int64, int64, boolean, boolean, boolean, boolean, float64),
    ),
    System,
)


class Laws(NamedTuple):
    """The compiled law: joints, their derivatives by the parameters, forces on the bodies."""

    joint: Any
    joint_parameters: Any
    force: Any


class Work(NamedTuple):
    """Working space of a stage, of a chain with n bodies and m hidden states a joint.

    body (n + 2, BODY_COLUMNS) by the columns above; theta, rate (n,) of the joints; out (n, columns) of the joint law
    force (n, 2, 5 + parameters) and motion (n, 4) of the bodies, place and velocity; d (7,) what a sweep carries
    z, z_star (n, m) hidden states and the known part of them; dz, zc, Sx, zp (n, m) their Newton step, own correction, and change
        with x and with the pressure; inverse (n, m, m), small (m, m) for the states of a joint
    """

    body: Any
    theta: Any
    rate: Any
    out: Any
    force: Any
    motion: Any
    d: Any
    z: Any
    z_star: Any
    dz: Any
    zc: Any
    Sx: Any
    zp: Any
    inverse: Any
    small: Any


WORK = types.NamedTuple((*(MATRIX, VECTOR, VECTOR, MATRIX, CUBE, MATRIX, VECTOR), *(MATRIX,) * 6, CUBE, MATRIX), Work)


@njit(**ALLOCATING)
def allocate(system):
    """Working space for one run."""
    n, m = system.chain.shape[0], max(system.states, 1)
    return Work(
        np.zeros((n + 2, BODY_COLUMNS)),
        np.zeros(n),
        np.zeros(n),
        np.zeros((n, system.columns)),
        np.zeros((n, 2, 5 + system.par.size)),
        np.zeros((n, 4)),
        np.zeros(7),
        np.zeros((n, m)),
        np.zeros((n, m)),
        np.zeros((n, m)),
        np.zeros((n, m)),
        np.zeros((n, m)),
        np.zeros((n, m)),
        np.zeros((n, m, m)),
        np.zeros((m, m)),
    )


@njit(**INLINE)
def copy_rows(source, target):
    """Write a matrix into another of its shape; `target[:, :] = source` takes seconds to compile, for its error message."""
    for i in range(target.shape[0]):
        for j in range(target.shape[1]):
            target[i, j] = source[i, j]


@njit(**INLINE)
def joint_angles(body, theta, rate):
    """Joint angles and rates from absolute ones."""
    for j in range(theta.size):
        theta[j] = body[j + 1, PHI] - body[j, PHI]
        rate[j] = body[j + 1, OM] - body[j, OM]


@njit(**INLINE)
def call_joint_law(law, system, work, felt, out):
    """Write a law of the joints at the motion that `work` holds into `out`."""
    law(work.theta, work.rate, work.z, felt, system.position, system.arc, system.weights, system.par, system.con, out)
