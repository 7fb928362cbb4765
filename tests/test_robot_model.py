"""The rigid model against pinocchio, the energy of the bodies, and invalid files."""

from __future__ import annotations

import re
import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from jointid import JointIdError, RobotModel
from tests.robots import MJCF, SIX_AXES, URDF

ROBOT = RobotModel.parse("six.toml", SIX_AXES.encode())
NEAR = {"rtol": 1e-10, "atol": 1e-9}


def some_motion(n: int, seed: int = 0, rows: int = 20) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(3, rows, n)) * [[[1.0]], [[0.8]], [[3.0]]]


def by_pinocchio(robot: RobotModel) -> tuple[Any, Any]:
    """The six axes built in pinocchio from the Denavit-Hartenberg table, without our frames."""
    table = tomllib.loads(SIX_AXES)
    model = pin.Model()
    flip = pin.SE3(np.diag([1.0, -1.0, -1.0]), np.zeros(3))
    before = flip
    for j, link in enumerate(table["link"]):
        joint = model.addJoint(j, pin.JointModelRZ(), before, f"axis{j}")
        alpha = np.deg2rad(link["alpha_deg"])
        slide = pin.SE3(np.eye(3), np.array([link["a"], 0.0, link["d"]]))
        after = slide * pin.SE3(pin.utils.rotate("x", alpha), np.zeros(3))
        bodies = [link, table["payload"]] if j == 5 else [link]
        for body in bodies:
            xx, yy, zz, xy, yz, xz = body["inertia"]
            tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            model.appendBodyToJoint(
                joint, pin.Inertia(body["mass"], np.array(body["center"]), tensor), after
            )
        before = after
    return model, model.createData()


def energies(q: np.ndarray, dq: np.ndarray) -> tuple[float, float]:
    """Kinetic and potential energy of the six axes by plain transforms and their differences in time."""

    def places(q: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
        T = np.diag([1.0, -1.0, -1.0, 1.0])
        points, frames = [], []
        for link, angle in zip(TABLE["link"], q, strict=True):
            t = angle + np.deg2rad(link.get("zero_deg", 0.0) + link.get("offset_deg", 0.0))
            c, s = np.cos(t), np.sin(t)
            ca, sa = np.cos(np.deg2rad(link["alpha_deg"])), np.sin(np.deg2rad(link["alpha_deg"]))
            a, d = link["a"], link["d"]
            T = T @ np.array(
                [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]]
            )
            for body in [link, TABLE["payload"]] if link is TABLE["link"][-1] else [link]:
                points.append((T @ [*body["center"], 1.0])[:3])
                frames.append(T[:3, :3])
        return points, frames

    h = 1e-30
    points, frames = places(q + 1j * h * dq)
    kinetic = potential = 0.0
    bodies = [*TABLE["link"], TABLE["payload"]]
    for body, point, R in zip(bodies, points, frames, strict=True):
        xx, yy, zz, xy, yz, xz = body["inertia"]
        v, rate = point.imag / h, R.imag / h
        W = R.real.T @ rate  # angular velocity in the body
        w = np.array([W[2, 1], W[0, 2], W[1, 0]])
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        kinetic += body["mass"] * v @ v / 2 + w @ tensor @ w / 2
        potential += body["mass"] * 9.81 * point.real[2]
    return kinetic, potential


TABLE = tomllib.loads(SIX_AXES)


def test_torque_inertia_and_gravity_stiffness_agree_with_pinocchio() -> None:
    model, data = by_pinocchio(ROBOT)
    bare = replace(ROBOT, counterbalance=None)
    q, dq, ddq = some_motion(6)
    tau = bare.torque(q, dq, ddq)
    for k in range(len(q)):
        angles = q[k] + ROBOT.zero
        np.testing.assert_allclose(tau[k], pin.rnea(model, data, angles, dq[k], ddq[k]), **NEAR)
        M = np.triu(pin.crba(model, data, angles))
        M = M + np.triu(M, 1).T
        np.testing.assert_allclose(ROBOT.joint_inertia(q[k]), M, **NEAR)
        given = ROBOT.inertia(q[k])
        np.testing.assert_allclose(
            given.M2, M / np.outer(ROBOT.gear_ratio, ROBOT.gear_ratio), rtol=1e-9, atol=1e-15
        )
        np.testing.assert_array_equal(given.M, [0.009, 0.011, 0.011, 0.0018, 0.0018, 0.0018])
        stiffness = pin.computeGeneralizedGravityDerivatives(model, data, angles)
        np.testing.assert_allclose(bare.gravity_stiffness(q[k]), stiffness, **NEAR)


