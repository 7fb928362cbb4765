"""The planar arm: kinematics, equations of motion against closed forms, and pymunk against both."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from random_cases import examples
from scipy.integrate import solve_ivp

from jointid.cut.arm import PlanarArm
from jointid.cut.arm_simulation import ArmSimulation
from jointid.errors import JointIdError
from jointid.joints import Elasticity, locked_resonances, resonances

ELASTICITY = Elasticity(K=[43.0, 7.5], D=[0.10, 0.015])
UNDAMPED = Elasticity(K=[43.0, 7.5], D=[0.0, 0.0])
DRIVES = ("parallelogram", "serial")
CUTTING_POINT = (1.15, 0.0)
angles = st.floats(-3.0, 3.0)
bends = st.floats(0.1, 3.0)


def values(arm: PlanarArm, **changes: object) -> dict[str, object]:
    return vars(arm) | changes


@pytest.mark.parametrize(
    ("drive", "M2", "locked", "free"),
    [
        ("parallelogram", [[0.004104, 0.000395], [0.000395, 0.001889]], [9.97, 16.56], [17.07, 26.61]),
        ("serial", [[0.006345, 0.002095], [0.002095, 0.001889]], [8.79, 18.77], [17.58, 27.31]),
    ],
)
def test_motor_side_inertia_at_the_cutting_pose(drive, M2, locked, free) -> None:
    arm = PlanarArm.example(drive)
    inertia = arm.inertia(arm.inverse(CUTTING_POINT))
    np.testing.assert_allclose(inertia.M2, M2, atol=6e-7)
    np.testing.assert_array_equal(inertia.M, [0.0025, 0.0010])
    np.testing.assert_allclose(locked_resonances(inertia, ELASTICITY), locked, atol=6e-3)
    np.testing.assert_allclose(resonances(inertia, ELASTICITY), free, atol=6e-3)


def test_elbow_of_the_cutting_pose() -> None:
    q = PlanarArm.example("serial").inverse(CUTTING_POINT)
    assert np.rad2deg(q[1]) == pytest.approx(76, abs=0.5)


@pytest.mark.parametrize("drive", DRIVES)
@examples(100, derandomize=True)
@given(angle=angles, bend=bends, elbow=st.sampled_from(["positive", "negative"]))
def test_inverse_undoes_forward_kinematics(drive, angle, bend, elbow) -> None:
    arm = PlanarArm.example(drive)
    sign = 1 if elbow == "positive" else -1
    q = arm.joint_angles([angle, angle + sign * bend])
    back = arm.inverse(arm.tool(q), elbow)
    turns = (back - q) / (2 * np.pi)
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-9)
    np.testing.assert_allclose(arm.tool(back), arm.tool(q), atol=1e-12)


@examples(100, derandomize=True)
@given(angle=angles, bend=bends)
def test_both_drives_put_the_tool_at_the_same_place(angle, bend) -> None:
    absolute = PlanarArm.example("parallelogram").tool([angle, angle + bend])
    relative = PlanarArm.example("serial").tool([angle, bend])
    np.testing.assert_allclose(absolute, relative, atol=1e-12)


@pytest.mark.parametrize("drive", DRIVES)
@examples(100, derandomize=True)
@given(angle=angles, bend=bends)
def test_jacobian_is_the_derivative_of_the_tool_position(drive, angle, bend) -> None:
    arm, h = PlanarArm.example(drive), 1e-6
    q = np.array([angle, bend])
    columns = [(arm.tool(q + h * e) - arm.tool(q - h * e)) / (2 * h) for e in np.eye(2)]
    np.testing.assert_allclose(arm.jacobian(q), np.stack(columns, axis=1), atol=1e-8)


def kinetic_energy(arm: PlanarArm, q: np.ndarray, rate: np.ndarray) -> float:
    """From the velocities of the two bodies, without the mass matrix."""
    phi = q if arm.drive == "parallelogram" else np.cumsum(q)
    w = rate if arm.drive == "parallelogram" else np.cumsum(rate)
    across = [np.array([-np.sin(p), np.cos(p)]) for p in phi]
    v1 = arm.centre_m[0] * w[0] * across[0]
    v2 = arm.length_m[0] * w[0] * across[0] + arm.centre_m[1] * w[1] * across[1]
    return float(0.5 * (arm.mass_kg @ [v1 @ v1, v2 @ v2] + arm.inertia_kgm2 @ np.square(w)))


@pytest.mark.parametrize("drive", DRIVES)
@examples(100, derandomize=True)
@given(angle=angles, bend=bends, w1=angles, w2=angles)
def test_mass_matrix_holds_the_kinetic_energy_of_the_bodies(drive, angle, bend, w1, w2) -> None:
    arm, q, rate = PlanarArm.example(drive), np.array([angle, bend]), np.array([w1, w2])
    energy = 0.5 * rate @ arm.mass_matrix(q) @ rate
    assert energy == pytest.approx(kinetic_energy(arm, q, rate), rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("drive", DRIVES)
@examples(100, derandomize=True)
@given(angle=angles, bend=bends, w1=angles, w2=angles)
def test_coriolis_torque_follows_from_the_energy(drive, angle, bend, w1, w2) -> None:
    """Lagrange: c = Ṁ q̇ − ½ ∂(q̇ᵀ M q̇)/∂q."""
    arm, h = PlanarArm.example(drive), 1e-6
    q, rate = np.array([angle, bend]), np.array([w1, w2])
    derivative = [(arm.mass_matrix(q + h * e) - arm.mass_matrix(q - h * e)) / (2 * h) for e in np.eye(2)]
    expected = sum(w * d for w, d in zip(rate, derivative, strict=True)) @ rate
    expected = expected - 0.5 * np.array([rate @ d @ rate for d in derivative])
    np.testing.assert_allclose(arm.coriolis(q, rate), expected, atol=1e-6)


def test_out_of_reach_and_singular_points_are_refused() -> None:
    arm = PlanarArm.example()
    with pytest.raises(
        JointIdError, match=r"\(2, 0\) m is out of reach.*between 0.0505\d* m and 1.46 m"
    ):
        arm.inverse([2.0, 0.0])
    with pytest.raises(JointIdError, match="out of reach"):
        arm.inverse([[1.0, 0.0], [0.0, 0.02]])
    with pytest.raises(JointIdError, match="singular"):
        arm.inverse([0.0, arm.length_m.sum() - 1e-6])
    with pytest.raises(JointIdError, match='elbow = "up"'):
        arm.inverse([1.0, 0.0], "up")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"drive": "belt"}, 'drive = "belt"'),
        ({"mass_kg": [45.0, -1.0]}, "mass_kg of link 2 is -1 kg: it must be positive"),
        ({"gear_ratio": [0.0, 90.0]}, "gear_ratio of link 1 is 0: it must not be zero"),
        ({"centre_m": [-0.1, 0.3]}, "must not be negative"),
        ({"length_m": [0.7, 0.7, 0.7]}, "3 value"),
        ({"inertia_kgm2": [1.0, np.nan]}, "must be finite"),
    ],
)
def test_bad_arms_are_refused(change, message) -> None:
    with pytest.raises(JointIdError, match=message):
        PlanarArm(**values(PlanarArm.example(), **change))


Q, PUSH_NM = np.array([0.4, 1.2]), np.array([60.0, -30.0])


def pushed(arm: PlanarArm, elasticity: Elasticity, end_s: float) -> np.ndarray:
    """Angles after a constant push, from an independent tight integration in joint coordinates."""
    n2 = arm.gear_ratio**2

    def slope(_: float, y: np.ndarray) -> np.ndarray:
        q, theta, w, v = y[:2], y[2:4], y[4:6], y[6:]
        spring = n2 * (elasticity.K * (theta - q) + elasticity.D * (v - w))
        acceleration = np.linalg.solve(arm.mass_matrix(q), spring - arm.coriolis(q, w))
        return np.concatenate([w, v, acceleration, (PUSH_NM - spring) / (n2 * arm.rotor_inertia_kgm2)])

    start = np.concatenate([Q, Q, np.zeros(4)])
    return solve_ivp(slope, (0, end_s), start, method="DOP853", rtol=1e-11, atol=1e-13).y[:4, -1]


def swing(
    arm: PlanarArm, elasticity: Elasticity, dt: float, end_s: float, push_s: float = np.inf
) -> ArmSimulation:
    """From rest, pushed for a while: half as much at the steps around its begin and its end."""
    simulation, steps = (
        ArmSimulation(arm, elasticity, dt, Q),
        round(push_s / dt) if push_s < end_s else -1,
    )
    for k in range(round(end_s / dt)):
        share = 0.5 if k in (0, steps) else float(steps < 0 or k < steps)
        simulation.step(share * PUSH_NM[:, None])
    simulation.log.append(simulation.angles)
    return simulation


@pytest.mark.parametrize("drive", DRIVES)
def test_pymunk_converges_with_the_square_of_the_step(drive) -> None:
    arm = PlanarArm.example(drive)
    exact = pushed(arm, ELASTICITY, 0.5)
    exact[:2] = arm.link_angles(exact[:2])
    errors = [
        np.abs(swing(arm, ELASTICITY, dt, 0.5).angles - exact).max()
        for dt in (1e-3, 5e-4, 2.5e-4, 1.25e-4)
    ]
    ratios = np.divide(errors[:-1], errors[1:])
    assert ratios.min() > 3.8
    assert ratios.max() < 4.2
    assert errors[-1] < 1e-6


@pytest.mark.parametrize("drive", DRIVES)
def test_energy_and_angular_momentum_are_kept(drive) -> None:
    arm, dt = PlanarArm.example(drive), 1e-4
    log = np.array(swing(arm, UNDAMPED, dt, 5.3, push_s=0.3).log)[3001:]
    q, theta = arm.joint_angles(log[1:-1, :2]), log[1:-1, 2:]
    rates = (log[2:] - log[:-2]) / (2 * dt)
    w, v = arm.joint_angles(rates[:, :2]), rates[:, 2:]
    B = arm.rotor_inertia_arm_kgm2
    links = np.einsum("ki,kij,kj->k", w, arm.mass_matrix(q), w)
    energy = 0.5 * (links + v**2 @ B + (theta - q) ** 2 @ (arm.gear_ratio**2 * UNDAMPED.K))
    tenth = len(energy) // 10
    assert abs(energy[-tenth:].mean() / energy[:tenth].mean() - 1) < 1e-5
    assert np.ptp(energy) < 5e-4 * energy.mean()
    # Springs act between rotor and link. Only a serial arm's rotor 2 hands its torque on to link 1.
    momentum = (arm.mass_matrix(q) @ w[:, :, None])[:, :, 0]
    turning = (
        momentum.sum(axis=1) + v @ B if drive == "parallelogram" else momentum[:, 0] + v[:, 0] * B[0]
    )
    assert np.ptp(turning) < 1e-5 * np.abs(momentum).max()


@pytest.mark.parametrize("drive", DRIVES)
def test_pivots_hold(drive) -> None:
    simulation = swing(PlanarArm.example(drive), ELASTICITY, 2.5e-4, 0.5)
    for joint in simulation._space.constraints:
        gap = joint.a.local_to_world(joint.anchor_a) - joint.b.local_to_world(joint.anchor_b)
        assert abs(gap) < 1e-7


def test_a_sticking_motor_does_not_move() -> None:
    arm = PlanarArm.example()
    friction = SimpleNamespace(coulomb=[0.5, 0.25], viscous=0.0)
    simulation = ArmSimulation(arm, ELASTICITY, 2.5e-4, Q, friction)
    for _ in range(400):
        simulation.step(np.array([[49.9], [-22.4]]))  # just below 100 · 0.5 and 90 · 0.25
    assert simulation.angles[2:] == pytest.approx(Q, abs=1e-12)
    for _ in range(400):
        simulation.step(np.array([[55.0], [-10.0]]))
    assert simulation.angles[2] > Q[0] + 1e-4
    assert simulation.angles[3] == pytest.approx(Q[1], abs=1e-12)


def test_viscous_friction_slows_the_rotor() -> None:
    """A rotor on a spring too soft to matter: θ̇ = τ/F (1 − exp(−F t / J)), F and J on one side."""
    soft = Elasticity(K=[1e-9, 1e-9], D=[0.0, 0.0])
    arm, friction = PlanarArm.example(), SimpleNamespace(coulomb=0.0, viscous=0.01)
    simulation, torque = ArmSimulation(arm, soft, 2.5e-4, Q, friction), np.array([50.0, 20.0])
    for k in range(800):
        simulation.step((1.0 if k else 0.5) * torque[:, None])
    final = torque / (0.01 * arm.gear_ratio**2)
    expected = -final * np.expm1(-0.01 * 0.2 / arm.rotor_inertia_kgm2)
    np.testing.assert_allclose(simulation.motor_rate[:, 0], expected, rtol=1e-5)


@examples(20, derandomize=True)
@given(flip1=st.booleans(), flip2=st.booleans())
def test_the_sign_of_a_gear_does_not_change_the_arm(flip1, flip2) -> None:
    arm = PlanarArm.example()
    signs = np.where([flip1, flip2], -1.0, 1.0)
    flipped = PlanarArm(**values(arm, gear_ratio=arm.gear_ratio * signs))
    simulation = swing(flipped, ELASTICITY, 1e-3, 0.02)
    assert simulation.angles == pytest.approx(swing(arm, ELASTICITY, 1e-3, 0.02).angles, abs=1e-12)
