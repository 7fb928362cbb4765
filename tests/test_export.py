"""Export: exact round trips, models that answer as the robot does, the right side of the gear."""

from __future__ import annotations

import csv
import io
import json
import re
import sys
import tomllib
import xml.etree.ElementTree as ET
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from examples import examples
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from plants import PAPER, PARALLELOGRAM, ROBOTS, SERIAL
from plants import state_space as equation_1
from scipy.io import loadmat

from jointid import (
    Analysis,
    Elasticity,
    Gear,
    Inertia,
    JointIdError,
    PlanarArm,
    motor_response,
    resonances,
)
from jointid.estimation.elasticity import Friction
from jointid.exporting import (
    LANGUAGES,
    Identification,
    Obtained,
    arm_side,
    code_listing,
    control_frd,
    control_state_space,
    from_json,
    from_toml,
    gear_table,
    identification,
    load_identification,
    modelica_table,
    mujoco_snippet,
    phasor_table,
    scipy_state_space,
    sdf_snippet,
    state_space,
    to_document,
    to_json,
    to_mat,
    to_toml,
    transfer_matrix_table,
    urdf_snippet,
)
from jointid.files.digest import study_digest

OMEGA = 2 * np.pi * np.array([0.5, 3.0, 9.9, 16.6, 26.6, 80.0])


@pytest.fixture(scope="module")
def result(analyses: dict[int, Analysis]) -> Identification:
    return identification(analyses[2])


def same(one: Identification, other: Identification) -> bool:
    """Equal to the last bit: Python writes a float so that it reads back as the same."""
    return repr(to_document(one)) == repr(to_document(other))


# --- JSON and TOML

deviations = st.sampled_from([0.0, 0.05, np.inf]) | st.floats(0, 1e30)
finite = st.floats(-1e30, 1e30, allow_subnormal=True)
texts = st.text(max_size=30).filter(lambda t: not any("\ud800" <= c <= "\udfff" for c in t))


@st.composite
def identifications(draw: st.DrawFn) -> Identification:
    n = draw(st.integers(1, 3))
    values = lambda *shape: draw(arrays(float, shape, elements=finite))  # noqa: E731
    positive = lambda *shape: np.abs(values(*shape)) + 1e-3  # noqa: E731
    friction = Friction(values(n), values(n), values(2 * n)) if draw(st.booleans()) else None
    arm = np.diag(positive(n))
    inertia = Inertia(M=positive(n), M2=arm, added=draw(st.sampled_from([None, 0.5 * arm])))
    return Identification(
        K=values(n),
        D=values(n),
        covariance=values(2 * n, 2 * n),
        friction=friction,
        delay=draw(st.none() | finite),
        delay_error=draw(st.none() | finite),
        inertia=inertia,
        poses=dict.fromkeys(draw(st.lists(texts, max_size=2)), inertia),
        nominal=Elasticity(positive(n), positive(n)) if draw(st.booleans()) else None,
        obtained=Obtained(
            version=draw(texts),
            digest=draw(texts),
            study=draw(texts),
            origin="measured",
            method="auto",
            model="elasticity",
            free_reversal=draw(finite),
            records=draw(st.integers(0, 10**6)),
            frequencies_hz=tuple(draw(st.lists(finite, min_size=1, max_size=4))),
            misfit=draw(finite),
            inertia_std=draw(deviations),
            torque_std=draw(st.none() | deviations),
        ),
    )


@examples(60, derandomize=True)
@given(identifications())
def test_json_and_toml_return_every_bit(one: Identification) -> None:
    if one.delay is None:
        one = replace(one, delay_error=None)
    for back in (from_json(to_json(one)), from_toml(to_toml(one))):
        assert same(back, one)
        assert back.K.tobytes() == one.K.tobytes()
        assert back.covariance.tobytes() == one.covariance.tobytes()