def test_torque_is_the_rate_of_the_energy() -> None:
    """dE/dt = τ · dq along a motion, for energies by plain transforms: an independent calculation."""
    bare = replace(ROBOT, counterbalance=None)
    q, dq, ddq = some_motion(6, seed=1)
    h = 1e-5
    for k in range(len(q)):
        power = bare.torque(q[k], dq[k], ddq[k]) @ dq[k]
        ends = [
            sum(energies(q[k] + t * dq[k] + t * t / 2 * ddq[k], dq[k] + t * ddq[k])) for t in (-h, h)
        ]
        assert power == pytest.approx((ends[1] - ends[0]) / (2 * h), rel=1e-6, abs=1e-3)
    kinetic, _ = energies(q[0], dq[0])
    assert dq[0] @ ROBOT.joint_inertia(q[0]) @ dq[0] / 2 == pytest.approx(kinetic, rel=1e-12)


def test_counterbalance_carries_part_of_the_arm() -> None:
    """With its own formula, and its stiffness by differences."""
    bare, q = replace(ROBOT, counterbalance=None), np.deg2rad([10.0, -40.0, 80.0, 20.0, 30.0, 5.0])
    still = np.zeros(6)
    extra = ROBOT.torque(q, still, still) - bare.torque(q, still, still)
    e = np.deg2rad(-40.0 - 90.0 + 95.0)
    length = np.sqrt(0.8**2 + 0.2**2 - 2 * 0.8 * 0.2 * np.cos(e))
    area = np.pi * (0.055**2 - 0.03**2) / 4
    expected = 0.8 * 0.2 * np.sin(e) / length * area * 14000.0 / (2 * 0.00048 - (length - 0.6) * area)
    np.testing.assert_allclose(extra, [0, expected, 0, 0, 0, 0], rtol=1e-12, atol=1e-9)
    h = 1e-6
    slopes = [
        (ROBOT.torque(q + d, still, still) - ROBOT.torque(q - d, still, still)) / (2 * h)
        for d in h * np.eye(6)
    ]
    np.testing.assert_allclose(ROBOT.gravity_stiffness(q), np.array(slopes).T, rtol=1e-6, atol=1e-3)


def test_changes_by_payload_and_parts_are_those_of_the_torque() -> None:
    """A first moment along an axis without second moments: halves of a payload on both sides."""
    motion, load = some_motion(6, seed=2, rows=5), ROBOT.payload
    torque, payload, parts = ROBOT.torque_changes(*motion)
    np.testing.assert_allclose(torque, ROBOT.torque(*motion), rtol=1e-12)
    mass, *centre = np.moveaxis(payload, -1, 0)

    def loaded(mass: float, center: np.ndarray) -> np.ndarray:
        return ROBOT.with_payload(mass=mass, center=center, inertia=np.zeros(6)).torque(*motion)

    heavier = loaded(load.mass + 40.0, load.center) - loaded(load.mass, load.center)
    np.testing.assert_allclose(mass, heavier, **NEAR)
    lever = np.linalg.norm(load.center)
    for moved, side in zip(centre, lever * np.eye(3), strict=True):
        np.testing.assert_allclose(moved, (loaded(40.0, side) - loaded(40.0, -side)) / 2, **NEAR)
    bare = ROBOT.with_payload(mass=0.0, inertia=np.zeros(6))
    np.testing.assert_allclose(parts.sum(axis=-1), bare.torque(*motion), **NEAR)
    links = replace(bare, counterbalance=None)
    np.testing.assert_allclose(parts[..., :-1].sum(axis=-1), links.torque(*motion), **NEAR)
    assert not links.torque_changes(*motion)[2][..., -1].any()
    assert ROBOT.with_payload(mass=100.0).payload.mass_std == load.mass_std == 40.0


