"""Error bars, checks of the model and the plan on the pages of the app."""

from __future__ import annotations

import csv
import io
import json
import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from app_pages import ELASTICITY, opened, shown, upload
from streamlit.testing.v1 import AppTest

from jointid import Analysis, JointIdError, Study
from jointid.figures.uncertainty import normalised_residuals
from jointid.files.digest import study_digest
from jointid.ui.shared.charts import csv_of
from jointid.ui.shared.entries import numbers_in
from jointid.ui.study import own_plan_form, set_points_form
from jointid.ui.study.elasticity_figures import harmonic_columns
from jointid.ui.study.plan_form import largest_so_far, suggested_columns
from jointid.uncertainty.information import prior_influence
from jointid.uncertainty.plan import suggest_records
from jointid.uncertainty.validation import harmonic_content, record_residuals

PLAN = "pages/6_Plan.py"
SUPERSCRIPTS = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")


@pytest.fixture
def found(analyses: dict[int, Analysis]) -> Analysis:
    return analyses[2]


def clicked(at: AppTest, key: str) -> AppTest:
    return shown(at.button(key=key).click().run())


def column(at: AppTest, name: str) -> list[str]:
    cells = next(list(t.value[name]) for t in at.table if name in t.value)
    return [cell.replace("\N{NO-BREAK SPACE}", " ") for cell in cells]


def bar(text: str) -> float:
    """The part after ±, with its power of ten."""
    digits, _, power = text.rpartition("± ")[2].replace("×10", "e").partition("e")
    inside, _, outside = digits.partition(")")
    exponent = (power or outside.replace("e", "")).translate(SUPERSCRIPTS)
    return float(inside.replace("<", "")) * 10.0 ** int(exponent or 0)


def number(text: str) -> float:
    mantissa, _, power = text.replace("±", "").replace("−", "-").replace("%", "").partition("×10")
    return float(mantissa) * 10.0 ** int(power.translate(SUPERSCRIPTS) or 0)


JOINTS = [pytest.param(1, marks=pytest.mark.long), 2, pytest.param(3, marks=pytest.mark.long)]


@pytest.mark.parametrize("joints", JOINTS)
class TestErrorBars:
    def test_the_error_its_parts_and_the_paper_method_are_shown(
        self, app: AppTest, analyses: dict[int, Analysis], joints: int
    ) -> None:
        at = opened(app, ELASTICITY, joints)
        analysis = analyses[joints]
        for name, errors in (
            ("Total error", analysis.fit.standard_error),
            ("Noise", analysis.fit.noise_error),
            ("Inertias and torque scale", analysis.fit.prior_error),
        ):
            parts = [bar(text) for text in column(at, name)]
            assert parts == pytest.approx(np.asarray(errors).tolist(), rel=0.06)
        assert any("torque scale is not stated" in caption.value for caption in at.caption)
        explained = any("Choice of model: " in caption.value for caption in at.caption)
        assert explained == any("Choice of model" in t.value for t in at.table)

    def test_given_and_fitted_inertias_are_listed_with_their_influence(
        self, app: AppTest, analyses: dict[int, Analysis], joints: int
    ) -> None:
        at = opened(app, ELASTICITY, joints, details="Inertias")
        rows = analyses[joints].priors
        assert column(at, "Given") == [row.cells[1] for row in rows]
        assert column(at, "Fitted") == [row.cells[2] for row in rows]
        assert len(rows) == joints + joints * (joints + 1) // 2
        names = list(prior_influence(analyses[joints].fit).names)
        (shifts,) = (t.value for t in at.table if "K1 (%)" in t.value)
        assert list(shifts["Quantity"]) == names
        assert "%" not in "".join(shifts.iloc[:, 1:].to_numpy().ravel())

    def test_equations_and_correlations_are_shown_joint_by_joint(
        self, app: AppTest, analyses: dict[int, Analysis], joints: int
    ) -> None:
        at = opened(app, ELASTICITY, joints, details="Matrix A")
        fit = analyses[joints].fit
        if joints > 1:
            at = shown(at.button_group(key="details_joint").set_value(joints - 1).run())
        A, b = fit.equations.matrix()
        rows = A[:, -1] != 0
        (table,) = (frame.value for frame in at.dataframe if "Row" in frame.value)
        assert list(table.columns) == ["Row", f"D{joints}", f"K{joints}", "b"]
        expected = np.column_stack([A[rows, -2:], b[rows]])
        assert table.iloc[:, 1:].map(number).to_numpy() == pytest.approx(expected, rel=1e-4)
        assert not A[rows, :-2].any()
        shares = [number(text) for text in column(at, f"D{joints}")]
        assert shares == pytest.approx(fit.correlation[:, -1].tolist(), abs=0.01)
        assert any("the strongest is that of" in each.value for each in at.markdown)

    def test_closed_panels_are_not_computed_and_open_ones_show_their_figures(
        self, app: AppTest, joints: int
    ) -> None:
        closed = len(opened(app, ELASTICITY, joints).get("plotly_chart"))
        assert closed == joints
        at = opened(app, ELASTICITY, joints, details="Model check")
        assert len(at.get("plotly_chart")) == closed + 2
        assert any("Odd τ1 (%)" in shown.value for shown in at.dataframe)

    def test_every_figure_is_drawn_for_every_joint(self, app: AppTest, joints: int) -> None:
        for figure in ("Frequency response", "Dynamic stiffness", "K over amplitude"):
            at = opened(app, ELASTICITY, joints, figure=figure)
            assert at.session_state["figure"] == figure
            assert len(at.get("plotly_chart")) == joints

    def test_the_prediction_of_left_out_records_is_beside_the_answer(
        self, app: AppTest, joints: int
    ) -> None:
        said = next(c.value for c in opened(app, "app.py", joints).caption if "Cross-check" in c.value)
        found = re.search(r"to (\S+) % \(median\), (\S+) × the noise", said)
        assert found is not None
        assert 0 < float(found[1]) < 5
        assert 0.3 < float(found[2]) < 3