def test_the_fit_survives_as_it_is(analyses: dict[int, Analysis], tmp_path: Path) -> None:
    for n, analysis in analyses.items():
        one = identification(analysis)
        for name, text in (("a.json", to_json(one)), ("a.toml", to_toml(one))):
            (tmp_path / name).write_text(text, "utf-8")
            back = load_identification(tmp_path / name)
            assert same(back, one)
            np.testing.assert_array_equal(back.K, analysis.fit.K)
            np.testing.assert_array_equal(back.covariance, analysis.fit.covariance)
            np.testing.assert_array_equal(back.elasticity.D, analysis.fit.elasticity.D)
        assert one.obtained.digest == study_digest(analysis.study)
        assert one.obtained.records == len(analysis.study.records) == 6 * n
        assert one.obtained.frequencies_hz == pytest.approx((3.0, 7.0, 11.0, 17.0, 23.0, 29.0))


def test_nonlinear_gears_become_tables_and_secants(result: Identification) -> None:
    hard = Gear(K=float(result.K[0]), cubic=9e3, tried_rad=0.04, tried_Nm=2.3)
    one = replace(result, gears=(hard, replace(result.gears[1], backlash_rad=0.0)))
    for read, write in ((from_json, to_json), (from_toml, to_toml)):
        assert read(write(one)).gears == one.gears
    rows = list(csv.reader(io.StringIO(gear_table(one))))
    assert rows[0][:2] == ["deflection_m1_rad", "torque_m1_Nm"]
    table = np.array(rows[1:], float)
    np.testing.assert_allclose(table[:, 1], hard.torque(table[:, 0]))
    assert np.abs(table[:, 0]).max() == 0.04
    arm = arm_side(one, [100.0, 90.0])
    assert arm.K[0] == pytest.approx(100**2 * 2.3 / hard.deflection(2.3))
    assert arm.K[1] == pytest.approx(90**2 * result.K[1])
    for snippet in (mujoco_snippet, urdf_snippet):
        assert "not linear (hardening)" in snippet(one, [100.0, 90.0])


def test_tables_of_laws_hold_their_kinks(result: Identification) -> None:
    """Read as Simulink and Modelica do: columns by name, and tables of a text file by name."""
    range_ = {"tried_rad": 0.04, "tried_Nm": 1.5}
    play = Gear(K=float(result.K[0]), backlash_rad=2e-4, **range_)
    bent = Gear(K=float(result.K[1]), K2=12.0, K3=15.0, T1_Nm=0.08, T2_Nm=0.2, **range_)
    one = replace(result, gears=(play, bent))
    columns = np.genfromtxt(io.StringIO(gear_table(one)), delimiter=",", names=True)
    header, *lines = modelica_table(one).splitlines()
    assert header == "#1"
    tables = {}
    while lines:
        name, rows, width = re.fullmatch(r"double (\w+)\((\d+),(\d+)\)\s+#.*", lines.pop(0)).groups()
        tables[name] = np.array([line.split() for line in lines[: int(rows)]], float)
        assert tables[name].shape == (int(rows), int(width))
        del lines[: int(rows)]
    at = np.linspace(-0.04, 0.04, 4001)
    for j, gear in enumerate(one.gears, start=1):
        x, y = columns[f"deflection_m{j}_rad"], columns[f"torque_m{j}_Nm"]
        assert np.diff(x).min() > 0
        np.testing.assert_array_equal(tables[f"gear{j}"], np.stack([x, y], axis=1))
        np.testing.assert_allclose(np.interp(at, x, y), gear.torque(at), atol=1e-12)


def test_json_is_readable_without_this_software(result: Identification) -> None:
    document = json.loads(to_json(result))
    assert document["side"] == "motor"
    assert document["units"]["K"] == "N·m/rad"
    np.testing.assert_allclose(document["K"], PAPER.K, rtol=0.01)
    np.testing.assert_allclose(np.sqrt(np.diag(document["covariance"])), document["standard_error"])


