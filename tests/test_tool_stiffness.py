"""Compliance of the tool point, against statics solved in other ways."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import fsolve

from jointid import Elasticity, JointIdError, PlanarArm, RobotModel, locked_resonances
from jointid.cut.path_deflection import joint_path, own_path_deflections
from jointid.cut.rectangle import rectangle
from jointid.cut.tool_stiffness import planar_tool_stiffness, tool_stiffness
from jointid.figures.cut import deflection_ellipse
from jointid.reporting.blocks import Paragraph, Table
from jointid.reporting.evidence import own_path_blocks
from tests.robots import SIX_AXES

ROBOT = RobotModel.parse("six.toml", SIX_AXES.encode())
POSE = np.deg2rad([10.0, -60.0, 100.0, 20.0, 40.0, 10.0])
JOINT_K = np.array([5e6, 7.5e6, 4.2e6, 1.3e6, 1.1e6, 0.4e6])
ELASTICITY = Elasticity(JOINT_K / ROBOT.gear_ratio**2, 0.002 * JOINT_K / ROBOT.gear_ratio**2)


@pytest.mark.parametrize("drive", ["parallelogram", "serial"])
def test_compliance_of_a_planar_arm_is_that_of_its_statics(drive: str) -> None:
    """The arm's angles under a small force, from the balance of torques at the deflected arm."""
    arm = PlanarArm.example(drive)  # type: ignore[arg-type]
    q = arm.inverse([1.15, 0.0])
    elasticity = Elasticity([43.0, 7.5], [0.1, 0.015])
    K = arm.gear_ratio**2 * elasticity.K
    found = planar_tool_stiffness(arm, q, elasticity)
    for force in ([1.0, 0.0], [0.3, -0.8]):
        moved = fsolve(lambda x, F=force: K * x - arm.jacobian(q + x).T @ F, np.zeros(2), xtol=1e-10)
        np.testing.assert_allclose(found.deflection(force), arm.tool(q + moved) - arm.tool(q), rtol=1e-3)


def test_no_direction_is_softer_than_the_stated_one() -> None:
    arm = PlanarArm.example()
    found = planar_tool_stiffness(arm, arm.inverse([1.15, 0.0]), Elasticity([43.0, 7.5], [0.1, 0.01]))
    angle = np.linspace(0, 2 * np.pi, 721)
    size = np.linalg.norm(found.deflection(np.stack([np.cos(angle), np.sin(angle)], axis=1)), axis=1)
    values, directions = found.principal
    assert size.max() == pytest.approx(values[0], rel=1e-4)
    assert np.linalg.norm(found.deflection(directions[0])) == pytest.approx(values[0], rel=1e-9)
    with pytest.raises(JointIdError, match="2 finite values"):
        found.deflection([1.0, 2.0, 3.0])


def test_six_axes_under_load_and_gravity() -> None:
    """The loaded robot by the balance of joint torques with gravity as a function of the angles."""
    found, force = tool_stiffness(ROBOT, POSE, ELASTICITY), np.array([200.0, -100.0, 300.0])
    still, start = np.zeros(6), ROBOT.torque(POSE, np.zeros(6), np.zeros(6))

    def balance(x: np.ndarray) -> np.ndarray:
        gravity = ROBOT.torque(POSE + x, still, still) - start
        return np.asarray(JOINT_K * x + gravity - ROBOT.tool_motion(POSE + x)[1].T @ force)

    x = fsolve(balance, still, xtol=1e-10)
    moved = ROBOT.tool_motion(POSE + x / 2)[1] @ x
    np.testing.assert_allclose(found.deflection(force), moved, rtol=2e-3, atol=1e-7)
    np.testing.assert_allclose(found.resonances_hz, locked_resonances(ROBOT.inertia(POSE), ELASTICITY))