def test_tool_velocity_agrees_with_pinocchio() -> None:
    model, data = by_pinocchio(ROBOT)
    q = some_motion(6, rows=1)[0, 0]
    tool = model.addFrame(
        pin.Frame("tool", 6, 0, pin.SE3(np.diag([1.0, -1, -1]), np.array([0, 0, -0.23])), pin.OP_FRAME)
    )
    J = pin.computeFrameJacobian(
        model, model.createData(), q + ROBOT.zero, tool, pin.LOCAL_WORLD_ALIGNED
    )
    np.testing.assert_allclose(ROBOT.tool_motion(q)[1], J[:3], **NEAR)
    del data


def test_coupled_wrist() -> None:
    """joint = C · motor: the second motor also turns the sixth joint."""
    C = np.diag(1 / ROBOT.gear_ratio)
    C[5, 4] = 0.3 * C[4, 4]
    lines = [line for line in SIX_AXES.splitlines() if not line.startswith("gear_ratio")]
    robot = RobotModel.parse("six.toml", f"coupling = {C.tolist()}\n{chr(10).join(lines)}".encode())
    q = np.deg2rad([0.0, -30.0, 60.0, 10.0, 40.0, 0.0])
    np.testing.assert_allclose(robot.gear_ratio, ROBOT.gear_ratio)
    np.testing.assert_allclose(
        robot.inertia(q).M2, C.T @ ROBOT.joint_inertia(q) @ C, rtol=1e-9, atol=1e-16
    )
    np.testing.assert_allclose(
        robot.inertia(q).gravity, C.T @ ROBOT.gravity_stiffness(q) @ C, rtol=1e-9, atol=1e-12
    )


def test_urdf_agrees_with_pinocchio() -> None:
    robot = RobotModel.parse("arm.urdf", URDF.encode())
    model = pin.buildModelFromXML(URDF)
    data = model.createData()
    q, dq, ddq = some_motion(3)
    for k in range(len(q)):
        angles = np.array([q[k, 0], np.cos(q[k, 1]), np.sin(q[k, 1]), q[k, 2]])
        np.testing.assert_allclose(
            robot.torque(q[k], dq[k], ddq[k]), pin.rnea(model, data, angles, dq[k], ddq[k]), **NEAR
        )
    assert robot.names == ("j1", "j2", "j3")
    assert robot.gear_ratio[1] == -80
    with pytest.raises(JointIdError, match=r"arm\.urdf does not state the gear ratio of j1 and j3"):
        robot.inertia(q[0])
    known = RobotModel.parse("arm.urdf", URDF.encode(), gear_ratio=[90, -80, 40], rotor_inertia=0.001)
    scaled = known.inertia(q[0]).M2 * np.outer([90, -80, 40], [90, -80, 40])
    np.testing.assert_allclose(scaled, robot.joint_inertia(q[0]), rtol=1e-12)


def test_one_joint() -> None:
    head, tail = URDF.index('  <link name="fore">'), URDF.index('  <joint name="j2"')
    first = URDF.index('  <joint name="j1"')
    robot = RobotModel.parse("one.urdf", (URDF[:head] + URDF[first:tail] + "</robot>").encode())
    model = pin.buildModelFromXML(URDF[:head] + URDF[first:tail] + "</robot>")
    expected = pin.rnea(model, model.createData(), *np.array([[0.3], [0.5], [2.0]]))
    np.testing.assert_allclose(robot.torque([0.3], [0.5], [2.0]), expected, **NEAR)