def changed(result: Identification, **values: Any) -> str:
    return json.dumps(to_document(result) | values)


@pytest.mark.parametrize(
    ("values", "complaint"),
    [
        ({"K": [1.0]}, "K has shape"),
        ({"K": ["43", 7.5]}, "K: expected real numbers"),
        ({"kind": "something"}, "expected kind"),
        ({"format": 2}, "expected format = 1"),
        ({"side": "arm"}, "expected side"),
        ({"covariance": [[1.0]]}, "covariance has shape"),
        ({"stiffnes": 1}, 'unknown key "stiffnes"'),
        ({"inertia": {"M": [1, 1], "M2": [[1, 2], [2, 1]]}}, "positive definite"),
        ({"obtained": {}}, "version is missing"),
    ],
)
def test_a_wrong_document_is_named(
    result: Identification, values: dict[str, Any], complaint: str
) -> None:
    with pytest.raises(JointIdError, match=r"^result\.json") as caught:
        from_json(changed(result, **values), where="result.json")
    assert complaint in str(caught.value)


@pytest.mark.parametrize(
    "text", ["", "[]", "null", "{", '{"K": NaN}', "[" * 100_000, "\xff", '{"K": 1e999}']
)
def test_what_is_no_identification_is_refused(text: str) -> None:
    for read in (from_json, from_toml):
        with pytest.raises(JointIdError):
            read(text)


@examples(150, derandomize=True)
@given(st.data())
def test_damaged_files_only_raise_our_error(data: st.DataObject) -> None:
    whole = (to_json(KNOWN) if data.draw(st.booleans()) else to_toml(KNOWN)).encode()
    at = data.draw(st.integers(0, len(whole) - 1))
    cut = data.draw(st.integers(0, 40))
    damaged = whole[:at] + data.draw(st.binary(max_size=6)) + whole[at + cut :]
    for read in (from_json, from_toml):
        with suppress(JointIdError):
            assert isinstance(read(damaged), Identification)


KNOWN = Identification(
    K=PAPER.K,
    D=PAPER.D,
    covariance=np.diag([0.04, 0.01, 1e-6, 1e-8]),
    friction=Friction(np.array([0.4, 0.08]), np.array([0.002, 0.0005]), np.full(4, 1e-3)),
    delay=None,
    delay_error=None,
    inertia=SERIAL,
    poses={},
    nominal=None,
    obtained=Obtained(
        "1", "d" * 32, 'A -- <cell> & "more"', "", "auto", "elasticity", 0.0, 2, (3.0,), 1.0
    ),
)


# --- tables


def test_the_phasor_table_holds_the_phasors(analyses: dict[int, Analysis]) -> None:
    phasors = analyses[2].phasors
    rows = list(csv.DictReader(io.StringIO(phasor_table(analyses[2]))))
    for j in (1, 2):
        for values, name, unit in ((phasors.q, f"theta_m{j}", "rad"), (phasors.tau, f"tau_m{j}", "Nm")):
            read = [complex(float(r[f"{name}_re_{unit}"]), float(r[f"{name}_im_{unit}"])) for r in rows]
            np.testing.assert_array_equal(read, values[:, j - 1])
    assert [row["record"] for row in rows] == list(phasors.labels)


def test_the_table_of_H_holds_H(analyses: dict[int, Analysis]) -> None:
    matrix = analyses[3].transfer_matrices[""]
    rows = list(csv.DictReader(io.StringIO(transfer_matrix_table(analyses[3]))))
    for i in range(3):
        for j in range(3):
            name = f"H{i + 1}{j + 1}"
            read = [complex(float(r[f"{name}_re"]), float(r[f"{name}_im"])) for r in rows]
            np.testing.assert_array_equal(read, matrix.H[:, i, j])
            deviation = [float(r[f"{name}_std"]) for r in rows]
            np.testing.assert_array_equal(deviation, matrix.standard_deviation[:, i, j])
    frequency = 2 * np.pi * np.array([float(r["frequency_hz"]) for r in rows])
    np.testing.assert_allclose(frequency, matrix.omega, rtol=1e-15)


