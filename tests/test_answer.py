"""Texts of an answer: sentence, state, error bars, inertias."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.io import loadmat

from jointid import (
    Analysis,
    Elasticity,
    Finding,
    Inertia,
    Study,
    analyse,
    extract_phasors,
    identify_elasticity,
    load_study,
)
from jointid.analysis import answer_state
from jointid.answer import (
    StiffnessUnit,
    answer_sentence,
    change_from,
    elasticity_quantities,
    friction_note,
    further_quantities,
    model_name,
    without,
)
from jointid.estimation.estimators.parameters import EFFECTS, PARAMETERS, ParameterLayout
from jointid.estimation.quantities import quantities
from jointid.exporting import (
    LANGUAGES,
    code_listing,
    gear_table,
    modelica_table,
    mujoco_snippet,
    to_json,
    to_mat,
    to_toml,
    urdf_snippet,
)
from jointid.exporting.identification import answer_text
from jointid.fleet.row import row_of
from jointid.fleet.table import as_table
from jointid.reporting.blocks import Paragraph, Table
from jointid.reporting.report import make_report, to_html
from jointid.uncertainty.answer_tables import compared_models, error_parts, error_table
from jointid.verdict.findings import ranked
from jointid.wording import significant


def fit(K: list[float], error: float = 0.01) -> SimpleNamespace:
    n = len(K)
    layout = ParameterLayout.of(n)
    p, errors = layout.named(layout.pack(K=K, D=[0.1] * n)), layout.named(np.full(2 * n, error))
    return SimpleNamespace(
        n=n, K=p.K, D=p.D, estimate=p.vector, standard_error=errors.vector, parameters=p, errors=errors
    )


def sentence(
    found: SimpleNamespace, nominal: Elasticity | None = None, *, torque_stated: bool = True
) -> str:
    """The answer of a fit, motor side."""
    known = None if nominal is None else np.concatenate([nominal.K, nominal.D])
    shown = elasticity_quantities(found)  # type: ignore[arg-type]
    return answer_sentence(shown, known, torque_stated=torque_stated)


@pytest.mark.parametrize(
    ("K", "nominal", "said"),
    [
        ([44.0, 7.5], [20.0, 3.5], "Joint 1 is 2.2 times as stiff as nominal"),
        ([44.0, 7.5], [20.0, 3.5], "joint 2 is 2.1 times as stiff."),
        ([7.5, 7.5], [3.5, 3.5], "Every joint is 2.1 times as stiff as nominal."),
        ([43.0], [40.0], "Joint 1 is 7.5 % stiffer than nominal."),
        ([36.0], [40.0], "Joint 1 is 10 % softer than nominal."),
        ([10.0], [40.0], "Joint 1 is 0.25 times as stiff as nominal."),
        ([40.2], [40.0], "Joint 1 has its nominal stiffness."),
        ([43.0, 3.5], [20.0, 3.5], "joint 2 has its nominal stiffness."),
        (
            [14.3, 14.2, 10.0, 14.4, 10.0, 7.0],
            [10.0] * 6,
            "Joints 1, 2 and 4 are 42 to 44 % stiffer than nominal; joints 3 and 5 have their nominal "
            "stiffness; joint 6 is 30 % softer than nominal.",
        ),
        ([14.3, 14.2, 14.4], [10.0] * 3, "Every joint is 42 to 44 % stiffer than nominal."),
    ],
)
def test_against_the_nominal_stiffness(K: list[float], nominal: list[float], said: str) -> None:
    assert said in sentence(fit(K), Elasticity(nominal, [0.1] * len(K)))


def test_a_difference_within_the_uncertainty_is_not_reported() -> None:
    said = sentence(fit([43.5], error=1.0), Elasticity([42.0], [0.1]))
    assert said == "Joint 1 has its nominal stiffness."


def test_without_a_nominal_stiffness() -> None:
    assert sentence(fit([43.0, 7.5])) == (
        "The stiffness of joint 1 is 43.000 ± 0.010 N·m/rad, and that of joint 2 is 7.500 ± 0.010 "
        "N·m/rad, seen from the motor."
    )


@pytest.mark.parametrize("K", [-3.0, 0.015, float("nan")])
def test_undetermined_values_are_left_out_of_the_answer(K: float) -> None:
    assert sentence(fit([43.0, K])) == (
        "The stiffness of joint 1 is 43.000 ± 0.010 N·m/rad, seen from the motor. These records do not "
        "determine the stiffness of joint 2."
    )
    three = sentence(fit([84.0, K, 7.5]), Elasticity([42.0, 5.0, 7.5], [0.1, 0.1, 0.1]))
    assert three.startswith("Joint 1 is 2.0 times as stiff as nominal and joint 3 has its")
    assert three.endswith("nominal stiffness. These records do not determine the stiffness of joint 2.")
    assert sentence(fit([K])).startswith("These records do not determine the stiffness of joint 1:")


def test_a_value_near_zero_is_not_said_to_agree() -> None:
    assert change_from(43.0, 1.0, 42.0) == "agrees"
    assert change_from(500.0, 249.0, 20.0) == "agrees"
    assert change_from(500.0, 250.0, 20.0) == "–"
    assert change_from(-0.2, 0.15, 0.1) == "–"


def test_an_infinite_error_is_written_in_words() -> None:
    unknown = fit([43.0, 7.5])
    unknown.standard_error[3] = math.inf
    assert sentence(unknown).endswith("seen from the motor. These records do not determine D2.")
    unknown.standard_error[0] = math.inf
    assert sentence(unknown).startswith("The stiffness of joint 2 is 7.500")
    assert sentence(unknown).endswith("determine the stiffness of joint 1 and D2.")


def test_a_torque_scale_that_is_not_stated_is_a_condition() -> None:
    nominal = Elasticity([20.0, 3.5], [0.1, 0.1])
    said = sentence(fit([44.0, 7.5]), nominal, torque_stated=False)
    assert said.endswith("times as stiff, if the torque scale is exact.")
    assert "torque scale" not in sentence(fit([44.0, 7.5]), nominal)


@pytest.mark.parametrize(
    ("error", "said"),
    [(0.2, "is 2.2 times"), (2.0, "is 2.20 ± 0.10 times"), (8.0, "is 2.2 ± 0.4 times")],
)
def test_digits_follow_the_error(error: float, said: str) -> None:
    assert said in sentence(fit([44.0], error), Elasticity([20.0], [0.1]))


@pytest.mark.parametrize(
    ("levels", "state"),
    [
        (["good"], "usable"),
        (["good", "note"], "usable"),
        (["note", "warning"], "usable with care"),
        (["warning", "problem"], "not usable"),
    ],
)
def test_the_findings_decide_the_state_of_the_answer(levels: list[str], state: str) -> None:
    assert answer_state(levels) == state


@pytest.fixture(scope="module")
def study(studies: dict[int, Study]) -> Study:
    return studies[2]


def with_findings(analysis: Analysis, *levels: str) -> Analysis:
    found = tuple(Finding(level, f"A {level}", "", "", 1.0) for level in levels)
    return replace(analysis, findings=found)


def test_an_unusable_answer_begins_with_that_in_every_output(study: Study) -> None:
    analysis = with_findings(analyse(study), "problem", "warning")
    assert (analysis.state, analysis.state_reason) == ("not usable", "A problem")
    assert analysis.headline == "Not usable: A problem."
    assert urdf_snippet(analysis, [100.0]).startswith("<!-- Not usable: A problem.\n")
    assert 'damping="nan"' in urdf_snippet(analysis, [100.0])
    for language, (comment, *_) in LANGUAGES.items():
        first, *others = code_listing(analysis, language).splitlines()
        assert first == f"{comment}NOT USABLE: A problem. The values are left out."
        assert "usable" not in "".join(others)
        assert all(line.startswith(comment) for line in others)
        assert not any(line.startswith((f"{comment}K", f"{comment}D")) for line in others)
    live: dict[str, object] = {}
    exec(code_listing(analysis, "Python"), live)
    assert "K" not in live
    assert gear_table(analysis).startswith("NOT_USABLE_")
    assert modelica_table(analysis).startswith("#1 NOT USABLE")
    assert set(gear_table(analysis).splitlines()[3].split(",")[1::2]) == {"nan"}
    assert "model" not in loadmat(BytesIO(to_mat(analysis)))
    document = json.loads(to_json(analysis))
    assert (document["state"], document["answer"]) == ("not usable", "Not usable: A problem.")
    blocks = make_report(analysis, cut=False).sections[0].blocks
    assert blocks[0] == Paragraph("Not usable: A problem.", "lead")
    assert not any(isinstance(block, Table) for block in blocks)
    row = row_of(analysis, study="here")
    assert as_table([replace(row, verdict="problem")])["state"].to_pylist() == ["not usable"]


def test_an_answer_usable_with_care_states_the_reason(study: Study) -> None:
    analysis = with_findings(analyse(study), "warning", "note")
    assert (analysis.state, analysis.state_reason) == ("usable with care", "A warning")
    assert "times as stiff" in analysis.headline
    assert answer_text(analysis).endswith("is exact. Usable with care: A warning.")
    blocks = make_report(analysis, cut=False).sections[0].blocks
    assert blocks[0] == Paragraph("Usable with care: A warning.")
    assert blocks[1] == Paragraph(analysis.headline, "lead")


def test_the_parts_of_the_error_add_up_to_the_standard_error(study: Study) -> None:
    for std, method in ((0.05, "auto"), (0.3, "weighted"), (0.0, "least-squares")):
        found = analyse(replace(study, inertia_std=std, torque_std=0.02), method=method).fit
        total = sum(np.square(error) for error in error_parts(found).values())
        assert total == pytest.approx(np.square(found.standard_error))


def test_no_part_of_the_error_is_negative_beside_a_negative_damping() -> None:
    known = load_study(Path(__file__).parents[1] / "sample_data" / "single_joint")
    wrong = [replace(record, theta_rad=-record.theta_rad) for record in known.sine_records]
    given = known.inertia
    found = identify_elasticity(extract_phasors(wrong), given, inertia_std=np.inf, friction=True)
    assert found.D[0] < 0
    assert "coulomb" in found.parameters.layout
    assert all(np.all(error >= 0) for error in error_parts(found).values())


def test_the_largest_part_of_the_error_comes_first_in_the_table(study: Study) -> None:
    found = analyse(replace(study, torque_std=0.02)).fit
    size = np.abs(found.estimate)
    for choice, decides in ((0.05, "noise"), (0.19, "choice of model")):
        covariance = np.diag(np.square(0.2 * size))
        changed = replace(found, covariance=covariance, choice_error=choice * size)
        assert [*error_table(changed)][:3] == ["", "total error", decides]


@pytest.mark.parametrize(("share", "named"), [(0.029, False), (0.031, True)])
def test_the_cause_of_a_wide_error_is_named(study: Study, share: float, named: bool) -> None:
    fit = analyse(study).fit
    error = share * np.abs(fit.estimate)
    found = replace(fit, covariance=np.diag(np.square(error)), choice_error=0.9 * error)
    (finding,) = ranked([], found)
    assert finding.title == "The model explains the data"
    assert ("its largest part comes from choice of model: add records" in finding.detail) == named


def test_a_model_without_a_criterion_has_a_dash(study: Study) -> None:
    fit = analyse(study).fit
    rejected = replace(fit.candidates[0], criterion=np.inf, chosen=False)
    columns = compared_models(replace(fit, candidates=(*fit.candidates, rejected)))
    assert columns["Criterion"][-1] == "–"
    assert sum(name.endswith(" (chosen)") for name in columns["Fitted model"]) == 1


def test_the_parts_of_the_errors_have_the_unit_of_the_answer(study: Study) -> None:
    fit, unit = analyse(study).fit, StiffnessUnit.named("N·m/arcmin at the motor")
    columns = error_table(fit, unit)
    assert columns[""][0] == "K1 (N·m/arcmin)"
    assert columns["total error"][0] == significant(fit.standard_error[0] * np.pi / 10800, 2)


def test_inertias_are_compared_with_the_given_ones(study: Study) -> None:
    """J_a1 is given 20 % low with a standard deviation of 10 %: the fit is 2.5 of these higher."""
    M2 = study.inertia.M2.copy()
    M2[0, 0] *= 0.8
    wrong = replace(study, inertia=Inertia(study.inertia.M, M2), inertia_std=0.1, torque_std=0.0)
    analysis = analyse(wrong)
    rows = {row.name: row for row in analysis.priors}
    assert list(rows) == ["J_m1", "J_m2", "J_a1", "J_12", "J_a2"]
    assert rows["J_a1"].fitted == pytest.approx(study.inertia.M2[0, 0], rel=0.01)
    assert rows["J_a1"].disagreement == pytest.approx(2.5, rel=0.05)
    assert abs(rows["J_m2"].disagreement or 0.0) < 0.2
    assert 0 < rows["J_a1"].fitted_std < 0.1 * rows["J_a1"].given_std
    assert analysis.inertia().M2[0, 0] == rows["J_a1"].fitted
    assert analysis.inertia() is analysis.fit.inertias[0]


def test_a_linear_estimator_keeps_the_given_inertias(study: Study) -> None:
    rows = analyse(replace(study, torque_std=0.02), method="weighted").priors
    assert [row.name for row in rows][-2:] == ["torque scale 1", "torque scale 2"]
    assert all(row.cells[2] == "as given" and row.disagreement is None for row in rows)


def test_inertias_of_several_poses_are_labelled_with_their_pose(study: Study) -> None:
    other = Inertia(study.inertia.M, 1.001 * study.inertia.M2)
    records = [
        replace(record, pose="far" if k % 4 < 2 else None) for k, record in enumerate(study.records[:8])
    ]
    rows = analyse(replace(study, records=records, poses={"far": other}), method="weighted").priors
    assert [row.name for row in rows[:2]] == ["J_m1", "J_m2"]
    assert {row.name.partition(", ")[2] for row in rows[2:]} == {"pose far", "pose of [inertia]"}


def test_an_undetermined_parameter_is_written_in_words(study: Study) -> None:
    analysis = analyse(replace(study, inertia_std=math.inf, torque_std=math.inf))
    assert np.all(np.isinf(analysis.fit.standard_error))
    texts = [to_json(analysis), to_toml(analysis), to_html(make_report(analysis, cut=False))]
    assert "Not usable: These records do not determine" in mujoco_snippet(analysis, [100.0])
    for text in texts:
        assert "not determined by these records" in text or "These records do not determine" in text
        assert not re.search(r"\b(inf|nan|Infinity|NaN)\b", text)
    document = json.loads(texts[0])
    assert document["standard_error"] == [None] * 4
    assert set(document["undetermined"]) == {"K1", "K2", "D1", "D2"}


@pytest.mark.parametrize(
    ("viscous", "said"),
    [
        ((0.01, 0.02), ""),
        ((0.01, -0.001), "joint 2 is consistent with 0"),
        ((-0.02, 0.0), "joint 1 is negative"),
    ],
)
def test_a_negative_viscous_friction_is_explained(
    study: Study, viscous: tuple[float, float], said: str
) -> None:
    plain, layout = analyse(study, method="weighted").fit, ParameterLayout.of(2, friction=True)
    vector = layout.pack(K=plain.K, D=plain.D, viscous=viscous)
    covariance = np.diag(np.full(layout.size, 0.002**2))
    note = friction_note(
        replace(plain, parameters=layout.named(vector), parameter_covariance=covariance)
    )
    assert said in note
    assert bool(note) == bool(said)


def test_one_table_holds_every_fitted_number_with_its_place(study: Study) -> None:
    layout = ParameterLayout.of(
        2,
        friction=True,
        curve_parts=3,
        delay=True,
        effects=[*EFFECTS],
        rotors=2,
        arms=1,
        torque_scale=True,
    )
    plain, vector = analyse(study, method="weighted").fit, np.arange(1.0, layout.size + 1)
    vector[:4] = plain.estimate
    found = replace(plain, parameters=layout.named(vector), parameter_covariance=np.diag(vector**2))
    table = quantities(found)
    rows = [quantity for of_one in table.values() for quantity in of_one]
    assert [row.place for row in rows] == list(range(layout.size))
    assert [row.name for row in rows] == list(layout.labels)
    assert len({row.name for row in rows}) == layout.size
    assert table.keys() == PARAMETERS.keys() == {row.parameter for row in rows}
    assert [row.value for row in rows] == vector.tolist()
    np.testing.assert_array_equal([row.error for row in rows[:4]], found.standard_error)
    assert [row.error for row in rows[4:]] == vector[4:].tolist()
    assert all(row.unit == PARAMETERS[row.parameter].unit for row in rows)
    assert table["D"][1].heading == "D2 (N·m·s/rad)"
    assert table["D"][1].meaning == "damping of joint 2"
    assert table["delay"][0].meaning == "torque delay"
    assert [row.joints for row in table["M2"]] == [(1, 1), (2, 1), (2, 2)]
    assert [row.name for row in table["M"]][2:] == ["J_m1, pose 2", "J_m2, pose 2"]
    assert [row.joints for row in table["curve"]] == [(1,)] * 3 + [(2,)] * 3
    shown = {quantity.parameter for quantity in further_quantities(found)}
    assert shown == table.keys() - {"K", "D", "curve", "M", "M2", "torque_scale"}


def test_effects_are_named_with_their_values(study: Study) -> None:
    layout = ParameterLayout.of(2, effects=["arm_viscous", "lag"])
    plain = analyse(study, method="weighted").fit
    vector = layout.pack(K=plain.K, D=plain.D, arm_viscous=[0.002, 0.001], lag=[1e-4, 0.0])
    errors = np.full(layout.size, 1e-5)
    found = replace(
        plain, parameters=layout.named(vector), parameter_covariance=np.diag(np.square(errors))
    )
    assert model_name(found) == "elasticity + arm-side viscous friction + a lag per joint"
    assert without(found) == "without arm-side viscous friction and a lag per joint"
    laws = ParameterLayout.of(2, effects=["cubic", "backlash"])
    nonlinear = laws.named(laws.pack(K=plain.K, D=plain.D, cubic=[9.0, 0.0], backlash=[1e-3, 0.0]))
    assert without(replace(plain, parameters=nonlinear)) == "without nonlinearity of the gears"
    shown = {quantity.name: quantity.shown for quantity in further_quantities(found)}
    assert shown["arm-side viscous friction 1"] == ("0.002000 ± 0.000010", "N·m·s/rad")
    assert shown["lag 1"] == ("0.100 ± 0.010", "ms")
    document = json.loads(to_json(replace(analyse(study), fit=found)))
    assert document["effects"]["lag"]["values"] == [1e-4, 0.0]