def test_mjcf_agrees_with_pinocchio(tmp_path: Path) -> None:
    """Armature is the rotor seen from the joint, N² times that of the motor, no part of the links."""
    file = tmp_path / "arm.xml"
    file.write_text(MJCF)
    robot = RobotModel.load(file)
    plain = tmp_path / "plain.xml"
    plain.write_text(MJCF.replace('<geom type="mesh" mesh="shell"/>', ""))
    model = pin.buildModelFromMJCF(str(plain))
    model.gravity.linear = np.array([0, 0.3, -9.7])
    data = model.createData()
    q, dq, ddq = some_motion(3)
    for k in range(len(q)):
        rotors = np.array(model.armature) * ddq[k]
        expected = pin.rnea(model, data, q[k], dq[k], ddq[k]) - rotors
        np.testing.assert_allclose(robot.torque(q[k], dq[k], ddq[k]), expected, **NEAR)
    np.testing.assert_array_equal(robot.gear_ratio, [100, -50, 30])
    np.testing.assert_allclose(robot.inertia(q[0]).M, [40 / 100**2, 5 / 50**2, 5 / 30**2])
    other = RobotModel.load(file, gear_ratio=[200, 50, 30])
    assert other.inertia(q[0]).M[0] == pytest.approx(40 / 200**2)


CLASSES = """<mujoco><compiler angle="radian" eulerseq="ZYx"/>
  <default><joint axis="0 1 0" armature="3"/><geom density="500"/>
    <default class="rail"><joint type="slide" ref="0.2" pos="0 0.1 0"/>
      <default class="pipe"><geom type="capsule" size="0.05 0.2"/><motor gear="40"/></default></default>
  </default>
  <worldbody><body pos="0 0 0.4" zaxis="1 0 1" childclass="main">
    <joint name="a" ref="0.3"/><geom type="box" size="0.1 0.2 0.3"/>
    <body pos="0.3 0 0.5" euler="0.1 0.2 0.3" childclass="rail">
      <geom type="cylinder" fromto="0 0 0 0 0.2 0.2" size="0.1" density="100"/>
      <body pos="0 0.2 0" axisangle="0 1 1 0.7">
        <joint name="b" class="pipe" axis="1 1 0"/><geom class="pipe" pos="0.1 0 0"/>
        <body xyaxes="1 1 0 0 0 1"><joint name="c" class="main" type="hinge"/><geom size="0.1" mass="2"/>
          <body pos="0 0 0.2"><inertial pos="0.1 0 0" mass="1" diaginertia="0.1 0.2 0.15"/></body>
        </body></body></body></body></worldbody>
  <actuator><motor class="pipe" joint="b"/></actuator></mujoco>"""


def test_mjcf_has_the_classes_and_angles_of_mujoco() -> None:
    """pinocchio's own reader of MJCF drops joints of such files: the model is built step by step."""

    def place(rotation: np.ndarray, *origin: float) -> pin.SE3:
        return pin.SE3(rotation, np.array(origin or (0.0, 0.0, 0.0)))

    turn, root, still = pin.utils.rotate, np.sqrt(0.5), np.eye(3)
    slant = np.stack([[root, root, 0], [0, 0, 1], [root, -root, 0]], axis=1)
    about = pin.AngleAxis(0.7, np.array([0, root, root])).matrix()
    model = pin.Model()
    first = model.addJoint(0, pin.JointModelRY(), place(turn("y", np.pi / 4), 0, 0, 0.4), "a")
    model.appendBodyToJoint(first, pin.Inertia.FromBox(500 * 0.048, 0.2, 0.4, 0.6), place(still))
    # upper-case letters turn about fixed axes, lower-case ones about turned axes
    fixed = place(turn("y", 0.2) @ turn("z", 0.1) @ turn("x", 0.3), 0.3, 0, 0.5)
    length = np.sqrt(0.08)
    rod = pin.Inertia.FromCylinder(100 * np.pi * 0.01 * length, 0.1, length)
    model.appendBodyToJoint(first, rod, fixed * place(turn("x", -np.pi / 4), 0, 0.1, 0.1))
    rail = fixed * place(about, *(np.array([0, 0.2, 0]) + about @ [0, 0.1, 0]))
    slide = pin.JointModelPrismaticUnaligned(np.array([root, root, 0]))
    second = model.addJoint(first, slide, rail, "b")
    volume = np.pi * 0.05**2 * (0.4 + 4 / 3 * 0.05)
    capsule = pin.Inertia.FromCapsule(500 * volume, 0.05, 0.4)
    model.appendBodyToJoint(second, capsule, place(still, 0.1, -0.1, 0))
    third = model.addJoint(second, pin.JointModelRY(), place(slant, 0, -0.1, 0), "c")
    model.appendBodyToJoint(third, pin.Inertia.FromSphere(2.0, 0.1), place(still))
    tip = pin.Inertia(1.0, np.array([0.1, 0, 0]), np.diag([0.1, 0.2, 0.15]))
    model.appendBodyToJoint(third, tip, place(still, 0, 0, 0.2))
    data, robot = model.createData(), RobotModel.parse("classes.xml", CLASSES.encode())
    assert robot.names == ("a", "b", "c")
    for q, dq, ddq in zip(*some_motion(3), strict=True):
        expected = pin.rnea(model, data, q - [0.3, 0.2, 0.0], dq, ddq)
        np.testing.assert_allclose(robot.torque(q, dq, ddq), expected, **NEAR)
    np.testing.assert_array_equal(robot.armature, [3, 3, 3])
    np.testing.assert_array_equal(robot.gear_ratio, [np.nan, 40, np.nan])