def test_H_without_friction_stands_beside_H_as_measured(analyses: dict[int, Analysis]) -> None:
    plain = analyses[2]
    raw = plain.transfer_matrices[""]
    assert "without" not in transfer_matrix_table(plain)
    assert not any("without" in name for name in loadmat(io.BytesIO(to_mat(plain))))
    friction = Friction(np.ones(2), np.zeros(2), np.zeros(4))
    found = replace(
        plain,
        fit=replace(plain.fit, friction=friction),
        freed_transfer_matrices={
            "": replace(raw, omega=raw.omega[1:], H=1.25 * raw.H[1:], covariance=raw.covariance[1:])
        },
    )
    rows = list(csv.DictReader(io.StringIO(transfer_matrix_table(found))))
    assert rows[0]["H12_without_friction_and_delay_re"] == ""  # this frequency was not to be inverted
    for name, H in (("H12", raw.H), ("H12_without_friction_and_delay", 1.25 * raw.H)):
        read = [complex(float(r[f"{name}_re"]), float(r[f"{name}_im"])) for r in rows[1:]]
        np.testing.assert_array_equal(read, H[1:, 0, 1])
    mat = loadmat(io.BytesIO(to_mat(found)), squeeze_me=True, struct_as_record=False)
    assert mat["transfer"].H.shape == (2, 2, 6)
    free = mat["transfer_without_friction_and_delay"]
    np.testing.assert_array_equal(np.moveaxis(free.H, -1, 0), 1.25 * raw.H[1:])


# --- models


def response(A: Any, B: Any, C: Any, D: Any, s: complex) -> np.ndarray:
    return np.asarray(C @ np.linalg.solve(s * np.eye(len(A)) - A, B) + D)


@pytest.mark.parametrize("n", ROBOTS)
@pytest.mark.parametrize(("output", "power"), [("acceleration", 0), ("velocity", 1), ("position", 2)])
def test_the_state_space_answers_as_the_robot(n: int, output: Any, power: int) -> None:
    inertia, elasticity = ROBOTS[n]
    model = scipy_state_space(inertia, elasticity, output=output)
    H = motor_response(OMEGA, inertia, elasticity)
    for k, omega in enumerate(OMEGA):
        found = response(model.A, model.B, model.C, model.D, 1j * omega) * (1j * omega) ** power
        np.testing.assert_allclose(found, H[k], rtol=1e-9, atol=1e-9 * np.abs(H[k]).max())


def test_the_state_space_is_minimal_and_finite_at_rest() -> None:
    model = state_space(PARALLELOGRAM, PAPER)
    assert len(model.A) == 4
    rigid = np.linalg.inv(np.diag(PARALLELOGRAM.M) + PARALLELOGRAM.M2)
    np.testing.assert_allclose(response(model.A, model.B, model.C, model.D, 0.0), rigid, rtol=1e-12)
    free = np.sort(np.abs(np.linalg.eigvals(state_space(PARALLELOGRAM, Elasticity(PAPER.K, [0, 0])).A)))
    np.testing.assert_allclose(free[::2] / (2 * np.pi), resonances(PARALLELOGRAM, PAPER), rtol=1e-12)


def test_position_has_the_poles_of_equation_1() -> None:
    A, _ = equation_1(PARALLELOGRAM, PAPER)
    model = state_space(PARALLELOGRAM, PAPER, output="position")
    moving = [
        np.sort_complex(v[np.abs(v) > 1]) for v in (np.linalg.eigvals(A), np.linalg.eigvals(model.A))
    ]
    np.testing.assert_allclose(moving[1], moving[0], rtol=1e-7)
    assert model.states == ("x1", "x2", "dx1", "dx2", "dtheta_m1", "dtheta_m2", "theta_m1", "theta_m2")


