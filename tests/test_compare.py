"""Comparison of two studies: differences with their errors, and its page."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from urllib.parse import parse_qs

import numpy as np
import pytest
from app_pages import upload
from streamlit.testing.v1 import AppTest
from typer.testing import CliRunner

from jointid import Analysis, Inertia, JointIdError, MotionRecord, Study, analyse, save_study
from jointid.answer import StiffnessUnit
from jointid.cli import app as program
from jointid.uncertainty.comparison import comparable, compare, comparison_sentence

run = CliRunner()


@pytest.fixture(scope="module")
def first(studies: dict[int, Study]) -> Analysis:
    return analyse(studies[2])


def test_a_study_does_not_differ_from_itself(first: Analysis) -> None:
    rows = compare(first.quantities, first.quantities)
    assert [row.first.name for row in rows] == ["K1", "K2", "D1", "D2"]
    assert all(row.relative == row.sigmas == 0 for row in rows)
    assert all(re.fullmatch(r"0(\.0+)? ± 0\.\d+ %", row.change) for row in rows)  # no digit of noise
    assert all(np.isnan(row.sigmas) for row in compare(*2 * [first.quantities], same_records=True))


def test_a_stiffer_gear_is_found_with_its_standard_errors(first: Analysis) -> None:
    """Torques 2 % larger scale K and D by as much; errors of both studies add as squares."""
    records = [replace(r, tau_Nm=1.02 * r.tau_Nm) for r in first.study.records]
    inertia = replace(
        first.study.inertia, M=1.02 * first.study.inertia.M, M2=1.02 * first.study.inertia.M2
    )
    second = analyse(replace(first.study, records=records, inertia=inertia))
    rows = compare(first.quantities, second.quantities)
    for row in rows:
        assert row.relative == pytest.approx(0.02, rel=1e-4)
        error = np.hypot(row.first.error, row.second.error)
        assert row.sigmas == pytest.approx((row.second.value - row.first.value) / error)
    swapped = compare(second.quantities, first.quantities)
    assert [row.sigmas for row in swapped] == pytest.approx([-row.sigmas for row in rows])


def test_sensors_of_one_study_are_compared_with_those_of_the_other() -> None:
    """Motors, which have damping, are compared only with motors."""

    def answer(*parameters: str, sensors: object = None) -> Any:
        quantities = [SimpleNamespace(parameter=p, name=f"{p}1") for p in parameters]
        return SimpleNamespace(quantities=quantities, unit=StiffnessUnit(), sensors=sensors)

    behind, other = answer("K"), answer("K")
    motors, alone = answer("K", "D", sensors=behind), answer("K", "D")
    assert comparable(motors, other) == (behind, other)
    assert comparable(other, motors) == (other, behind)
    assert comparable(motors, alone) == (motors, alone)


@pytest.mark.parametrize(
    ("ratio", "words"),
    [
        (0.25, "is 75 % softer"),
        (1.2, "is 20 % stiffer"),
        (1.5, "is 1.5 times as stiff"),
        (4.0, "is 4.0 times as stiff"),
    ],
)
def test_a_large_change_is_stated_as_a_factor(first: Analysis, ratio: float, words: str) -> None:
    """Damping is compared, but a sentence on stiffness does not mention it."""
    others = [replace(each, value=ratio * each.value) for each in first.quantities]
    rows = compare(first.quantities, others)
    said = comparison_sentence(rows, "A", "B", exact_torque_scales=True)
    assert said.count(words) == said.count("joint") == 2
    assert said.startswith("B compared with A: joint 1 ")
    assert said.endswith(", if the torque scales are exact")


def test_other_joints_are_refused(studies: dict[int, Study], first: Analysis) -> None:
    with pytest.raises(JointIdError, match="first study has 2 joints, the second 1 joint"):
        compare(first.quantities, analyse(studies[1]).quantities)


def test_the_command_states_which_robot_is_softer(
    tmp_path: Path, studies: dict[int, Study], first: Analysis
) -> None:
    records = [replace(r, tau_Nm=0.9 * r.tau_Nm) for r in first.study.records]
    M, M2 = 0.9 * first.study.inertia.M, 0.9 * first.study.inertia.M2
    soft = replace(first.study, records=records, inertia=Inertia(M, M2), name="Soft")
    for name, each in (("stiff", first.study), ("soft", soft)):
        save_study(each, tmp_path / f"{name}.zip")
    files = [str(tmp_path / "stiff.zip"), str(tmp_path / "soft.zip")]
    shown = run.invoke(program, ["compare", *files])
    assert shown.exit_code == 0, shown.stderr
    assert f'"Soft" compared with "{first.study.name}": joint 1 is 10 % softer' in shown.stdout
    assert re.search(r"K1 \(N·m/rad\).*−10 %\s+yes, ", shown.stdout)
    found = json.loads(run.invoke(program, ["compare", *files, "--json"]).stdout)
    assert [row["name"] for row in found["differences"]] == ["K1", "K2", "D1", "D2"]
    K1 = found["differences"][0]
    assert K1["relative"] == pytest.approx(-0.1, abs=1e-4)
    error = np.hypot(K1["first_error"], K1["second_error"])
    assert K1["sigmas"] == pytest.approx((K1["second"] - K1["first"]) / error)
    same = run.invoke(program, ["compare", files[0], files[0]])
    assert same.exit_code == 1
    assert "the same study" in same.stderr


def test_the_command_shows_no_difference_from_an_answer_that_is_not_usable() -> None:
    shown = run.invoke(program, ["compare", "paper", "exercise_1"])
    assert shown.exit_code == 0, shown.stderr
    assert 'Second: "Exercise 1: a log with a fault", not usable\nNot usable: ' in shown.stdout
    assert "σ" not in shown.stdout
    assert re.search(r"K1 \(N·m/rad\) +43\S* ± \S+ +–\s", shown.stdout)
    found = json.loads(run.invoke(program, ["compare", "paper", "exercise_1", "--json"]).stdout)
    assert found["second"]["state"] == "not usable"
    assert all(row["relative"] is row["sigmas"] is None for row in found["differences"])


def test_the_page_compares_two_studies(app: AppTest) -> None:
    app.query_params["study"] = "paper"
    app.query_params["compare_study"] = "Test cell with 1 joint(s)"  # as after F5
    at = app.switch_page("pages/11_Compare.py").run()
    assert not at.exception, at.exception[0].stack_trace
    assert at.selectbox(key="compare_study").value == "one joint"
    assert "1 joint" in at.error[0].value
    at = at.selectbox(key="compare_study").set_value("paper").run()
    at = at.selectbox(key="compare_estimator").set_value("least-squares").run()
    assert not at.exception, at.exception[0].stack_trace
    assert at.header[0].value.startswith("The stiffnesses differ by up to")
    assert list(at.table[0].value.columns) == ["Quantity", "Difference", "First", "Second"]


def test_a_second_study_without_an_answer_is_named(app: AppTest, studies: dict[int, Study]) -> None:
    time, rng = 1e-3 * np.arange(200), np.random.default_rng(0)
    still = MotionRecord(time, 1e-3 * rng.standard_normal((200, 2)), rng.standard_normal((200, 2)))
    at = upload(app.run(), replace(studies[2], records=[still]))
    at.session_state["chosen"] = "paper"
    at = at.switch_page("pages/11_Compare.py").run()
    at = at.selectbox(key="compare_study").set_value("mine.zip").run()
    assert [e.value.partition(": ")[0] for e in at.error] == ["Second study, mine.zip"]
    assert not any("can still be viewed" in m.value for m in at.markdown)


def test_a_study_that_is_not_usable_has_a_link_to_its_findings(
    app: AppTest, studies: dict[int, Study], first: Analysis
) -> None:
    records = [replace(r, tau_Nm=r.tau_Nm[:, ::-1]) for r in studies[2].records]
    at = upload(app.run(), replace(studies[2], records=records), "swapped.zip")
    digest = at.session_state["chosen"]
    at.session_state["chosen"] = "paper"
    at = at.switch_page("pages/11_Compare.py").run()
    at = at.selectbox(key="compare_study").set_value("swapped.zip").run()
    assert not at.exception, at.exception[0].stack_trace
    assert [e.value.partition(": ")[0] for e in at.error] == ['"swapped.zip"']
    (link,) = [each.proto for each in at.main.get("page_link") if "findings" in each.proto.label]
    assert link.label == '"swapped.zip": findings and remedies'
    assert parse_qs(link.query_string)["study"] == [digest]


def test_the_headline_names_a_study_that_is_usable_with_care(app: AppTest, first: Analysis) -> None:
    doubled = replace(first.study, records=[*first.study.records, first.study.records[0]])
    at = upload(app.run(), doubled, "doubled.zip").switch_page("pages/11_Compare.py").run()
    at = at.selectbox(key="compare_study").set_value("paper").run()
    assert not at.exception, at.exception[0].stack_trace
    said = at.header[0].value.replace("\N{NO-BREAK SPACE}", " ")
    assert said.endswith(', but "doubled.zip" is usable with care only')
    at = at.selectbox(key="compare_study").set_value("doubled.zip").run()
    at = at.selectbox(key="compare_estimator").set_value("least-squares").run()
    assert not at.exception, at.exception[0].stack_trace
    assert "but auto is usable with care only" in at.header[0].value


def test_differences_are_shown_in_the_unit_and_on_the_side_of_the_answer(first: Analysis) -> None:
    units = StiffnessUnit.named("N·m/arcmin at the joint", np.array([100.0, -90.0]))
    rows = compare(*2 * [replace(first, unit=units).quantities])
    scale = np.array([1e4, 8.1e3]) * np.pi / 10800
    assert [row.first.value for row in rows[:2]] == pytest.approx((scale * first.fit.K).tolist())
    assert {row.first.unit for row in rows} == {"N·m/arcmin", "N·m·s/rad"}


def test_a_softer_robot_differs_significantly_in_either_order(
    app: AppTest, studies: dict[int, Study], first: Analysis
) -> None:
    records = [replace(r, tau_Nm=0.9 * r.tau_Nm) for r in first.study.records]
    inertia = replace(
        first.study.inertia, M=0.9 * first.study.inertia.M, M2=0.9 * first.study.inertia.M2
    )
    soft = replace(first.study, records=records, inertia=inertia)
    at = upload(app.run(), soft, "soft.zip").switch_page("pages/11_Compare.py").run()
    at = at.selectbox(key="compare_study").set_value("paper").run()
    assert not at.exception, at.exception[0].stack_trace
    said = at.header[0].value.replace("\N{NO-BREAK SPACE}", " ")
    assert said.startswith(f'"{first.study.name}" compared with "soft.zip": joint 1 is 11 % stiffer')
    assert said.endswith("(significant), if the torque scales are exact")
    table = at.table[0].value
    assert list(table.columns[:3]) == ["Quantity", "Difference", "Significant"]
    assert table.loc[table.Quantity == "K1 (N·m/rad)", "Significant"].item() == "yes, over 100 σ"
    states = [caption.value for caption in at.caption if caption.value.startswith("First: ")]
    name = re.escape(first.study.name)
    assert re.fullmatch(
        rf'First: "soft\.zip", estimator auto, usable.*\. Second: "{name}", estimator auto, usable.*\.',
        states[0],
    )
    at = next(button for button in at.button if button.label == "Swap").click().run()
    assert not at.exception, at.exception[0].stack_trace
    said = at.header[0].value.replace("\N{NO-BREAK SPACE}", " ")
    assert said.startswith(f'"soft.zip" compared with "{first.study.name}": joint 1 is 10 % softer')


def test_the_default_partner_is_one_of_the_users_studies(
    app: AppTest, studies: dict[int, Study], first: Analysis
) -> None:
    """A sample of the same inertias is no better partner than the study opened just before."""
    M = first.study.inertia.M * 1.01
    before = replace(first.study, inertia=replace(first.study.inertia, M=M))
    at = upload(app.run(), before, "before.zip")
    at = upload(at, first.study, "after.zip").switch_page("pages/11_Compare.py").run()
    assert not at.exception, at.exception[0].stack_trace
    assert at.selectbox(key="compare_study").value == "before.zip"


@pytest.mark.parametrize("names", [("", ""), ("cell 7", "cell 8")])
def test_the_default_partner_is_the_same_robot(
    app: AppTest, first: Analysis, names: tuple[str, str]
) -> None:
    """Robots are told apart by their names or, without names, by their rotors."""
    inertia, (own, others) = first.study.inertia, names
    other = replace(inertia, M=inertia.M if own else 1.3 * inertia.M)
    at = upload(app.run(), replace(first.study, robot=own), "before.zip")
    at = upload(at, replace(first.study, robot=others, inertia=other), "other.zip")
    after = replace(first.study, robot=own, note="with new gears")
    at = upload(at, after, "after.zip").switch_page("pages/11_Compare.py").run()
    assert not at.exception, at.exception[0].stack_trace
    assert at.selectbox(key="compare_study").value == "before.zip"


@pytest.mark.parametrize(
    ("page", "details"),
    [
        ("pages/11_Compare.py", ""),
        ("pages/4_Elasticity.py", "Error bars"),
        ("pages/4_Elasticity.py", "Estimators"),
        ("pages/6_Plan.py", ""),
    ],
)
def test_every_table_of_k_keeps_the_unit_of_the_answer(
    app: AppTest, studies: dict[int, Study], page: str, details: str
) -> None:
    geared = replace(studies[2], gear_ratio=[100.0, -90.0])
    at = upload(app.run(), geared, "geared.zip")
    at = at.selectbox(key="unit").set_value("N·m/arcmin at the joint").run()
    if details:
        at.session_state["details"] = details
    at = at.switch_page(page).run().run()  # AppTest gives a new page its choices in the second run
    if page.endswith("Compare.py"):  # with itself by another estimator
        at = at.selectbox(key="compare_study").set_value("geared.zip").run()
        at = at.selectbox(key="compare_estimator").set_value("least-squares").run()
    assert not at.exception, at.exception[0].stack_trace
    shown = [str(cell) for t in at.table for cell in (*t.value.columns, *t.value.iloc[:, 0])]
    own = [text for text in shown if text.startswith("K1 (")]
    assert own
    assert set(own) == {"K1 (N·m/arcmin)"}
    assert any("at the joint" in caption.value for caption in at.caption)
