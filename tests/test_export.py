"""Export: exact round trips, equal models in other software, and the right side of the gear."""

from __future__ import annotations

import csv
import io
import json
import re
import sys
import tomllib
import xml.etree.ElementTree as ET
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
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
    arm_side,
    code_listing,
    control_frd,
    control_state_space,
    gear_table,
    modelica_table,
    mujoco_snippet,
    phasor_table,
    sdf_snippet,
    state_space,
    to_json,
    to_mat,
    to_toml,
    transfer_matrix_table,
    urdf_snippet,
)
from jointid.files.application import __version__
from jointid.files.digest import study_digest

OMEGA = 2 * np.pi * np.array([0.5, 3.0, 9.9, 16.6, 26.6, 80.0])


@pytest.fixture(scope="module")
def result(analyses: dict[int, Analysis]) -> Analysis:
    return analyses[2]


@pytest.fixture(scope="module")
def known(result: Analysis) -> Analysis:
    """The paper's robot on a serial arm, with friction, found exactly."""
    return with_fit(
        result,
        K=PAPER.K,
        D=PAPER.D,
        covariance=np.diag([0.04, 0.01, 1e-6, 1e-8]),
        friction=Friction(np.array([0.4, 0.08]), np.array([0.002, 0.0005]), np.full(4, 1e-3)),
        inertias=(SERIAL,) * len(result.study.records),
    )


def with_fit(analysis: Analysis, **values: Any) -> Analysis:
    return replace(analysis, fit=replace(analysis.fit, **values))


# --- JSON and TOML


def test_json_and_toml_hold_the_fit_to_the_last_bit(analyses: dict[int, Analysis]) -> None:
    for n, analysis in analyses.items():
        fit = analysis.fit
        for document in (json.loads(to_json(analysis)), tomllib.loads(to_toml(analysis))):
            for name in ("K", "D", "covariance", "standard_error"):
                assert document[name] == getattr(fit, name).tolist()
            assert document["gears"]["K"] == [gear.K for gear in fit.gears]
            assert document["inertia"]["M2"] == analysis.inertia().M2.tolist()
            assert [*document["priors"]["fitted"]] == [row.fitted for row in analysis.priors]
            obtained = document["obtained"]
            assert obtained["digest"] == study_digest(analysis.study)
            assert obtained["records"] == len(analysis.study.records) == 6 * n
            assert obtained["frequencies_hz"] == pytest.approx((3.0, 7.0, 11.0, 17.0, 23.0, 29.0))


def test_nonlinear_gears_become_tables_and_secants(result: Analysis) -> None:
    fit = result.fit
    hard = Gear(K=float(fit.K[0]), cubic=9e3, tried_rad=0.04, tried_Nm=2.3)
    one = with_fit(result, gears=(hard, replace(fit.gears[1], backlash_rad=0.0)))
    assert json.loads(to_json(one))["gears"]["cubic"] == [9e3, fit.gears[1].cubic]
    rows = list(csv.reader(io.StringIO(gear_table(one))))
    assert rows[0][:2] == ["deflection_m1_rad", "torque_m1_Nm"]
    table = np.array(rows[1:], float)
    np.testing.assert_allclose(table[:, 1], hard.torque(table[:, 0]))
    assert np.abs(table[:, 0]).max() == 0.04
    arm = arm_side(one, [100.0, 90.0])
    assert arm.K[0] == pytest.approx(100**2 * 2.3 / hard.deflection(2.3))
    assert arm.K[1] == pytest.approx(90**2 * fit.K[1])
    for snippet in (mujoco_snippet, urdf_snippet):
        assert "nonlinear (hardening)" in snippet(one, [100.0, 90.0])
    assert json.loads(to_json(one))["gears"]["secant_K"][0] == pytest.approx(hard.secant(2.3))
    names: dict[str, Any] = {}
    exec(code_listing(one, "Python"), names)
    assert names["K"] == pytest.approx(fit.K, rel=1e-6)
    assert names["K_secant"][0] == pytest.approx(hard.secant(2.3), rel=1e-6)
    assert names["T_secant"][0] == 2.3
    for language in LANGUAGES:
        text = " ".join(code_listing(one, language).split())
        assert "gear of joint 1: law hardening" in text
        assert "K_secant" not in code_listing(result, language)