def test_python_control_gets_the_same_model_and_the_measured_H(analyses: dict[int, Analysis]) -> None:
    pytest.importorskip("control")
    analysis = analyses[2]
    elasticity = analysis.fit.elasticity
    model = control_state_space(analysis.study.inertia, elasticity)
    H = motor_response(OMEGA, analysis.study.inertia, elasticity)
    for k, omega in enumerate(OMEGA):
        np.testing.assert_allclose(model(1j * omega), H[k], rtol=1e-9)
    assert model.input_labels == ["tau_m1", "tau_m2"]
    assert model.output_labels == ["ddtheta_m1", "ddtheta_m2"]
    matrix = analysis.transfer_matrices[""]
    measured = control_frd(matrix)
    for k, omega in enumerate(matrix.omega):
        np.testing.assert_array_equal(measured(1j * omega), matrix.H[k])  # H12 is not H21: no transpose


def test_without_python_control_the_message_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(JointIdError, match=r"pip install jointid\[control\]"):
        control_state_space(PARALLELOGRAM, PAPER)


def test_an_unknown_output_is_refused() -> None:
    with pytest.raises(JointIdError, match="acceleration, velocity, position"):
        state_space(PARALLELOGRAM, PAPER, output="torque")  # type: ignore[arg-type]


# --- MATLAB


def test_matlab_gets_everything(analyses: dict[int, Analysis]) -> None:
    analysis = analyses[2]
    data = to_mat(analysis)
    assert data == to_mat(analysis)
    assert data[:116].strip() == b"MATLAB 5.0 MAT-file, written by jointid"  # no time of writing
    mat = loadmat(io.BytesIO(data), squeeze_me=True, struct_as_record=False)
    np.testing.assert_array_equal(mat["identification"].K, analysis.fit.K)
    np.testing.assert_array_equal(mat["identification"].covariance, analysis.fit.covariance)
    assert mat["identification"].obtained.digest == study_digest(analysis.study)
    matrix = analysis.transfer_matrices[""]
    assert mat["transfer"].H.shape == (2, 2, 6)  # as MATLAB's frd wants it
    np.testing.assert_array_equal(np.moveaxis(mat["transfer"].H, -1, 0), matrix.H)
    np.testing.assert_array_equal(mat["phasors"].q, analysis.phasors.q)
    H = motor_response(OMEGA[:1], analysis.inertia(), analysis.fit.elasticity)[0]
    m = mat["model"]
    np.testing.assert_allclose(response(m.A, m.B, m.C, m.D, 1j * OMEGA[0]), H, rtol=1e-9)


# --- robot models


RATIO = np.array([100.0, -90.0])


def test_the_arm_side_keeps_the_physics() -> None:
    arm = arm_side(KNOWN, RATIO)
    np.testing.assert_allclose(arm.K, [43.0 * 1e4, 7.5 * 8100], rtol=1e-15)
    np.testing.assert_allclose(
        arm.standard_error, np.sqrt(np.diag(KNOWN.covariance)) * np.tile(RATIO**2, 2)
    )
    seen = resonances(Inertia(M=arm.rotor, M2=arm.M2), Elasticity(K=arm.K, D=arm.D))
    np.testing.assert_allclose(seen, resonances(KNOWN.inertia, PAPER), rtol=1e-12)
    np.testing.assert_allclose(arm.coulomb, [0.4 * 100, 0.08 * 90])  # never negative


def test_the_serial_example_arm_has_its_own_inertia_back() -> None:
    arm = PlanarArm.example("serial")
    angle = arm.inverse((1.15, 0.0))
    known = replace(KNOWN, inertia=arm.inertia(angle))
    a, b, c = arm.moments
    M2 = arm_side(known, arm.gear_ratio).M2
    expected = [
        [a + b + 2 * c * np.cos(angle[1]), b + c * np.cos(angle[1])],
        [b + c * np.cos(angle[1]), b],
    ]
    np.testing.assert_allclose(M2, expected, rtol=1e-12)