@pytest.mark.parametrize("joints", [1, 2, 3])
def test_the_bootstrap_agrees_with_the_stated_errors(app: AppTest, joints: int) -> None:
    at = opened(app, ELASTICITY, joints, details="Bootstrap")
    at = clicked(at, "check_errors")
    stated = [number(text) for text in column(at, "From noise")]
    assert [number(text) for text in column(at, "Bootstrap")] == pytest.approx(stated, rel=0.4)
    assert len(column(at, "Jackknife")) == 2 * joints


def test_every_page_about_several_poses(app: AppTest, studies: dict[int, Study]) -> None:
    """The same records, every second one said to come from another pose of equal inertia."""
    study = studies[2]
    records = [replace(r, pose="ab"[i // 2 % 2]) for i, r in enumerate(study.records)]
    several = replace(study, records=records, poses=dict.fromkeys("ab", study.inertia))
    at = upload(app.run(), several, "poses.zip")
    (said,) = [c.value for c in at.caption if "Cross-check" in c.value]
    apart = re.search(r"predict the gear torques at the others to (\S+) % \(median\)", said)
    assert apart is not None
    assert float(apart[1]) < 1.0
    at.session_state["details"] = "Model check"
    at = shown(at.switch_page(ELASTICITY).run())
    assert any("predict the gear torques" in caption.value for caption in at.caption)
    at = shown(at.switch_page(PLAN).run())
    assert not at.error
    assert list(at.selectbox(key="plan_pose").options) == ["a", "b"]
    assert len(at.table[0].value) == 3
    at.query_params["details"] = "Poses"
    at = shown(at.switch_page(ELASTICITY).run())
    poses = next(t.value for t in at.table if "Pose" in t.value)
    assert list(poses["Pose"]) == ["a", "b", "Distance"]
    assert all(number(poses[name].iloc[-1]) < 4 for name in poses.columns[1:])


class TestTheNextExperiment:
    @pytest.mark.parametrize("joints", [1, 2, 3])
    def test_records_are_suggested_within_the_limits_of_the_study(
        self, app: AppTest, joints: int
    ) -> None:
        at = opened(app, PLAN, joints)
        assert len(at.table[0].value) == 3
        assert len(at.get("plotly_chart")) == 1
        said = re.fullmatch(r"3 additional records: largest error (\S+) % → (\S+) %", at.header[0].value)
        assert said is not None
        assert float(said[2]) < float(said[1])
        # A plan of one's own begins as the suggestion.
        today = [float(x.split(" ± ")[1].split(")")[0]) for x in column(at, "Now")]
        assert len(today) == 2 * joints
        assert len(column(at, "Both together")) == 2 * joints

    def test_a_record_that_settles_a_doubt_is_in_the_own_plan(
        self, app: AppTest, found: Analysis, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(own_plan_form, "second_amplitude_record", lambda fit: 4)
        at = opened(app, PLAN)
        label, tau = found.phasors.labels[4], np.abs(found.fit.phasors.tau[4])
        assert any(f'The last row repeats "{label}" at half' in m.value for m in at.markdown)
        row = at.dataframe[-1].value.iloc[-1]
        assert row["Frequency (Hz)"] == pytest.approx(found.phasors.omega[4] / (2 * np.pi), rel=1e-8)
        torques = numbers_in("Torques", row["Torques (N·m)"])
        assert torques == pytest.approx(0.5 * tau, rel=1e-2)

    @pytest.mark.parametrize("damage", ["", "[[1]]", '[[1], ["x"], ["1, 2"], ["0, 0"]]', "5"])
    def test_an_own_plan_is_kept_by_the_address(
        self, app: AppTest, studies: dict[int, Study], damage: str
    ) -> None:
        """As after F5; what is no plan is ignored."""
        kept = [[9.5, None], [4, 2.5], ["0.3, 0.2", "0.1, 0.1"], ["0, 90", ""]]
        key = f"own_plan_{study_digest(studies[2])[:12]}"
        at = app.switch_page(PLAN)
        at.query_params.update({"study": "paper", key: damage or json.dumps(kept)})
        at = shown(at.run())
        table = at.dataframe[-1].value
        assert len(table) == (3 if damage else 2)
        assert (key in at.query_params) == (not damage)
        if not damage:
            assert table["Torques (N·m)"].tolist() == kept[2]
            assert at.error[0].value == "Row 2 of the plan: Frequency (Hz) is empty."

    def test_a_plan_has_four_columns_for_any_number_of_joints(
        self, analyses: dict[int, Analysis]
    ) -> None:
        """More would be wider than a phone."""
        analysis = analyses[3]
        at_once: Any = SimpleNamespace(computed=lambda _, doing, compute, *given: compute(*given))
        columns: dict[str, list[Any]] = {"Frequency (Hz)": [9.5], "Length (s)": [4]}
        columns |= {"Torques (N·m)": ["0.3, 0.2, 0.1"], "Phases (°)": ["0, 90, 270"]}
        plan = own_plan_form.plan_of(columns, at_once, analysis, "")
        expected = [[0.3, 0.2j, -0.1j]]
        assert own_plan_form.columns_of(plan) == columns
        np.testing.assert_allclose(plan.torque_Nm, expected, atol=1e-15)
        for column, cell, said in (
            ("Phases (°)", "0, 90", "Row 1 of the plan, Phases (°): 2 values for 3 joints"),
            ("Torques (N·m)", None, "Row 1 of the plan: Torques (N·m) is empty"),
            ("Length (s)", np.nan, "Row 1 of the plan: Length (s) is empty"),
        ):
            with pytest.raises(JointIdError, match=re.escape(said)):
                own_plan_form.plan_of(columns | {column: [cell]}, at_once, analysis, "")

    def test_an_unusable_answer_has_no_predicted_gain(
        self, app: AppTest, studies: dict[int, Study]
    ) -> None:
        torques = [replace(r, tau_Nm=r.tau_Nm * [1, 3]) for r in studies[2].records]
        at = upload(app.run(), replace(studies[2], records=torques), "unit.zip")
        at = shown(at.switch_page(PLAN).run())
        assert at.error[0].value.startswith("Not usable")
        assert [header.value for header in at.header] == ["3 additional records"]
        assert "Largest error afterwards" not in at.table[0].value
        assert len(at.table) == 1  # no errors of a plan of one's own either
        assert len(at.get("plotly_chart")) == 0
        assert not at.info  # more records are no remedy
        assert not any("large gain" in caption.value for caption in at.caption)
        assert any("findings and remedies" in link.proto.label for link in at.get("page_link"))

    def test_the_tabs_keep_their_place_and_their_key(self, app: AppTest) -> None:
        at = opened(app, PLAN, plan_view="Set points")
        first = [place for place, part in at.main.children.items() if part.type == "tab_container"]
        field = next(w for w in at.text_input if w.label == "Gear ratios")
        at = shown(field.set_value("100, 80").run())
        again = [place for place, part in at.main.children.items() if part.type == "tab_container"]
        assert first == again
        assert len(first) == 1
        assert at.session_state["plan_view"] == "Set points"

    def test_where_the_model_limits_the_answer_more_records_do_not_help(self, found: Analysis) -> None:
        falling, flat = np.array([0.2, 0.05]), np.array([0.2, 0.19])
        assert found.limit_of_records(falling) == ""
        said = found.limit_of_records(flat)
        assert said.startswith("These records hardly reduce the largest error. The largest error is ")
        assert said.endswith((" motion.", " payload.", " matters less.", " between the models."))
        title = "The model, not the noise, limits the answer"
        limited = replace(found, findings=(replace(found.findings[0], code="model limits"),))
        assert limited.limit_of_records(falling).startswith(f"{title}: more records")

    def test_more_records_are_suggested_when_asked(self, app: AppTest) -> None:
        at = opened(app, PLAN)
        at.number_input(key="plan_count").set_value(5)
        at = at.button[0].click().run()
        assert len(at.table[0].value) == 5

    def test_frequencies_end_at_the_highest_one(self, app: AppTest) -> None:
        """Controllers that take a set point every 8 or 12 ms run slower sines only."""
        at = opened(app, PLAN)
        field = next(w for w in at.text_input if w.label.startswith("Highest frequency"))
        field.set_value("16")
        at = shown(at.button[0].click().run())
        assert max(map(float, column(at, "Frequency (Hz)"))) <= 16
        next(w for w in at.text_input if w.label.startswith("Highest")).set_value("0")
        at = at.button[0].click().run()
        assert "Highest frequency" in at.error[0].value

    @pytest.mark.parametrize(
        ("text", "said"), [("1, 2, 3", "3 values for 2"), ("much", "not a number"), ("-1", "positive")]
    )
    def test_an_invalid_limit_is_reported(self, app: AppTest, text: str, said: str) -> None:
        at = opened(app, PLAN)
        field = next(w for w in at.text_input if w.label.startswith("Torque amplitudes"))
        field.set_value(text)
        at = at.button[0].click().run()
        assert said in at.error[0].value

    def test_the_default_limits_are_the_largest_motion_so_far(self, found: Analysis) -> None:
        torque, velocity = largest_so_far(found)
        given = suggest_records(
            found.phasors,
            found.fit.inertias,
            found.fit,
            torque_limit_Nm=torque,
            velocity_limit_rad_s=velocity,
        )
        default = suggest_records(found.phasors, found.fit.inertias, found.fit)
        np.testing.assert_allclose(given.worst, default.worst, rtol=1e-9)

    def test_the_file_holds_the_records_to_the_last_bit(
        self, found: Analysis, studies: dict[int, Study]
    ) -> None:
        suggestion = suggest_records(found.phasors, studies[2].inertias, found.fit)
        rows = list(csv.DictReader(io.StringIO(csv_of(suggested_columns(suggestion)))))
        assert [float(row["frequency_hz"]) for row in rows] == suggestion.records.frequency_hz.tolist()
        read = np.array(
            [
                [
                    float(row[f"torque_m{j}_Nm"])
                    * np.exp(1j * np.radians(float(row[f"torque_m{j}_phase_deg"])))
                    for j in (1, 2)
                ]
                for row in rows
            ]
        )
        planned = suggestion.records.torque_Nm
        np.testing.assert_allclose(np.abs(read), np.abs(planned), rtol=1e-12)
        product, wanted = read[:, 1] * read[:, 0].conj(), planned[:, 1] * planned[:, 0].conj()
        np.testing.assert_allclose(product, wanted, atol=1e-9 * np.abs(planned).max() ** 2)


class TestFigures:
    def test_residuals_are_drawn_for_every_record_and_joint(self, found: Analysis) -> None:
        drawn = normalised_residuals(record_residuals(found.phasors, found.fit))
        dots = [t for t in drawn.data if t.mode == "markers"]
        assert [t.name for t in dots] == ["joint 1", "joint 2"]
        assert all(len(t.x) == found.phasors.omega.size for t in dots)

    def test_harmonics_are_in_per_cent(self, found: Analysis) -> None:
        content = harmonic_content(found.phasors)
        shown = harmonic_columns(content, range(2))
        assert list(shown) == ["Odd τ1 (%)", "Even τ1 (%)", "Odd τ2 (%)", "Even τ2 (%)"]
        clear = content.significance[:, 2] > 4
        assert [text != "–" for text in shown["Odd τ1 (%)"]] == clear.tolist()
        read = [number(text) for text in shown["Odd τ1 (%)"] if text != "–"]
        np.testing.assert_allclose(read, 100 * content.odd[clear, 2], rtol=0.06)


LIMITS = {
    "Gear ratios": "100, 90",
    "Start pose (°), all axes": "0, -90, 90, 0, 45, 0",
    "Lowest positions (°)": "-170, -100",
    "Highest positions (°)": "170, 10",
    "Velocities (°/s)": "200",
    "Accelerations (°/s²)": "9000",
    "Motor torques (N·m)": "30",
}


class TestSetPoints:
    def checked(self, app: AppTest, **changed: str) -> AppTest:
        at = opened(app, PLAN, plan_view="Set points")
        for label, text in {**LIMITS, **changed}.items():
            next(w for w in at.text_input if w.label == label).set_value(text)
        return shown(next(b for b in at.button if b.label.startswith("Check on")).click().run())

    def test_a_plan_can_be_saved_once_it_is_checked(self, app: AppTest) -> None:
        at = opened(app, PLAN, plan_view="Set points")
        assert any("no check and no file" in caption.value for caption in at.caption)
        at = shown(next(b for b in at.button if b.label.startswith("Check on")).click().run())
        named = 'Not checked. Enter "Gear ratios", "Start pose (°), all axes", '
        assert at.error[0].value.startswith(named)
        assert not any("set points" in d.label for d in at.get("download_button"))
        lines = [
            "gear_ratio = [100, 90]\nstart_deg = [0, -90, 90, 0, 45, 0]\nvelocity_deg_s = [200, 200]",
            "lower_deg = [-170, -100]\nupper_deg = [170, 10]\nacceleration_deg_s2 = [9000, 9000]",
            'torque_Nm = [30, 30]\njoint_names = ["a", "b", "c", "d", "e", "f"]',
        ]
        given = "limits.toml", "\n".join(lines).encode(), "application/toml"
        at = at.file_uploader(key="setpoints limits").set_value(given).run()
        names = next(w for w in at.text_input if w.label == "Names of all axes")
        assert names.value == "a, b, c, d, e, f"
        at = shown(next(b for b in at.button if b.label.startswith("Check on")).click().run())
        assert not at.error
        rows = at.table[-1].value
        assert list(rows["Joint"]) == ["1"] * 5 + ["2"] * 5
        assert all(number(margin) > 0 for margin in rows["Margin"])
        assert any("Save the set points (CSV)" in d.label for d in at.get("download_button"))
        # Simulated control exceeds the amplitudes of the plan, which exact following keeps.
        assert any("× the planned amplitude" in warning.value for warning in at.warning)
        assert "NOT RUN ON HARDWARE" in at.code[-1].value
        tab = at.tabs[1]  # the answer is above the table
        assert min(k for k, part in tab.children.items() if part.type == "table") > min(
            k
            for k, part in tab.children.items()
            if getattr(part, "success", None) and part.success[0].value == "All limits are met."
        )

    def test_over_a_limit_there_is_a_table_but_no_file(self, app: AppTest) -> None:
        at = self.checked(app, **{"Velocities (°/s)": "0.5"})
        assert re.search(r"velocity of joint \d reaches .* Set the motion scale", at.error[0].value)
        assert any("✗" in margin for margin in at.table[-1].value["Margin"])
        tab = at.tabs[1]  # the error is above the table, below the button
        place = {part.type: k for k, part in tab.children.items()}
        (above,) = (k for k, part in tab.children.items() if getattr(part, "error", None))
        assert place["button"] < above < place["table"]
        assert not any("set points" in d.label for d in at.get("download_button"))

    def test_joints_that_share_a_motor_have_no_form(
        self, app: AppTest, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(set_points_form, "coupling_problem", lambda study: "Gears couple A and B.")
        at = opened(app, PLAN, plan_view="Set points")
        assert [info.value for info in at.tabs[1].info] == ["Gears couple A and B."]
        assert not at.tabs[1].text_input

    def test_planned_motions_can_be_saved_too(self, app: AppTest) -> None:
        at = opened(app, PLAN, plan_view="Motions in place of sines")
        next(w for w in at.number_input if w.key == "motion_seconds").set_value(3.0)
        at = shown(next(b for b in at.button if b.label == "Predict").click().run())
        ways = ["sweeps (6 s)", "multisines (6 s)", "the sines above (12 s)"]
        after = ", ".join(rf"\S+ % with {re.escape(way)}" for way in ways)
        assert any(re.fullmatch(rf"Largest error \S+ % → {after}", h.value) for h in at.header)
        assert column(at, "Present records")[0] == "18 s"
        for label, text in LIMITS.items():
            [w for w in at.text_input if w.label == label][-1].set_value(text)
        [w for w in at.number_input if w.label == "Motion scale"][-1].set_value(0.3)
        check = [b for b in at.button if b.label.startswith("Check on")]
        at = shown(check[-1].click().run())
        assert not at.error
        assert any("Save the set points (CSV)" in d.label for d in at.get("download_button"))

    def test_a_wrong_entry_is_named(self, app: AppTest) -> None:
        at = self.checked(app, **{"Start pose (°), all axes": "0, zero"})
        assert "Start pose" in at.error[0].value