def test_deflection_along_a_path_is_that_of_gravity_and_inertia() -> None:
    """The sag from the joints' statics; the rest from the work of a force at the tool."""
    path = rectangle(zone_m=0.005, centre_m=(0.0, 0.0))
    found = joint_path(ROBOT, POSE, path)
    compliance = 1 / ELASTICITY.K
    still = np.zeros(6)
    corner = path.position(0.0)[0]
    q = POSE + np.linalg.pinv(ROBOT.tool_motion(POSE)[1]) @ [*corner, 0.0]
    sag = ROBOT.tool_motion(q)[1] @ (ROBOT.torque(q, still, still) / JOINT_K)
    np.testing.assert_allclose(found.deflection(found.gravity, compliance)[0], sag, rtol=0.01)
    step = 1e-6 * np.eye(6)[2]
    moved = (ROBOT.tool_motion(POSE + step)[0] - ROBOT.tool_motion(POSE - step)[0]) / 2e-6
    np.testing.assert_allclose(moved, ROBOT.tool_motion(POSE)[1][:, 2], atol=1e-8)
    far = rectangle(width_m=3.0, height_m=3.0, centre_m=(0.0, 0.0))
    with pytest.raises(JointIdError, match="does not reach"):
        joint_path(ROBOT, POSE, far)


def six_axes_known_to(variance: float) -> Any:
    fit = SimpleNamespace(n=6, K=ELASTICITY.K, covariance=variance * np.ones((12, 12)))
    study = SimpleNamespace(robot_model=ROBOT, pose_angles_rad={"": POSE}, nominal=None)
    return SimpleNamespace(study=study, fit=fit, require_usable=lambda: None)


def test_an_undetermined_k_gives_no_deflection() -> None:
    with pytest.raises(JointIdError, match="K is too uncertain"):
        own_path_deflections(six_axes_known_to(np.inf), [0.005])


def test_a_report_has_the_deflections_of_a_usable_answer() -> None:
    analysis = six_axes_known_to(0.0)
    (table,) = own_path_blocks(analysis)
    assert isinstance(table, Table)
    assert [row[0] for row in table.rows] == ["1 mm", "5 mm", "10 mm"]

    def refuse() -> None:
        raise JointIdError("Not usable: a fault. Resolve the findings first.")

    analysis.require_usable = refuse
    (paragraph,) = own_path_blocks(analysis)
    assert isinstance(paragraph, Paragraph)
    assert "Resolve the findings first" in paragraph.text


def test_deflection_of_a_slow_tool_is_that_of_gravity() -> None:
    quick, slow = (
        joint_path(ROBOT, POSE, rectangle(zone_m=0.005, centre_m=(0.0, 0.0), speed_m_s=speed))
        for speed in (0.3, 0.03)
    )
    compliance = 1 / ELASTICITY.K
    assert slow.change(slow.inertia, compliance) < 0.05 * quick.change(quick.inertia, compliance)


def test_standard_error_of_the_compliance() -> None:
    """By differences of K, one joint at a time."""
    sigma = 0.01 * ELASTICITY.K
    found = tool_stiffness(ROBOT, POSE, ELASTICITY)
    total = np.zeros(3)
    for j in range(6):
        ends = []
        for sign in (-1, 1):
            K = ELASTICITY.K + sign * 1e-4 * ELASTICITY.K * (np.arange(6) == j)
            ends.append(tool_stiffness(ROBOT, POSE, Elasticity(K, ELASTICITY.D)).principal[0])
        total += ((ends[1] - ends[0]) / 2e-4 * 0.01) ** 2
    np.testing.assert_allclose(found.standard_error(np.diag(sigma**2)), np.sqrt(total), rtol=1e-3)


def test_tool_point_of_the_file() -> None:
    """A longer tool along the last axis gives way more across it."""
    longer = RobotModel.parse("six.toml", (SIX_AXES + "\n[tool]\norigin = [0.0, 0.0, 0.5]\n").encode())
    near, far = (tool_stiffness(robot, POSE, ELASTICITY) for robot in (ROBOT, longer))
    assert np.linalg.eigvalsh(far.compliance)[-1] > np.linalg.eigvalsh(near.compliance)[-1]


def test_a_small_deflection_is_drawn_in_micrometres() -> None:
    """In the unit of the sentence beside it, so that both give the same number."""
    found = tool_stiffness(ROBOT, POSE, ELASTICITY)
    longest = found.principal[0][0]
    for force, scale, unit in ((5e-5 / longest, 1e6, "µm"), (2e-4 / longest, 1e3, "mm")):
        figure = deflection_ellipse(found, force, axes=("a", "b"))
        assert figure.layout.xaxis.title.text == f"Deflection along a ({unit})"
        assert np.abs(np.array(figure.data[0].x, float)).max() == pytest.approx(scale * force * longest)