def test_mujoco_hinges_make_the_robots_resonances() -> None:
    """Motor and spring hinge of a joint add up, so the mass matrix is [[rotor + M2, M2], [M2, M2]]."""
    root = ET.fromstring(mujoco_snippet(KNOWN, RATIO))
    joints = {j.attrib["name"]: j.attrib for j in root.iter("joint")}
    armature = np.diag([float(joints[f"joint{j}_motor"]["armature"]) for j in (1, 2)])
    stiffness = [float(joints[f"joint{j}_spring"]["stiffness"]) for j in (1, 2)]
    M2 = arm_side(KNOWN, RATIO).M2
    mass = np.block([[armature + M2, M2], [M2, M2]])
    spring = np.diag([0.0, 0.0, *stiffness])
    squared = np.sort(np.linalg.eigvals(np.linalg.solve(mass, spring)).real)[2:]
    np.testing.assert_allclose(np.sqrt(squared) / (2 * np.pi), resonances(SERIAL, PAPER), rtol=1e-9)
    assert float(joints["joint2_spring"]["damping"]) == pytest.approx(0.015 * 8100)
    assert float(joints["joint1_motor"]["frictionloss"]) == pytest.approx(40.0)
    motors = {m.attrib["joint"]: float(m.attrib["gear"]) for m in root.iter("motor")}
    assert motors == {"joint1_motor": 100.0, "joint2_motor": -90.0}


def test_urdf_has_spring_damping_reduction_and_rotor() -> None:
    root = ET.fromstring(urdf_snippet(KNOWN, RATIO, names=["a<1>", 'b"2"']))
    spring = next(j for j in root.findall("joint") if j.attrib["name"] == "a<1>_spring")
    damping = spring.find("dynamics")
    assert damping is not None
    assert float(damping.attrib["damping"]) == pytest.approx(1000.0)
    stiffness = {g.attrib["reference"]: g.findtext("springStiffness") for g in root.findall("gazebo")}
    assert float(stiffness['b"2"_spring'] or 0) == pytest.approx(7.5 * 8100)
    assert [float(e.text or 0) for e in root.iter("mechanicalReduction")] == [100.0, -90.0]
    about_axis = [float(e.attrib["izz"]) for e in root.iter("inertia")]
    np.testing.assert_allclose(about_axis[::2], RATIO**2 * SERIAL.M)
    children = [e.attrib["link"] for e in root.iter("child")]
    roots = {e.attrib["name"] for e in root.findall("link")} - set(children)
    assert len(roots) == 1  # a tree
    assert len(children) == len(set(children)) == 4


@pytest.mark.parametrize("snippet", [mujoco_snippet, urdf_snippet])
def test_mujoco_loads_them_as_they_are(snippet: Any) -> None:
    """Each joint alone is two masses with a spring between: ω² = K (1/J_a + 1/J_m)."""
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(snippet(KNOWN, RATIO))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    mass = np.zeros((model.nv, model.nv))
    for column, unit in zip(mass, np.eye(model.nv), strict=True):
        mujoco.mj_mulM(model, data, column, unit)
    arm = arm_side(KNOWN, RATIO)
    stiffness = np.zeros(model.nv)
    for j in (1, 2):
        stiffness[model.joint(f"joint{j}_spring").dofadr[0]] = arm.K[j - 1]
    squared = np.sort(np.linalg.eigvals(np.linalg.solve(mass, np.diag(stiffness))).real)[2:]
    expected = np.sort(arm.K * (1 / np.diag(arm.M2) + 1 / arm.rotor))
    np.testing.assert_allclose(squared, expected, rtol=1e-6)


