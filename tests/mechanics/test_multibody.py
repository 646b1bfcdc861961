"""Mass matrix, bias forces and gravity against a rigid-body engine that others wrote (MuJoCo), and against the textbook."""

import numpy as np
import pytest

from rfea_vision.dynamics.inverse import joint_torques
from rfea_vision.dynamics.simulation import Chain, Model
from rfea_vision.effects.catalogue import catalogue

CASES = [(n, joints) for n in (1, 2, 5, 16) for joints in ("middle", "start")]


def _motions(n, count=6):
    rng = np.random.default_rng(n)
    return rng.uniform(-1, 1, (count, n)), rng.normal(0, 5, (count, n)), rng.normal(0, 100, (count, n))


def _ours(model, par, theta, rate, acceleration):
    moved = [np.column_stack([np.zeros(len(v)), np.cumsum(v, axis=1)]) for v in (theta, rate, acceleration)]
    states = np.zeros((len(theta), model.chain.bodies, 1))
    return joint_torques(model, par, *moved, states, np.zeros(len(theta)))


def _in_mujoco(mujoco, model, par):
    """The same chain as an MJCF text: hanging along -z, hinges about y, so that a positive angle moves the tip to -x."""
    columns, _ = model._bodies(par)
    _, _, gravity, _ = model._environment(par)
    text, close = "", ""
    reach = model.chain.base_length
    for length, mass, along, across, inertia in columns[:, :5]:
        text += (
            f'<body pos="0 0 {-reach!r}"><joint type="hinge" axis="0 1 0"/>'
            f'<inertial pos="{across!r} 0 {-along!r}" mass="{mass!r}" diaginertia="{inertia!r} {inertia!r} {inertia!r}"/>'
        )
        close += "</body>"
        reach = length
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><compiler boundmass="0" boundinertia="0"/><option gravity="{gravity[0]!r} 0 {gravity[1]!r}"/>'
        f"<worldbody>{text}{close}</worldbody></mujoco>".replace("np.float64(", "").replace(")", "")
    )


@pytest.mark.parametrize(("n", "joints"), CASES)
@pytest.mark.parametrize("effect", [None, "com_offset", "payload", "gravity_tilt"])
def test_inverse_dynamics_is_mujocos(n, joints, effect, actuator):
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed (extra: twin)")
    model = Model(Chain.tube(actuator, n, joints), () if effect is None else (catalogue()[effect](),))
    par = np.append(np.zeros(7), {None: [], "com_offset": [0.7], "payload": [3e-3], "gravity_tilt": [0.1]}[effect])
    theta, rate, acceleration = _motions(n)
    ours = _ours(model, par, theta, rate, acceleration)
    theirs = _in_mujoco(mujoco, model, par)
    data = mujoco.MjData(theirs)
    for row, (q, v, a) in enumerate(zip(theta, rate, acceleration, strict=True)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q, v, a
        mujoco.mj_inverse(theirs, data)
        scale = np.abs(data.qfrc_inverse).max()
        assert np.abs(ours[row] - data.qfrc_inverse).max() < 1e-12 * scale
    # The mass matrix, column by column, at the last posture.
    mujoco.mj_forward(theirs, data)
    full = np.zeros((n, n))
    mujoco.mj_fullM(theirs, data, full)
    still = np.zeros((n, n))
    bias = _ours(model, par, np.tile(theta[-1], (n, 1)), still, still)
    mass = _ours(model, par, np.tile(theta[-1], (n, 1)), still, np.eye(n)) - bias
    assert np.abs(mass - full).max() < 1e-11 * np.abs(full).max()
    assert np.abs(mass - mass.T).max() < 1e-12 * np.abs(full).max()


def test_general_chain_of_two_is_the_textbook_double_pendulum():
    """M and bias of the planar elbow manipulator (Spong, Hutchinson and Vidyasagar, eq. 7.87) with gravity downwards."""
    l1, m1, m2, r1, r2, i1, i2, g = 0.3, 0.56, 0.6, 0.21, 0.18, 0.003, 0.004, 9.81
    model = Model(Chain.general([l1, 0.2], [m1, m2], [r1, r2], [i1, i2]), gravity=g)
    theta, rate, acceleration = _motions(2)
    ours = _ours(model, np.zeros(7), theta, rate, acceleration)
    for row, ((q1, q2), (v1, v2), (a1, a2)) in enumerate(zip(theta, rate, acceleration, strict=True)):
        m22 = m2 * r2**2 + i2
        m12 = m22 + m2 * l1 * r2 * np.cos(q2)
        m11 = m1 * r1**2 + i1 + m2 * (l1**2 + r2**2 + 2 * l1 * r2 * np.cos(q2)) + i2
        h = -m2 * l1 * r2 * np.sin(q2)
        g2 = m2 * r2 * g * np.sin(q1 + q2)
        g1 = (m1 * r1 + m2 * l1) * g * np.sin(q1) + g2
        first = m11 * a1 + m12 * a2 + h * v2 * v1 + h * (v1 + v2) * v2 + g1
        second = m12 * a1 + m22 * a2 - h * v1**2 + g2
        assert ours[row] == pytest.approx([first, second], rel=1e-12)