def test_tables_of_laws_hold_their_kinks(result: Analysis) -> None:
    """Read as Simulink and Modelica do: columns by name, and tables of a text file by name."""
    range_ = {"tried_rad": 0.04, "tried_Nm": 1.5}
    play = Gear(K=float(result.fit.K[0]), backlash_rad=2e-4, **range_)
    bent = Gear(K=float(result.fit.K[1]), K2=12.0, K3=15.0, T1_Nm=0.08, T2_Nm=0.2, **range_)
    one = with_fit(result, gears=(play, bent))
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
    for j, gear in enumerate((play, bent), start=1):
        x, y = columns[f"deflection_m{j}_rad"], columns[f"torque_m{j}_Nm"]
        assert np.diff(x).min() > 0
        np.testing.assert_array_equal(tables[f"gear{j}"], np.stack([x, y], axis=1))
        np.testing.assert_allclose(np.interp(at, x, y), gear.torque(at), atol=1e-12)


def test_json_is_read_by_the_standard_library(result: Analysis) -> None:
    document = json.loads(to_json(result))
    assert document["side"] == "motor"
    assert document["units"]["K"] == "N·m/rad"
    np.testing.assert_allclose(document["K"], PAPER.K, rtol=0.01)
    np.testing.assert_allclose(np.sqrt(np.diag(document["covariance"])), document["standard_error"])


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