@pytest.mark.parametrize("snippet", [mujoco_snippet, urdf_snippet, sdf_snippet])
def test_snippets_say_that_they_are_no_arm(snippet: Any) -> None:
    text = snippet(KNOWN, RATIO)
    assert text.index("without couplings J_12") < text.index("joint1_motor")


def test_sdf_has_spring_and_damping() -> None:
    root = ET.fromstring(sdf_snippet(KNOWN, RATIO))
    stiffness = [float(e.text or 0) for e in root.iter("spring_stiffness")]
    np.testing.assert_allclose(stiffness, RATIO**2 * PAPER.K)
    joints = {j.attrib["name"]: j for j in root.iter("joint")}
    assert float(joints["joint2_spring"].findtext("axis/dynamics/damping") or 0) == pytest.approx(121.5)
    assert joints["joint1_spring"].findtext("parent") == "joint1_rotor"


@pytest.mark.parametrize("snippet", [mujoco_snippet, urdf_snippet, sdf_snippet])
def test_snippets_say_which_side_and_refuse_bad_gears(snippet: Any) -> None:
    text = snippet(KNOWN, 100.0)
    assert "Joint side" in text
    assert "motor side: K = 43.0 N.m/rad" in text
    for ratio, complaint in [
        ([100.0], None),
        ([1.0, 2.0, 3.0], "gear_ratio has 3"),
        ([100.0, 0.0], "joint 2 is 0"),
    ]:
        if complaint is None:
            snippet(KNOWN, ratio)
            continue
        with pytest.raises(JointIdError, match=complaint):
            snippet(KNOWN, ratio)
    with pytest.raises(JointIdError, match="different name"):
        snippet(KNOWN, 100.0, names=["a", "a"])


def test_a_negative_damping_within_its_error_counts_as_zero() -> None:
    assert replace(KNOWN, D=np.array([-1e-4, 0.015])).elasticity.D[0] == 0.0
    with pytest.raises(JointIdError, match="D1"):
        _ = replace(KNOWN, D=np.array([-1.0, 0.015])).elasticity


def test_structured_text_is_a_global_variable_list(result: Identification) -> None:
    """IEC 61131-3: keywords around the declarations, a decimal point in each real literal."""
    result = replace(result, K=np.full(result.n, 43.0), D=np.full(result.n, 1e-5))
    lines = code_listing(result, "Structured Text").splitlines()
    code = [line for line in lines if not line.startswith("//")]
    n = result.n
    assert code == [
        "VAR_GLOBAL CONSTANT",
        f"    JointStiffness : ARRAY [1..{n}] OF LREAL := [{', '.join(['43.0'] * n)}];",
        f"    JointDamping : ARRAY [1..{n}] OF LREAL := [{', '.join(['1.0e-05'] * n)}];",
        "END_VAR",
    ]
    assert sum(line.startswith(("// K_std", "// D_std")) for line in lines) == 2


def test_code_is_read_by_its_language(result: Identification) -> None:
    listings = {language: code_listing(result, language) for language in LANGUAGES}
    names: dict[str, Any] = {}
    exec(listings["Python"], names)
    for read in (names, tomllib.loads(listings["TOML"])):
        assert read["K"] == pytest.approx(result.K, rel=1e-6)
        assert [*read["K_std"], *read["D_std"]] == pytest.approx(result.standard_error, rel=1e-6)
    n = result.n
    assert f"static const double D[{n}] = {{" in listings["C"]
    for text in listings.values():
        for fact in (result.obtained.version, result.obtained.digest, result.obtained.method):
            assert fact in text
    assert all(len(line) <= 80 for line in listings["Python"].splitlines() if line.startswith("#"))
    unknown = replace(result, covariance=np.diag([np.inf, *[1.0] * (2 * n - 1)]))
    assert "% K_std: not determined by the records" in code_listing(unknown, "MATLAB")
    with pytest.raises(JointIdError, match="'COBOL'"):
        code_listing(result, "COBOL")
