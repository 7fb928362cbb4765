"""Gear ratios, remarks and assumptions of a study, and the units in which K and D are shown."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from jointid import Analysis, JointIdError, Study, analyse, load_study
from jointid.answer import STIFFNESS_UNITS, StiffnessUnit
from jointid.cli.identify import _print
from jointid.exporting import to_json
from jointid.exporting.code_listing import code_listing
from jointid.exporting.identification import answer_text
from jointid.files.digest import study_digest
from jointid.files.study_saving import pack_study
from jointid.reporting.blocks import Table
from jointid.reporting.report import make_report, to_html
from jointid.wording import significant

RATIO = (101.0, -93.5)
REMARKS = {
    "gear_temperature_C": 24.0,
    "note": "two hours of work",
    "assumed": ("gear ratio 1 (joint 2)",),
}


@pytest.fixture(scope="module")
def paper(studies: dict[int, Study]) -> Study:
    return studies[2]


@pytest.fixture(scope="module")
def study(paper: Study) -> Study:
    return replace(paper, gear_ratio=RATIO, nominal=None, **REMARKS)


@pytest.fixture(scope="module")
def analysis(study: Study) -> Analysis:
    return analyse(study)


def test_facts_are_saved_with_the_study(study: Study, paper: Study) -> None:
    again = load_study(pack_study(study))
    assert again.gear_ratio is not None
    assert again.gear_ratio.tolist() == list(RATIO)
    assert {name: getattr(again, name) for name in REMARKS} == REMARKS
    assert study_digest(again) == study_digest(study)
    others = [
        replace(study, gear_ratio=(101, 93.5)),
        replace(study, note=""),
        replace(study, assumed=()),
    ]
    assert len({study_digest(each) for each in (study, paper, *others)}) == 5


def test_a_problem_points_first_to_what_the_import_assumed(
    studies: dict[int, Study], capsys: pytest.CaptureFixture[str]
) -> None:
    """The list is long: it appears once."""
    known = studies[1]
    records = [replace(record, tau_Nm=16 * record.tau_Nm) for record in known.records]
    wrong = replace(known, records=tuple(records), assumed=("gear ratio 1 (joint 1)",))
    first, *others = (found := analyse(wrong)).findings
    assert first.level == "problem"
    assert first.remedy.startswith("First check the assumptions of the import, listed as ")
    _print(Path("wrong"), found, "", as_json=False)
    assert capsys.readouterr().out.count("gear ratio 1 (joint 1)") == 1
    assert not any("assumed" in finding.remedy for finding in others)


def test_a_study_without_facts_is_written_as_before(paper: Study) -> None:
    toml = pack_study(paper)
    assert study_digest(load_study(toml)) == study_digest(paper)
    assert paper.gear_ratios is None
    assert paper.remarks == []


@pytest.mark.parametrize(
    ("facts", "said"),
    [
        ({"gear_ratio": (101.0,)}, "one per joint"),
        ({"gear_ratio": (101.0, 0.0)}, "not 0"),
        ({"gear_ratio": (101.0, np.nan)}, "gear_ratio"),
        ({"gear_temperature_C": np.inf}, "gear_temperature_C"),
        ({"note": 3}, "expected text"),
        ({"assumed": (3,)}, "expected a list of strings"),
    ],
)
def test_wrong_facts_are_refused(paper: Study, facts: dict[str, object], said: str) -> None:
    with pytest.raises(JointIdError, match=said):
        replace(paper, **facts)  # type: ignore[arg-type]


def test_remarks_are_shown_with_the_answer(analysis: Analysis) -> None:
    texts = [
        to_json(analysis),
        code_listing(analysis, "Python").replace("\n# ", " "),
        to_html(make_report(analysis, cut=False)),
    ]
    for text in texts:
        for remark in ("Gears at 24 °C", "two hours of work", "gear ratio 1 (joint 2)"):
            assert remark in text


class TestUnits:
    @pytest.mark.parametrize("name", STIFFNESS_UNITS)
    def test_each_unit_gives_the_same_torque_per_degree(self, analysis: Analysis, name: str) -> None:
        """The torque for one degree of the joint's deflection, from each of the units."""
        side, angle = STIFFNESS_UNITS[name]
        shown = analysis.shown_in(name).quantities
        per_degree = {"rad": np.pi / 180, "arcmin": 60.0, "°": 1.0}[angle]
        for j, (K, N) in enumerate(zip(analysis.fit.K, RATIO, strict=True)):
            at_joint = K * N**2 * np.pi / 180
            torque = shown[j].value * per_degree * (N**2 if side == "motor" else 1)
            assert torque == pytest.approx(at_joint, rel=1e-12)
            relative = analysis.fit.standard_error[j] / K
            assert shown[j].error / shown[j].value == pytest.approx(relative, rel=1e-12)
            assert shown[j].unit == name.split()[0]
            assert shown[2 + j].unit == "N·m·s/rad"

    def test_the_sentence_has_unit_and_side(self, analysis: Analysis) -> None:
        sentence = analysis.shown_in("N·m/arcmin at the joint").headline
        assert "N·m/arcmin" in sentence
        assert "at the joint" in sentence
        assert "seen from the motor" in analysis.headline

    def test_the_nominal_values_have_the_chosen_unit(self, paper: Study) -> None:
        found = analyse(replace(paper, gear_ratio=RATIO)).shown_in("N·m/rad at the joint")
        assert paper.nominal is not None
        assert found.nominal == pytest.approx(
            [*(paper.nominal.K * np.square(RATIO)), *(paper.nominal.D * np.square(RATIO))]
        )

    def test_every_table_of_the_report_has_the_chosen_unit(self, analysis: Analysis) -> None:
        shown = analysis.shown_in("N·m/arcmin at the joint")
        blocks = [b for s in make_report(shown, cut=False).sections for b in s.blocks]
        tables = {b.caption.split()[0]: b for b in blocks if isinstance(b, Table) and b.caption}
        assert tables["Parts"].rows[0][:2] == (
            "K1 (N·m/arcmin)",
            significant(shown.quantities[0].error, 2),
        )
        assert tables["Estimators,"].rows[0][:2] == ("K1 (N·m/arcmin)", shown.quantities[0].shown[0])

    def test_exports_are_motor_side_values(self, analysis: Analysis) -> None:
        shown = analysis.shown_in("N·m/° at the joint")
        assert answer_text(shown) == answer_text(analysis)

    def test_the_joint_needs_gear_ratios(self) -> None:
        with pytest.raises(JointIdError, match=r"gear_ratio .* in study\.toml"):
            StiffnessUnit.named("N·m/rad at the joint")
        with pytest.raises(JointIdError, match="is not known"):
            StiffnessUnit.named("furlongs")