def test_H_without_friction_is_exported_beside_H_as_measured(analyses: dict[int, Analysis]) -> None:
    plain = analyses[2]
    raw = plain.transfer_matrices[""]
    assert "without" not in transfer_matrix_table(plain)
    assert not any("without" in name for name in loadmat(io.BytesIO(to_mat(plain))))
    friction = Friction(np.ones(2), np.zeros(2), np.zeros(4))
    found = replace(
        plain,
        fit=replace(plain.fit, friction=friction),
        compensated_transfer_matrices={
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
def test_the_state_space_has_the_response_of_the_robot(n: int) -> None:
    inertia, elasticity = ROBOTS[n]
    model = state_space(inertia, elasticity)
    H = motor_response(OMEGA, inertia, elasticity)
    for k, omega in enumerate(OMEGA):
        found = response(model.A, model.B, model.C, model.D, 1j * omega)
        np.testing.assert_allclose(found, H[k], rtol=1e-9, atol=1e-9 * np.abs(H[k]).max())


def test_the_state_space_is_minimal_and_finite_at_rest() -> None:
    model = state_space(PARALLELOGRAM, PAPER)
    assert len(model.A) == 4
    rigid = np.linalg.inv(np.diag(PARALLELOGRAM.M) + PARALLELOGRAM.M2)
    np.testing.assert_allclose(response(model.A, model.B, model.C, model.D, 0.0), rigid, rtol=1e-12)
    damped, _ = equation_1(PARALLELOGRAM, PAPER)
    poles = [np.linalg.eigvals(A) for A in (damped, model.A)]
    of_equation_1, found = (np.sort_complex(v[np.abs(v) > 1]) for v in poles)
    np.testing.assert_allclose(found, of_equation_1, rtol=1e-7)
    free = np.sort(np.abs(np.linalg.eigvals(state_space(PARALLELOGRAM, Elasticity(PAPER.K, [0, 0])).A)))
    np.testing.assert_allclose(free[::2] / (2 * np.pi), resonances(PARALLELOGRAM, PAPER), rtol=1e-12)


def test_python_control_receives_the_model_and_the_measured_H(analyses: dict[int, Analysis]) -> None:
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
    with pytest.raises(JointIdError, match=r'pip install "jointid\[control\]"'):
        control_state_space(PARALLELOGRAM, PAPER)


# --- MATLAB


def test_matlab_file_holds_all_results(analyses: dict[int, Analysis]) -> None:
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


def test_a_name_with_hyphens_leaves_the_xml_valid(known: Analysis) -> None:
    named = replace(known, study=replace(known.study, name="cell---7--"))
    ET.fromstring(mujoco_snippet(named, RATIO))


def test_arm_side_values_give_the_same_resonances(known: Analysis) -> None:
    arm = arm_side(known, RATIO)
    np.testing.assert_allclose(arm.K, [43.0 * 1e4, 7.5 * 8100], rtol=1e-15)
    seen = resonances(Inertia(M=arm.rotor, M2=arm.M2), Elasticity(K=arm.K, D=arm.D))
    np.testing.assert_allclose(seen, resonances(SERIAL, PAPER), rtol=1e-12)
    np.testing.assert_allclose(arm.coulomb, [0.4 * 100, 0.08 * 90])  # never negative


def test_the_exported_serial_arm_has_its_original_inertia(known: Analysis) -> None:
    arm = PlanarArm.example("serial")
    angle = arm.inverse((1.15, 0.0))
    records = len(known.study.records)
    known = with_fit(known, inertias=(arm.inertia(angle),) * records)
    a, b, c = arm.moments
    M2 = arm_side(known, arm.gear_ratio).M2
    expected = [
        [a + b + 2 * c * np.cos(angle[1]), b + c * np.cos(angle[1])],
        [b + c * np.cos(angle[1]), b],
    ]
    np.testing.assert_allclose(M2, expected, rtol=1e-12)


def test_mujoco_hinges_have_the_resonances_of_the_robot(known: Analysis) -> None:
    """Motor and spring hinge of a joint add up, so the mass matrix is [[rotor + M2, M2], [M2, M2]]."""
    root = ET.fromstring(mujoco_snippet(known, RATIO))
    joints = {j.attrib["name"]: j.attrib for j in root.iter("joint")}
    armature = np.diag([float(joints[f"joint{j}_motor"]["armature"]) for j in (1, 2)])
    stiffness = [float(joints[f"joint{j}_spring"]["stiffness"]) for j in (1, 2)]
    M2 = arm_side(known, RATIO).M2
    mass = np.block([[armature + M2, M2], [M2, M2]])
    spring = np.diag([0.0, 0.0, *stiffness])
    squared = np.sort(np.linalg.eigvals(np.linalg.solve(mass, spring)).real)[2:]
    np.testing.assert_allclose(np.sqrt(squared) / (2 * np.pi), resonances(SERIAL, PAPER), rtol=1e-9)
    assert float(joints["joint2_spring"]["damping"]) == pytest.approx(0.015 * 8100)
    assert float(joints["joint1_motor"]["frictionloss"]) == pytest.approx(40.0)
    motors = {m.attrib["joint"]: float(m.attrib["gear"]) for m in root.iter("motor")}
    assert motors == {"joint1_motor": 100.0, "joint2_motor": -90.0}


def test_urdf_has_spring_damping_reduction_and_rotor(known: Analysis) -> None:
    root = ET.fromstring(urdf_snippet(known, RATIO))
    spring = next(j for j in root.findall("joint") if j.attrib["name"] == "joint1_spring")
    damping = spring.find("dynamics")
    assert damping is not None
    assert float(damping.attrib["damping"]) == pytest.approx(1000.0)
    stiffness = {g.attrib["reference"]: g.findtext("springStiffness") for g in root.findall("gazebo")}
    assert float(stiffness["joint2_spring"] or 0) == pytest.approx(7.5 * 8100)
    assert [float(e.text or 0) for e in root.iter("mechanicalReduction")] == [100.0, -90.0]
    about_axis = [float(e.attrib["izz"]) for e in root.iter("inertia")]
    np.testing.assert_allclose(about_axis[::2], RATIO**2 * SERIAL.M)
    children = [e.attrib["link"] for e in root.iter("child")]
    roots = {e.attrib["name"] for e in root.findall("link")} - set(children)
    assert len(roots) == 1  # a tree
    assert len(children) == len(set(children)) == 4


@pytest.mark.parametrize("snippet", [mujoco_snippet, urdf_snippet])
def test_mujoco_loads_them_as_they_are(snippet: Any, known: Analysis) -> None:
    """Each joint alone is two masses with a spring between: ω² = K (1/J_a + 1/J_m)."""
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(snippet(known, RATIO))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    mass = np.zeros((model.nv, model.nv))
    for column, unit in zip(mass, np.eye(model.nv), strict=True):
        mujoco.mj_mulM(model, data, column, unit)
    arm = arm_side(known, RATIO)
    stiffness = np.zeros(model.nv)
    for j in (1, 2):
        stiffness[model.joint(f"joint{j}_spring").dofadr[0]] = arm.K[j - 1]
    squared = np.sort(np.linalg.eigvals(np.linalg.solve(mass, np.diag(stiffness))).real)[2:]
    expected = np.sort(arm.K * (1 / np.diag(arm.M2) + 1 / arm.rotor))
    np.testing.assert_allclose(squared, expected, rtol=1e-6)


@pytest.mark.parametrize("snippet", [mujoco_snippet, urdf_snippet, sdf_snippet])
def test_snippets_state_that_they_are_no_complete_arm(snippet: Any, known: Analysis) -> None:
    text = snippet(known, RATIO)
    assert text.index("without couplings J_12") < text.index("joint1_motor")


def test_sdf_has_spring_and_damping(known: Analysis) -> None:
    root = ET.fromstring(sdf_snippet(known, RATIO))
    stiffness = [float(e.text or 0) for e in root.iter("spring_stiffness")]
    np.testing.assert_allclose(stiffness, RATIO**2 * PAPER.K)
    joints = {j.attrib["name"]: j for j in root.iter("joint")}
    assert float(joints["joint2_spring"].findtext("axis/dynamics/damping") or 0) == pytest.approx(121.5)
    assert joints["joint1_spring"].findtext("parent") == "joint1_rotor"


@pytest.mark.parametrize("snippet", [mujoco_snippet, urdf_snippet, sdf_snippet])
def test_snippets_name_the_gear_side_and_refuse_invalid_ratios(snippet: Any, known: Analysis) -> None:
    text = snippet(known, 100.0)
    assert "Joint side" in text
    assert "motor side: K = 43.0 N.m/rad" in text
    for ratio, complaint in [
        ([100.0], None),
        ([1.0, 2.0, 3.0], "gear_ratio has 3"),
        ([100.0, 0.0], "joint 2 is 0"),
    ]:
        if complaint is None:
            snippet(known, ratio)
            continue
        with pytest.raises(JointIdError, match=complaint):
            snippet(known, ratio)
    hostile = replace(known, study=replace(known.study, name='A -- <cell> & "more"'))
    assert ET.fromstring(snippet(hostile, 100.0)).tag == ET.fromstring(text).tag


def test_a_negative_damping_within_its_error_counts_as_zero(known: Analysis) -> None:
    assert arm_side(with_fit(known, D=np.array([-1e-4, 0.015])), RATIO).D[0] == 0.0
    with pytest.raises(JointIdError, match="D1"):
        arm_side(with_fit(known, D=np.array([-1.0, 0.015])), RATIO)


def test_structured_text_is_a_global_variable_list(result: Analysis) -> None:
    """IEC 61131-3: keywords around the declarations, a decimal point in each real literal."""
    n = result.fit.n
    result = with_fit(result, K=np.full(n, 43.0), D=np.full(n, 1e-5))
    lines = code_listing(result, "Structured Text").splitlines()
    code = [line for line in lines if not line.startswith("//")]
    assert code == [
        "VAR_GLOBAL CONSTANT",
        f"    JointStiffness : ARRAY [1..{n}] OF LREAL := [{', '.join(['43.0'] * n)}];",
        f"    JointDamping : ARRAY [1..{n}] OF LREAL := [{', '.join(['1.0e-05'] * n)}];",
        "END_VAR",
    ]
    assert sum(line.startswith(("// K_std", "// D_std")) for line in lines) == 2
    known = replace(result, study=replace(result.study, gear_ratio=[100.0] * (n - 1) + [-90.0]))
    added = set(code_listing(known, "Structured Text").splitlines()) - set(lines)
    ratios = f"    JointGearRatio : ARRAY [1..{n}] OF LREAL := [{'100.0, ' * (n - 1)}-90.0];"
    assert ratios in added


def test_exported_code_is_parsed_by_its_language(result: Analysis) -> None:
    listings = {language: code_listing(result, language) for language in LANGUAGES}
    names: dict[str, Any] = {}
    exec(listings["Python"], names)
    for read in (names, tomllib.loads(listings["TOML"])):
        assert read["K"] == pytest.approx(result.fit.K, rel=1e-6)
        errors = [*read["K_std"], *read["D_std"]]
        assert errors == pytest.approx(result.fit.standard_error, rel=1e-6)
    n = result.fit.n
    assert f"static const double D[{n}] = {{" in listings["C"]
    for text in listings.values():
        for fact in (__version__, study_digest(result.study), result.fit.method):
            assert fact in text
    remarks = [line for line in listings["Python"].splitlines() if line.startswith("#")]
    assert all(len(line) <= 80 for line in remarks)
    assert not any(line.endswith(("±", " ")) or line.startswith("# ±") for line in remarks)
    unknown = with_fit(result, covariance=np.diag([np.inf, *[1.0] * (2 * n - 1)]))
    assert "% K_std: not determined by the records" in code_listing(unknown, "MATLAB")
    with pytest.raises(JointIdError, match="'COBOL'"):
        code_listing(result, "COBOL")