def test_mjcf_without_gravity_has_none() -> None:
    whole = MJCF.replace("<worldbody>", "<option><flag gravity='disable'/></option><worldbody>", 1)
    free = RobotModel.parse("arm.xml", whole.encode())
    assert not free.gravity_stiffness(np.full(free.n, 0.3)).any()
    assert RobotModel.parse("arm.xml", MJCF.encode()).gravity_stiffness(np.full(free.n, 0.3)).any()


def test_files_named_in_an_mjcf_are_not_opened_by_mujoco(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nor plugins, textures or scripts: only known elements and attributes are handed on."""
    import mujoco

    seen: list[str] = []
    read = mujoco.MjModel.from_xml_string
    fake = SimpleNamespace(from_xml_string=lambda text: (seen.append(text), read(text))[1])
    monkeypatch.setattr(mujoco, "MjModel", fake)
    more = (
        '<extension><plugin plugin="p"/></extension><asset><hfield name="h" file="/etc/passwd"/>'
        '<texture file="/etc/passwd"/><model name="m" file="/etc/passwd"/>'
    )
    RobotModel.parse("arm.xml", MJCF.replace("<asset>", more).encode())
    assert not any(word in seen[0] for word in ("file", "passwd", "plugin", "meshes", "asset", "light"))


FILES = {"a.urdf": URDF, "a.xml": MJCF, "a.toml": SIX_AXES}
DOCUMENT_TYPE = '<!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/passwd"><!ENTITY b "&x;&x;">]>'
REDUCTION = "<mechanicalReduction>5</mechanicalReduction>"
WELD = '<equality><weld body1="slide"/></equality><asset>'
BAD_PARTS = {
    "external entity": ("a.urdf", "<robot name", DOCUMENT_TYPE + "<robot name", "document type"),
    "billion laughs": ("a.xml", "<mujoco", DOCUMENT_TYPE + "<mujoco", "document type"),
    "mass is text": ("a.urdf", '"20"', '"heavy"', "mass.*'heavy'"),
    "mass is negative": ("a.urdf", '"20"', '"-20"', "-20: it must not be negative"),
    "axis is zero": ("a.urdf", "0 1 1", "0 0 0", "j1.*0 0 0"),
    "unknown parent": ("a.urdf", 'parent link="base"', 'parent link="bass"', 'parent link "bass"'),
    "floating": ("a.urdf", '"continuous"', '"floating"', "joint j2 is floating"),
    "two of one name": ("a.urdf", 'joint name="j2" type', 'joint name="j1" type', 'the name "j1"'),
    "half an inertial": ("a.urdf", 'ixx="1.2"', "", "link upper.*all six"),
    "impossible tensor": ("a.urdf", 'ixx="1.2"', 'ixx="-1.2"', "moved by joint j1 have the negative"),
    "two bases": ("a.urdf", '<link name="base"/>', '<link name="base"/><link name="b2"/>', "base, b2"),
    "macro": ("a.urdf", '<link name="base"/>', '<link name="base"/><xacro:arm/>', "xacro"),
    "capitals": ("a.urdf", '<origin xyz="0.2 0 0"/>', '<Origin xyz="0.2 0 0"/>', "<Origin>.*lower-case"),
    "quaternion": ("a.urdf", 'rpy="0.3 0 0"', 'quat_xyzw="0 0 0 1"', "quat_xyzw"),
    "two masses": ("a.urdf", '<mass value="9"/>', '<mass value="9"/><mass value="1"/>', "one <mass>"),
    "gravity": ("a.urdf", '<link name="base"/>', "<gravity>0 0 0</gravity>", "not part of URDF"),
    "nested": ("a.urdf", '<link name="base"/>', '<link name="base"><link/></link>', "inside a link"),
    "axis without xyz": ("a.urdf", '<axis xyz="0 1 1"/>', "<axis/>", "j1.*0 0 0"),
    "two reductions": ("a.urdf", "</actuator>", f"</actuator>{REDUCTION}", "joint j2 is 5 and -80"),
    "frame of the world": ("a.xml", '<light pos="0 0 3"/>', "<frame/>", "worldbody: <frame>"),
    "include": ("a.xml", "<asset>", '<include file="/etc/passwd"/><asset>', "include"),
    "include in a class": (
        "a.xml",
        '<default class="wrist">',
        '<default class="wrist"><include/>',
        "include",
    ),
    "too many": ("a.xml", "<asset>", "<asset/>" * 5000 + "<asset>", "more than 5000 elements"),
    "endless arm": ("a.xml", 'size="0.1 0.2 0.3"', 'size="1e200 1 1"', "(fore|j2).*inertia"),
    "unknown class": ("a.xml", 'childclass="wrist"', 'childclass="wrst"', 'class "wrst"'),
    "closed loop": ("a.xml", "<asset>", WELD, "loops"),
    "mass from a mesh": ("a.xml", 'type="box"', 'type="mesh" mesh="shell"', "fore, shape 1.*inertial"),
    "two joints": ("a.xml", '<joint name="j2"/>', '<joint name="j2"/><joint name="j4"/>', "2 joints"),
    "ball": ("a.xml", 'type="slide"', 'type="ball"', "j3 must be a hinge"),
    "frame": ("a.xml", '<geom type="mesh" mesh="shell"/>', "<frame/>", "<frame>"),
    "gear of 0": ("a.xml", 'gear="-50"', 'gear="0"', "joint j2 has a gear of 0"),
    "two gears": ("a.xml", "<actuator>", '<actuator><velocity joint="j2" gear="9"/>', "gears 9 and -50"),
    "spring": ("a.xml", 'axis="1 1 0"', 'axis="1 1 0" stiffness="40"', "stiffness"),
    "spring in a class": ("a.xml", 'armature="5"', 'armature="5" springdamper="1 1"', "springdamper"),
    "gravcomp": ("a.xml", 'name="slide"', 'name="slide" gravcomp="1"', "gravcomp"),
    "scaled mass": ("a.xml", "meshdir=", "settotalmass=", "settotalmass"),
    "no mass": ("a.toml", "mass = 100.0", "", "number 3: mass is missing"),
    "unknown key": ("a.toml", "mass = 100.0", "mas = 100.0", 'unknown key "mas"'),
    "no gear": ("a.toml", "gear_ratio = 215.0", "gear_ratio = 0", "number 4: gear_ratio is 0"),
    "impossible inertia": ("a.toml", "[10.0, 9.5, 2.0", "[10.0, -9.5, 2.0", "negative principal"),
    "short center": ("a.toml", "[-0.02, -0.02, -0.08]", "[0.1]", "center has 1 value"),
    "base": ("a.toml", "x 180 deg", "upside down", "rotation"),
    "counterbalance": ("a.toml", "joint = 2", "joint = 7", "joints 1 to 6"),
    "part of a counterbalance": ("a.toml", "angle_deg = 95.0", "", "angle_deg is missing"),
    "payload": ("a.toml", "mass = 120.0", "mass = -1.0", "payload.*mass = -1"),
}
"""Name of the file, what is replaced in it by what, and the message."""
BAD_TEXTS = {
    "not xml": ("a.urdf", URDF[:300], "line"),
    "other root": ("a.urdf", MJCF, "expected <robot>"),
    "not toml": ("a.toml", "[[link", "TOML"),
    "both gears": ("a.toml", "coupling = [[1.0]]\n" + SIX_AXES, "coupling"),
    "other file": ("a.stl", "solid", r"\.urdf"),
    "too large": ("a.urdf", " " * (5 << 20), "limit"),
}
BAD_FILES = BAD_TEXTS | {
    fault: (name, FILES[name].replace(old, new), message)
    for fault, (name, old, new, message) in BAD_PARTS.items()
}


@pytest.mark.parametrize(("name", "text", "message"), BAD_FILES.values(), ids=BAD_FILES)
def test_a_bad_file_is_named_with_its_fault(name: str, text: str, message: str) -> None:
    assert text not in FILES.values() or (name, text) == ("a.urdf", MJCF)
    with pytest.raises(JointIdError, match=message) as raised:
        RobotModel.parse(name, text.encode())
    assert name in str(raised.value)


def test_a_joint_that_moves_no_mass_is_named_unless_a_payload_does() -> None:
    light = re.sub(r'<link name="(slide|tool)">.*?</link>', r'<link name="\1"/>', URDF, flags=re.S)
    robot = RobotModel.parse("a.urdf", light.encode(), gear_ratio=[9] * 3, rotor_inertia=[1] * 3)
    with pytest.raises(JointIdError, match=r"a\.urdf: no mass moves with j3\. .*payload"):
        robot.inertia(np.zeros(3))
    assert np.isfinite(robot.with_payload(mass=1.0).inertia(np.zeros(3)).M2).all()


@pytest.mark.parametrize("std", [1e-3, 40.0])
def test_a_payload_on_the_last_axis_is_uncertain_in_every_pose(std: float) -> None:
    """It does not move that axis: rounding errors of M2 there were refused as not symmetric."""
    model = ROBOT.with_payload(mass=175.0, mass_std=std, center=[0.0, 0.0, 0.1])
    for q in np.random.default_rng(3).uniform(-np.pi, np.pi, (30, 6)):
        shared = model.inertia(q).shared
        assert np.array_equal(shared, shared.T)
        assert shared[0, 0] > 0


def test_wrong_arguments() -> None:
    with pytest.raises(JointIdError, match=r"q has shape \(5,\).*\(\.\.\., 6\)"):
        ROBOT.torque(np.zeros(5), np.zeros(6), np.zeros(6))
    with pytest.raises(JointIdError, match="dq: component 2 is not finite"):
        ROBOT.torque(np.zeros(6), [0, np.nan, 0, 0, 0, 0], np.zeros(6))
    with pytest.raises(JointIdError, match="do not agree"):
        ROBOT.torque(np.zeros((3, 6)), np.zeros((4, 6)), np.zeros(6))
    with pytest.raises(JointIdError, match="cannot be read"):
        RobotModel.load("/nowhere/robot.urdf")
    with pytest.raises(JointIdError, match=r"gear_ratio.* has 2 values"):
        RobotModel.parse("six.toml", SIX_AXES.encode(), gear_ratio=[1, 2])


def test_a_missing_pinocchio_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pinocchio", None)
    with pytest.raises(JointIdError, match=r'pip install "jointid\[robot\]"'):
        RobotModel.parse("arm.urdf", URDF.encode())
    assert RobotModel.parse("six.toml", SIX_AXES.encode()).n == 6
