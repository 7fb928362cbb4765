"""Entry of inertias: numbers on either side of the gears, TOML, and links of an arm."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from app_pages import shown
from hypothesis import given
from hypothesis import strategies as some
from streamlit.testing.v1 import AppTest
from test_import_page import PAGE, drop, long_log, send, widget

from jointid import Inertia, JointIdError, PlanarArm, RobotModel, Study
from jointid.cli.convert import with_gears_of
from jointid.files.study_files import load_study
from jointid.importing import Channel, JointMapping, Mapping, TimeColumn
from jointid.importing.robot_inertia import INERTIA_UNITS, motor_side, robot_from_toml, rotor_at_motor
from jointid.ui.importing.inertia import show_inertia
from jointid.ui.shared.entries import deviation_in, deviation_text
from tests.robots import SIX_AXES

TOML = """
name = "Cell 7"
[inertia]
M = [0.001]
M2 = [[0.003]]
[nominal]
K = [20.0]
D = [0.1]
[poses.stretched]
M2 = [[0.005]]
"""


def test_a_robot_model_gives_gear_ratios_that_were_assumed() -> None:
    """They stayed 1, and the study contradicted its own robot model."""
    model = RobotModel.parse("two.toml", "[[link]]".join(SIX_AXES.split("[[link]]")[:3]).encode())
    ratios = (1.0, -70.0)
    joints = [
        JointMapping(Channel(f"q{N}", "deg", side="joint"), Channel(f"tau{N}", "N·m"), N) for N in ratios
    ]
    assumed = ("gear ratio of joint 1", "gear ratio of joint 2")
    mapping = Mapping(TimeColumn("t"), tuple(joints), assumed=assumed)
    found = with_gears_of(model, mapping)
    assert [joint.gear_ratio for joint in found.joints] == [model.gear_ratio[0], -70.0]
    confirmed = replace(mapping, assumed=())
    assert with_gears_of(model, confirmed) == confirmed
    assert with_gears_of(None, mapping) is mapping
    coupled = replace(model, coupling=model.coupling + 1e-3 * np.eye(2, k=-1))
    assert with_gears_of(coupled, mapping) == mapping


@given(some.integers(1, 4), some.integers(0, 2**32 - 1))
def test_joint_side_inertias_keep_the_kinetic_energy(n: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    ratio = rng.uniform(30, 200, n) * rng.choice([-1, 1], n)
    root = rng.standard_normal((n, n))
    arm, rotor = root @ root.T + np.eye(n), rng.uniform(1, 50, n)
    joint_rate = rng.standard_normal(n)
    motor_rate = ratio * joint_rate
    joints = joint_rate @ (arm + np.diag(rotor)) @ joint_rate
    inertia = Inertia(rotor_at_motor(rotor, ratio), motor_side(arm, ratio))
    assert motor_rate @ (inertia.M2 + np.diag(inertia.M)) @ motor_rate == pytest.approx(joints)


def test_an_arm_agrees_with_its_own_mass_matrix() -> None:
    arm = PlanarArm.example("serial")
    pose = np.array([-0.5, 1.3])
    assert motor_side(arm.mass_matrix(pose), arm.gear_ratio) == pytest.approx(arm.inertia(pose).M2)


def test_units_are_those_of_the_tables() -> None:
    assert INERTIA_UNITS["lb·ft²"] == pytest.approx(0.0421401101)
    assert INERTIA_UNITS["lb·in²"] == pytest.approx(2.92639653e-4)
    assert INERTIA_UNITS["kg·mm²"] * 1e6 == INERTIA_UNITS["kg·cm²"] * 1e4 == INERTIA_UNITS["kg·m²"]


class TestToml:
    def test_a_whole_study_file_is_read(self) -> None:
        robot = robot_from_toml("format = 1\n" + TOML + '[[records]]\nfile = "1.csv"\n')
        assert robot.name == "Cell 7"
        assert pytest.approx(np.array([[0.003]])) == robot.inertia.M2
        assert pytest.approx([0.001]) == robot.poses["stretched"].M
        assert robot.nominal is not None
        assert pytest.approx([20.0]) == robot.nominal.K

    def test_joint_angles_take_the_inertia_from_the_robots_model(self) -> None:
        text = '[robot_model]\nfile = "six.toml"\n[inertia]\nangles_deg = [5, -20, 15, 10, 30, 0]\n'
        robot = robot_from_toml(text, read=lambda name: SIX_AXES.encode())
        model = RobotModel.parse("six.toml", SIX_AXES.encode())
        expected = model.inertia(np.deg2rad([5, -20, 15, 10, 30, 0]))
        np.testing.assert_array_equal(robot.inertia.M2, expected.M2)
        assert robot.robot_model is not None  # a study takes it, for the deflection of its tool
        np.testing.assert_allclose(robot.pose_angles_rad[""][:2], np.deg2rad([5, -20]))

    def test_plain_values_are_read(self) -> None:
        assert robot_from_toml("M = 0.001\nM2 = 0.002").inertia.n == 1

    def test_uncertainties_and_payloads_are_read(self) -> None:
        robot = robot_from_toml(
            "[inertia]\nM = 0.001\nM2 = 0.002\nstd = 0.03\n[torque]\nstd = inf\n"
            "[poses.loaded]\nadded = 0.0005\n"
        )
        assert (robot.inertia_std, robot.torque_std) == (0.03, np.inf)
        assert pytest.approx(np.array([[0.0025]])) == robot.poses["loaded"].M2
        assert robot.poses["loaded"].added == pytest.approx(np.array([[0.0005]]))
        assert robot_from_toml("M = 0.001\nM2 = 0.002\nstd = 0").inertia_std == 0.0
        plain = robot_from_toml("M = 0.001\nM2 = 0.002")
        assert (plain.inertia_std, plain.torque_std) == (None, None)

    @pytest.mark.parametrize(
        ("text", "said"),
        [
            ("", "[inertia] is missing"),
            pytest.param(SIX_AXES, "describes a robot model, not inertias", id="robot file"),
            ("M = [1]", "M2 is missing"),
            ("[inertia]\nM = [0.1]\nM2 = [[0.1, 0.2]]", "M2 has shape"),
            ("[inertia]\nM = [0.1]\nM2 = 'x'", "M2 must be"),
            ("[inertia]\nM3 = [0.1]", 'unknown key "M3"'),
            ("[inertias]\nM = [0.1]", 'unknown key "inertias"'),
            ("M = 0,1", "not valid TOML"),
            ("M = 0.1\nM2 = 0.1\nstd = 'good'", "std must be a relative standard deviation"),
            ("M = 0.1\nM2 = 0.1\n[torque]\nstd = -1", "[torque]: std must be"),
        ],
    )
    def test_a_wrong_entry_is_named(self, text: str, said: str) -> None:
        with pytest.raises(JointIdError) as caught:
            robot_from_toml(text)
        assert said in str(caught.value)


@pytest.mark.parametrize("ratio", [[0.0], [1.0, 2.0], [np.nan]])
def test_ratios_that_do_not_fit_are_refused(ratio: list[float]) -> None:
    with pytest.raises(JointIdError):
        motor_side([[1.0]], ratio)
    with pytest.raises(JointIdError):
        rotor_at_motor([1.0], ratio)


@pytest.fixture
def page(app: AppTest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> AppTest:
    monkeypatch.setenv("JOINTID_DATA_DIR", str(tmp_path / "data"))
    return shown(app.switch_page(PAGE).run())


@pytest.fixture
def taken(monkeypatch: pytest.MonkeyPatch) -> list[Inertia]:
    """The inertias that the page shows, whenever it shows some."""
    seen: list[Inertia] = []

    def show(robot: object) -> None:
        seen.append(robot.inertia)  # type: ignore[attr-defined]
        show_inertia(robot)  # type: ignore[arg-type]

    monkeypatch.setattr("jointid.ui.importing.study.show_inertia", show)
    return seen


def source(at: AppTest, name: str) -> AppTest:
    at.button_group(key="import inertia source").set_value(name)
    return shown(at.run())


def test_joint_side_numbers_are_divided_by_the_gear_ratios(page: AppTest, taken: list[Inertia]) -> None:
    at = drop(page, ("one.csv", long_log()))
    widget(at, "text_input", "Gear ratios").set_value("-50")
    at.selectbox(key="import M side").set_value("joint side")
    at.selectbox(key="import M2 side").set_value("joint side")
    at.selectbox(key="import M2 unit").set_value("kg·cm²")
    at.text_input(key="import M").set_value("2.5")
    at.text_input(key="import M2").set_value("75000")
    at = shown(at.run())
    assert not at.error
    assert pytest.approx([0.001]) == taken[-1].M
    assert pytest.approx(np.array([[0.003]])) == taken[-1].M2
    assert any("-50" in caption.value or "−50" in caption.value for caption in at.caption)


def test_toml_with_poses_is_pasted_and_a_log_has_its_pose(page: AppTest, tmp_path: Path) -> None:
    at = source(drop(page, ("one.csv", long_log())), "TOML")
    at.text_area(key="import toml").set_value(TOML)
    at = shown(at.run())
    assert at.text_input(key="import name").placeholder == "Cell 7"
    widget(at, "selectbox", "Pose of one.csv").set_value("stretched")
    widget(at, "button", "Open as study").click()
    at = shown(at.run())
    assert at.title[0].value == "Cell 7"
    (file,) = [f for f in tmp_path.rglob("*.data") if f.read_bytes()[:2] == b"PK"]
    study = load_study(file.read_bytes())
    assert {record.pose for record in study.records} == {"stretched"}
    assert pytest.approx(np.array([[0.005]])) == study.poses["stretched"].M2
    assert study.nominal is not None


def test_a_toml_file_fills_the_text_that_can_be_corrected(page: AppTest, taken: list[Inertia]) -> None:
    at = source(drop(page, ("one.csv", long_log())), "TOML")
    at.file_uploader(key="import_toml_file 0").set_value(("robot.toml", TOML.encode(), "text/plain"))
    at = shown(at.run())
    assert at.text_area(key="import toml").value == TOML
    assert pytest.approx([0.001]) == taken[-1].M
    at.text_area(key="import toml").set_value("M = 0.002\nM2 = [[0.003]")
    at = shown(at.run())
    assert "not valid TOML" in at.error[0].value
    assert at.text_area(key="import toml").value.startswith("M = 0.002")


def opened(at: AppTest, tmp_path: Path) -> Study:
    """Open the import as a study, and return what is kept of it."""
    widget(at, "button", "Open as study").click()
    shown(at.run())
    (file,) = [f for f in tmp_path.rglob("*.data") if f.read_bytes()[:2] == b"PK"]
    return load_study(file.read_bytes())


@pytest.mark.parametrize(
    ("chosen", "expected"),
    [
        ((), (0.05, None)),
        (("exact", "exact"), (0.0, 0.0)),
        (("± 3 %", "unknown"), (0.03, np.inf)),
        (("unknown", "± 2 %"), (np.inf, 0.02)),
    ],
)
def test_the_page_asks_how_well_inertias_and_torque_scale_are_known(
    page: AppTest, tmp_path: Path, chosen: tuple[str, ...], expected: tuple[float, float | None]
) -> None:
    at = drop(page, ("one.csv", long_log()))
    for what, value in zip(("inertia", "torque"), chosen, strict=False):
        at.selectbox(key=f"import {what} std").set_value(value)
    at.text_input(key="import M").set_value("0.001")
    at.text_input(key="import M2").set_value("0.003")
    study = opened(at, tmp_path)
    assert (study.inertia_std, study.torque_std) == expected


def test_values_stated_in_the_toml_are_not_asked(page: AppTest, tmp_path: Path) -> None:
    at = source(drop(page, ("one.csv", long_log())), "TOML")
    toml = "M = 0.001\nM2 = 0.003\nstd = 0.02\n[torque]\nstd = 0.04\n[poses.loaded]\nadded = 0.001"
    at.text_area(key="import toml").set_value(toml)
    at = shown(at.run())
    assert not [box for box in at.selectbox if box.label.startswith("How well")]
    assert any("M and M2: ± 2 %. Torque scale: ± 4 %." in note.value for note in at.caption)
    study = opened(at, tmp_path)
    assert (study.inertia_std, study.torque_std) == (0.02, 0.04)
    assert study.poses["loaded"].added.tolist() == [[0.001]]


@pytest.mark.parametrize(
    ("text", "std"),
    [
        ("exact", 0.0), ("unknown", np.inf), ("± 7 %", 0.07), ("7", 0.07), ("2,5%", 0.025),
        ("0.5 %", 0.005), ("0", 0.0), (" ±10 % ", 0.1),
    ],
)  # fmt: skip
def test_a_percentage_may_be_typed(text: str, std: float) -> None:
    assert deviation_in("M and M2", text) == pytest.approx(std)
    assert deviation_in("M and M2", deviation_text(std)) == pytest.approx(std)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("-3 %", "give a percentage such as 5 %"),
        ("nan", "give a percentage such as 5 %"),
        ("0.03", "write 3 % or 0.03 %"),
        ("good", '"good" is not a number'),
        ("", "is not a number"),
        ("1 2", "2 values"),
    ],
)
def test_an_invalid_percentage_is_an_error(text: str, said: str) -> None:
    with pytest.raises(JointIdError, match=f"M and M2.*{said}"):
        deviation_in("M and M2", text)


def test_links_give_the_inertia_of_the_pose(page: AppTest, taken: list[Inertia]) -> None:
    time, theta, tau = _two_joints()
    at = source(drop(page, ("two.csv", _csv(time, theta, tau))), "Links of the arm")
    widget(at, "text_input", "Gear ratios").set_value("100, 90")
    at.selectbox(key="import length unit").set_value("mm")
    at.selectbox(key="import drive").set_value("joint 2 (serial)")
    for key, text in {
        "length": "705, 755",
        "mass": "45, 70",
        "centre": "300, 300",
        "link": "2.2, 9.0",
        "rotor": "0.0025, 0.0010",
        "pose": "-30, 75",
    }.items():
        at.text_input(key=f"import {key}").set_value(text)
        if key in ("rotor", "pose"):
            assert not taken
            at = shown(at.run())
    expected = PlanarArm.example("serial").inertia(np.radians([-30.0, 75.0]))
    assert pytest.approx(expected.M2) == taken[-1].M2
    assert pytest.approx(expected.M) == taken[-1].M
    at = source(source(at, "Numbers"), "Links of the arm")
    assert at.text_input(key="import length").value == "705, 755"


def test_links_of_an_arm_with_another_number_of_joints(page: AppTest) -> None:
    at = source(drop(page, ("one.csv", long_log())), "Links of the arm")
    for key in ("length", "mass", "centre", "link", "rotor", "pose"):
        at.text_input(key=f"import {key}").set_value("1, 1")
    at = shown(at.run())
    assert "have 2 joints, but step 2 has 1" in at.error[0].value


def test_a_robot_model_gives_the_inertia_of_the_pose(page: AppTest, taken: list[Inertia]) -> None:
    time, theta, tau = _two_joints()
    at = source(drop(page, ("two.csv", _csv(time, theta, tau))), "Robot model")
    two = "[[link]]".join(SIX_AXES.split("[[link]]")[:3])
    uploader = next(u for u in at.file_uploader if u.label.startswith("Robot model"))
    at = shown(uploader.set_value(("arm.toml", two.encode(), "application/toml")).run())
    at = shown(next(b for b in at.button if b.label == "Open as study").click().run())
    assert not taken
    assert at.error[0].value.startswith("Joint angles are missing")
    at = shown(at.text_input(key="import model pose").set_value("-60, 30").run())
    expected = RobotModel.parse("arm.toml", two.encode()).inertia(np.radians([-60.0, 30.0]))
    assert pytest.approx(expected.M2) == taken[-1].M2
    assert "arm.toml" in [caption.value for caption in at.caption]


def test_gear_ratios_are_those_of_a_robot_model_given_in_their_step(page: AppTest) -> None:
    time, theta, tau = _two_joints()
    at = drop(page, ("two.csv", _csv(time, theta, tau)))
    two = "[[link]]".join(SIX_AXES.split("[[link]]")[:3]).encode()
    model = RobotModel.parse("arm.toml", two)

    def given(at: AppTest, name: str, data: bytes) -> AppTest:
        uploader = next(u for u in at.file_uploader if u.label.startswith("Robot model with gear"))
        return shown(uploader.set_value((name, data, "")).run())

    at = given(at, "six.toml", SIX_AXES.encode())
    assert "The robot model has 6 joints, but step 2 has 2." in [box.value for box in at.error]
    at = given(at, "arm.toml", two)
    ratios = widget(at, "text_input", "Gear ratios, one per joint")
    assert [float(N) for N in ratios.value.split(",")] == model.gear_ratio.tolist()
    assert not at.error
    assert at.segmented_control(key="import inertia source").value == "Robot model"
    assert at.text_input(key="import model pose").value == ""  # the angles of the log are still asked
    at = given(shown(ratios.set_value("7, 8").run()), "again.toml", two)
    assert (
        widget(at, "text_input", "Gear ratios, one per joint").value == "7, 8"
    )  # what was entered stays


def _two_joints() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    time = np.arange(0, 2, 2e-3)
    wave = np.sin(2 * np.pi * 5 * time)
    return time, np.column_stack([0.1 * wave, -0.1 * wave]), np.column_stack([wave, 0.5 * wave])


def _csv(time: np.ndarray, theta: np.ndarray, tau: np.ndarray) -> bytes:
    lines = [",".join(f"{v:.9g}" for v in row) for row in np.column_stack([time, theta, tau])]
    return "\n".join(["time_s,theta_m1_rad,theta_m2_rad,tau_m1_Nm,tau_m2_Nm", *lines, ""]).encode()


def test_a_form_with_missing_entries_names_them(page: AppTest) -> None:
    at = send(drop(page, ("one.csv", long_log())), "0.001", "")
    assert "Inertias are missing" in at.error[0].value
