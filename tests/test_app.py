"""The app without a browser: clicks, uploads and page texts."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import streamlit as st
from app_pages import figures, shown, upload
from random_cases import tries
from streamlit.testing.v1 import AppTest

from jointid import Inertia, Study
from jointid.files.study_files import pack_study
from jointid.ui.shared import charts, workspace
from jointid.ui.shared.page import Page
from jointid.ui.shared.results import Computation
from jointid.wording import unbroken

TITLES = {
    "pages/1_Records.py": "Records",
    "pages/2_Phasors.py": "Phasors",
    "pages/3_Transfer_matrix.py": "Transfer matrix",
    "pages/4_Elasticity.py": "Elasticity",
    "pages/8_Simulate.py": "Simulate a robot",
    "pages/9_Import_a_log.py": "Import a log",
    "pages/12_Glossary.py": "Glossary",
}
RECORD_VIEWS = ("A few periods", "Whole record", "Spectrum")
FIGURES = {
    "pages/1_Records.py": 2,
    "pages/2_Phasors.py": 2,
    "pages/3_Transfer_matrix.py": 2,
    "pages/4_Elasticity.py": 2,
}
"""How many figures each page shows of two joints."""


def test_an_internal_error_is_shown_as_one_message() -> None:
    def script() -> None:
        from jointid.ui.server.serving import show_internal_error

        show_internal_error(ZeroDivisionError("division by *zero*"))

    at = AppTest.from_function(script).run()
    assert not at.exception
    (said,) = at.error
    assert said.value.startswith("Internal error, ZeroDivisionError (division by \\*zero\\*). This")


def metric(at: AppTest, name: str) -> tuple[float, float]:
    value = next(m.value for m in at.metric if m.label.startswith(name))
    number, _, error = value.partition(" ± ")
    return float(number.replace("−", "-")), float(error.lstrip("<"))


def repacked(study: Study, change: dict[str, bytes | None]) -> bytes:
    """A study's zip with some files replaced, or left out."""
    buffer = io.BytesIO()
    with (
        zipfile.ZipFile(io.BytesIO(pack_study(study))) as old,
        zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as new,
    ):
        for name in old.namelist():
            data = change.get(name, old.read(name))
            if data is not None:
                new.writestr(name, data)
    return buffer.getvalue()


class TestFirstScreen:
    def test_it_gives_the_answer_and_the_source_of_the_papers_study(self, app: AppTest) -> None:
        at = shown(app.run())
        assert at.title[0].value == "Test cell with 2 joint(s)"
        for name, truth in {"K1": 43.0, "K2": 7.5, "D1": 0.10, "D2": 0.015}.items():
            value, error = metric(at, name)
            assert abs(value - truth) < 5 * error + 0.003 * truth, name
        assert "2.0 times as stiff as nominal" in at.header[0].value
        assert figures(at) == 2
        facts = " ".join(m.value for m in at.markdown)
        for fact in ("simulated", "12 records", "2 joints", unbroken("3–29 Hz")):
            assert fact in facts
        assert any(s.value.startswith("Path error ") for s in at.header)
        assert any("nominal values" in html.proto.body for html in at.get("html"))

    @pytest.mark.parametrize(("key", "joints"), [("one joint", 1), ("three joints", 3)])
    def test_the_overview_shows_any_number_of_joints(self, app: AppTest, key: str, joints: int) -> None:
        app.query_params["study"] = key
        at = shown(app.run())
        expected = {f"{q}{j}" for q in "KD" for j in range(1, joints + 1)}
        assert {m.label.split()[0] for m in at.metric} == expected
        assert figures(at) == joints
        assert not any("Path error" in s.value for s in at.header)  # no cut applies

    def test_without_samples_the_overview_shows_how_to_get_a_study(
        self, app: AppTest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(workspace, "SAMPLES", tmp_path / "nowhere")
        at = shown(app.run())
        assert at.title[0].value == "No study yet"


@pytest.mark.parametrize("page", TITLES)
class TestEveryPage:
    def test_each_page_opens_alone(self, app: AppTest, page: str) -> None:
        at = shown(app.switch_page(page).run())
        assert at.title[0].value == TITLES[page]
        assert not at.error
        assert figures(at) == FIGURES.get(page, 0)

    def test_each_page_shows_three_joints(self, app: AppTest, page: str) -> None:
        app.query_params["study"] = "three joints"
        at = shown(app.switch_page(page).run())
        assert not at.error
        assert at.selectbox(key="study").value == "three joints"


class TestTheWayThrough:
    def test_the_chosen_study_and_estimator_stay_from_page_to_page(self, app: AppTest) -> None:
        at = shown(app.run())
        at = shown(at.selectbox(key="study").set_value("three joints").run())
        at = shown(at.selectbox(key="estimator").set_value("least-squares").run())
        for page in FIGURES:
            at = shown(at.switch_page(page).run())
            assert at.selectbox(key="study").value == "three joints"
            assert at.selectbox(key="estimator").value == "least-squares"
        at.session_state["details"] = "Estimators"
        at = shown(at.run())
        table = next(
            shown.value for shown in at.table if "nominal" in shown.value or "auto" in shown.value
        )
        assert table.columns[1] == "least-squares"

    def test_the_chosen_record_is_the_one_that_is_drawn(self, app: AppTest) -> None:
        """A number that the next study lacks selects its first record."""
        at = shown(app.switch_page("pages/1_Records.py").run())
        first = at.get("plotly_chart")[0].proto.spec
        at = shown(at.selectbox(key="record").set_value(11).run())
        assert at.get("plotly_chart")[0].proto.spec != first
        at = shown(at.selectbox(key="study").set_value("one joint").run())
        assert at.selectbox(key="record").value in range(6)

    def test_a_record_and_the_cross_check_wait_for_no_worker(
        self, app: AppTest, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """They take milliseconds; a worker may be busy for a second with a cut of somebody else."""
        begun: list[Any] = []
        begin = Page.begin

        def noted(page: Page, what: Any, *given: Any, **named: Any) -> Any:
            begun.append(what)
            return begin(page, what, *given, **named)

        monkeypatch.setattr(Page, "begin", noted)
        at = shown(app.run())
        assert any("Cross-check" in caption.value for caption in at.caption)
        shown(at.switch_page("pages/1_Records.py").run())
        named = {what if isinstance(what, str) else f"{what[0]} of a cut" for what in begun}
        assert named == {"analysis", "before of a cut", "prediction of a cut"}

    @pytest.mark.parametrize("view", RECORD_VIEWS)
    def test_every_view_of_a_record_has_a_figure_per_joint(self, app: AppTest, view: str) -> None:
        app.session_state["records_view"] = view
        at = shown(app.switch_page("pages/1_Records.py").run())
        assert figures(at) == 2
        assert at.session_state["records_view"] == view

    def test_off_diagonal_elements_are_shown_as_a_pair(self, app: AppTest) -> None:
        at = shown(app.switch_page("pages/3_Transfer_matrix.py").run())
        at = shown(at.button_group(key="element").set_value("H12 and H21").run())
        assert any("H12 and H21 are equal" in caption.value for caption in at.caption)


class TestOpeningAFile:
    def test_an_uploaded_study_is_analysed(self, app: AppTest, studies: dict[int, Study]) -> None:
        at = upload(shown(app.run()), studies[1])
        assert at.title[0].value == "Test cell with 1 joint(s)"
        assert at.selectbox(key="study").value == "mine.zip"
        at = shown(at.switch_page("pages/4_Elasticity.py").run())
        assert at.selectbox(key="study").value == "mine.zip"

    def test_a_file_that_is_no_zip_is_refused_and_the_study_stays(self, app: AppTest) -> None:
        at = upload(shown(app.run()), b"this is no archive")
        assert len(at.error) == 1
        assert "mine.zip was not opened" in at.error[0].value
        assert at.title[0].value == "Test cell with 2 joint(s)"

    def test_a_missing_column_is_named_and_the_data_stay_visible(
        self, app: AppTest, studies: dict[int, Study]
    ) -> None:
        bad = b"time_s,theta_m1_rad\n0,0.1\n0.001,0.2\n0.002,0.3\n"
        at = upload(shown(app.run()), repacked(studies[1], {"records/01.csv": bad}))
        assert len(at.error) == 1
        assert "tau_m1_Nm" in at.error[0].value
        assert "records/01.csv" in at.error[0].value
        assert "time_s,theta_m1_rad" in at.code[0].value
        at = shown(at.button(key="dismiss_refused").click().run())
        assert not at.error
        assert figures(at) == 2

    def test_the_refused_row_is_shown_with_its_neighbours(
        self, app: AppTest, studies: dict[int, Study]
    ) -> None:
        study = studies[1]
        data = zipfile.ZipFile(io.BytesIO(pack_study(study))).read("records/02.csv").decode()
        lines = data.splitlines()
        lines[99] = lines[99].rpartition(",")[0] + ",nan"
        at = upload(shown(app.run()), repacked(study, {"records/02.csv": "\n".join(lines).encode()}))
        assert "records/02.csv, line 100" in at.error[0].value
        assert f"▶    100  {lines[99]}" in at.code[0].value

    def test_the_refusal_is_shown_on_other_pages(self, app: AppTest, studies: dict[int, Study]) -> None:
        at = upload(shown(app.run()), repacked(studies[1], {"study.toml": b"format = 1\n"}))
        at = shown(at.switch_page("pages/2_Phasors.py").run())
        assert "mine.zip was not opened" in at.error[0].value
        assert at.title[0].value == "Phasors"

    def test_two_files_of_one_name_do_not_hide_each_other(
        self, app: AppTest, studies: dict[int, Study]
    ) -> None:
        at = upload(shown(app.run()), studies[1])
        at = upload(at, studies[3])
        assert {"mine.zip", "mine.zip (2)"} <= set(at.selectbox(key="study").options)
        assert at.title[0].value == "Test cell with 3 joint(s)"


class TestAnalysisThatFails:
    @pytest.fixture
    def still(self, studies: dict[int, Study]) -> bytes:
        """Joint 2 neither moves nor gets torque."""
        study = studies[2]
        change: dict[str, bytes | None] = {}
        for number, record in enumerate(study.records, start=1):
            zero = np.zeros_like(record.time_s)
            columns = (record.time_s, record.theta_rad[:, 0], zero, record.tau_Nm[:, 0], zero)
            rows = "\n".join(",".join(map(repr, map(float, row))) for row in zip(*columns, strict=True))
            head = "time_s,theta_m1_rad,theta_m2_rad,tau_m1_Nm,tau_m2_Nm\n"
            change[f"records/{number:02}.csv"] = (head + rows + "\n").encode()
        # Uncoupled, so that nothing reaches joint 2.
        toml = zipfile.ZipFile(io.BytesIO(pack_study(study))).read("study.toml").decode()
        change["study.toml"] = toml.replace("0.000395", "0.0").encode()
        return repacked(study, change)

    def test_the_records_remain_visible(self, app: AppTest, still: bytes) -> None:
        at = upload(shown(app.run()), still)
        assert len(at.error) == 1
        assert "2" in at.error[0].value
        assert not at.metric
        at = shown(at.switch_page("pages/1_Records.py").run())
        assert figures(at) == 2
        for view in RECORD_VIEWS:
            at.session_state["records_view"] = view
            at = shown(at.switch_page("pages/1_Records.py").run())
            assert (figures(at), at.session_state["records_view"]) == (2, view)

    def test_unphysical_stiffness_is_reported_as_unusable(
        self, app: AppTest, studies: dict[int, Study]
    ) -> None:
        right = studies[2].inertia
        records = studies[2].records[:4]
        wrong = replace(studies[2], records=records, inertia=Inertia(0.5 * right.M, 2 * right.M2))
        at = shown(app.run())
        at = shown(at.selectbox(key="estimator").set_value("least-squares").run())  # the quickest
        at = upload(at, wrong)
        assert "Not usable: " in at.error[0].value
        assert not any("stiff" in header.value for header in at.header)
        assert not at.metric
        for page, count in FIGURES.items():
            at = shown(at.switch_page(page).run())
            assert figures(at) == count
            assert not any("Lost motion" in table.value.to_string() for table in at.table)
            if "Transfer" in page:  # with the model
                assert at.error[0].value.startswith("Not usable: ")


class TestSimulating:
    @pytest.fixture
    def form(self, app: AppTest) -> AppTest:
        app.query_params["sim_count"] = "4"  # as the browser has it once it was entered
        at = shown(app.switch_page("pages/8_Simulate.py").run())
        at.number_input(key="sim_seconds").set_value(1.0)
        at.text_input(key="sim_coulomb").set_value("0")
        return at

    def test_a_number_beyond_its_limits_is_named_and_not_simulated(self, form: AppTest) -> None:
        form.number_input(key="sim_first").set_value(-5.0)
        at = form.button(key="simulate").click().run()
        assert [e.value for e in at.error] == ["First frequency (Hz): −5 is not between 0.05 and 1000."]
        assert at.title[0].value == "Simulate a robot"
        assert at.text_input(key="sim_gain").value == "1"  # the form stays

    def test_a_simulated_robot_becomes_a_study_and_gives_its_elasticity(self, form: AppTest) -> None:
        form.text_input(key="sim_K").set_value("30, 12")
        at = shown(form.button[0].click().run())
        assert not at.error
        assert at.title[0].value.startswith("Simulated robot")
        assert any("simulated" in m.value for m in at.markdown)
        assert metric(at, "K1")[0] == pytest.approx(30, rel=0.02)
        assert metric(at, "K2")[0] == pytest.approx(12, rel=0.02)

    def test_sines_of_two_amplitudes_show_a_hardening_gear(self, form: AppTest) -> None:
        form.text_input(key="sim_amplitudes").set_value("100, 30")
        form.text_input(key="sim_cubic").set_value("9000, 0")
        form.number_input(key="sim_seconds").set_value(tries(1.5, nightly=4.0))
        at = shown(form.button[0].click().run())
        assert not at.error
        text = " ".join(m.value.replace("\N{NO-BREAK SPACE}", " ") for m in [*at.markdown, *at.caption])
        assert "16 records" in text
        assert "amplitudes 100, 30 %" in text
        assert metric(at, "K1")[0] == pytest.approx(43, rel=0.02)
        at = shown(at.switch_page("pages/4_Elasticity.py").run().run())
        assert "K over amplitude" in [tab.label for tab in at.tabs]

    def test_another_motion_has_one_amplitude(self, form: AppTest) -> None:
        at = shown(form.selectbox(key="sim_pattern").set_value("Sweeps").run())
        at.text_input(key="sim_amplitudes").set_value("100, 30")
        at = shown(at.button[0].click().run())
        assert [e.value for e in at.error] == ["Amplitudes (%): 100, 30. Only sines may have several."]

    def test_another_motion_becomes_a_study_of_motions(self, form: AppTest) -> None:
        at = shown(form.selectbox(key="sim_pattern").set_value("Sweeps").run())
        at.number_input(key="sim_seconds").set_value(4.0)
        at = shown(at.button[0].click().run())
        assert not at.error
        assert metric(at, "K1")[0] == pytest.approx(43, rel=0.02)

    def test_entries_are_written_to_the_address_and_read_from_it(self, app: AppTest) -> None:
        app.query_params["sim_K"] = "50, 9"
        app.query_params["sim_count"] = "7"
        app.query_params["sim_torque_std"] = "± 5 %"
        at = shown(app.switch_page("pages/8_Simulate.py").run())
        assert at.text_input(key="sim_K").value == "50, 9"
        assert at.number_input(key="sim_count").value == 7
        assert at.selectbox(key="sim_torque_std").value == "± 5 %"
        at.text_input(key="sim_D").set_value("0.2, 0.02")
        at = shown(at.run())
        at = shown(at.switch_page("pages/12_Glossary.py").run())
        at = shown(at.switch_page("pages/8_Simulate.py").run())
        assert at.text_input(key="sim_D").value == "0.2, 0.02"

    def test_wrong_inertias_and_torque_scale_are_corrected_by_a_known_payload(
        self, form: AppTest
    ) -> None:
        form.number_input(key="sim_wrong").set_value(10.0)
        form.text_input(key="sim_gain").set_value("1.07, 0.95")
        form.text_input(key="sim_added").set_value("0.0012, 0.0005; 0.0005, 0.0009")
        for what in ("inertia", "torque"):
            form.selectbox(key=f"sim_{what}_std").set_value("unknown")
        at = shown(form.button[0].click().run())
        assert not at.error
        assert metric(at, "K1")[0] == pytest.approx(43, rel=0.02)
        assert metric(at, "K2")[0] == pytest.approx(7.5, rel=0.02)
        text = " ".join(m.value for m in [*at.markdown, *at.caption])
        assert "Given inertias wrong by 10 %. Logged torque / true torque = 1.07, 0.95." in text
        assert "16 records" in text

    def test_one_joint(self, form: AppTest) -> None:
        for key, value in {"K": "43", "D": "0.1", "M": "0.0025", "M2": "0.0041", "viscous": "0"}.items():
            form.text_input(key=f"sim_{key}").set_value(value)
        at = shown(form.button[0].click().run())
        assert {m.label.split()[0] for m in at.metric} == {"K1", "D1"}

    def test_an_impossible_robot_is_refused_and_the_entries_stay(self, form: AppTest) -> None:
        for field, value, said in (
            ("K", "43, -7.5", "must be positive"),
            ("K", "43, soft", '"soft" is not a number'),
            ("M", "0.0025", "M2 has shape"),
            ("M2", "0.004, 0.0004; 0.0004", "rows have 2, 1 values"),
            ("M2", "0.001, 0.01; 0.01, 0.001", "positive definite"),
            ("coulomb", "1, 2, 3", "3 values for 2 joints"),
            ("gain", "1, 0", "Logged torque / true torque: 1, 0. Give positive"),
            ("amplitudes", "100, 0", "Amplitudes (%): 100, 0. Give positive"),
            ("added", "0.001, 0; 0.001", "rows have 2, 1 values"),
            ("added", "0.001, 0.002; 0, 0.001", "added must be symmetric"),
        ):
            entry = form.text_input(key=f"sim_{field}")
            right = entry.value
            entry.set_value(value)
            form = shown(form.button[0].click().run())
            assert len(form.error) == 1, value
            assert said in form.error[0].value
            assert form.text_input(key=f"sim_{field}").value == value
            form.text_input(key=f"sim_{field}").set_value(right)


def test_terms_of_a_page_are_explained_on_that_page(app: AppTest) -> None:
    at = shown(app.switch_page("pages/2_Phasors.py").run())
    hint = at.markdown[0].proto.help
    assert "**Phasor**: " in hint
    assert "**Backlash**" not in hint


def test_hints_hold_whole_entries_of_the_glossary() -> None:
    entries = [entry[0] for entry in charts._ENTRY.finditer(charts.glossary())]
    assert len(entries) > 60
    assert all(entry.endswith(".") for entry in entries)


def test_the_settings_of_an_address_hold_on_the_next_page(app: AppTest) -> None:
    app.query_params.update(unit="N·m/° at the motor", estimator="weighted")
    at = app.switch_page("pages/12_Glossary.py").run()
    at = at.switch_page("pages/10_Fleet.py").run()
    assert at.selectbox(key="unit").value == "N·m/° at the motor"
    assert at.selectbox(key="estimator").value == "weighted"


def test_a_stopped_analysis_leaves_the_last_answer(
    app: AppTest, studies: dict[int, Study], monkeypatch: pytest.MonkeyPatch
) -> None:
    def not_yet(doing: str, *begun: Computation[object], stop: Callable[[], None]) -> None:
        """Draw the page as it is while a long computation on the dropped study runs."""
        if st.session_state["chosen"] != "paper":
            st.button("Stop", key="stop", on_click=stop)
            st.stop()

    at = shown(app.run())
    answer = [metric.value for metric in at.metric]
    with monkeypatch.context() as busy:
        busy.setattr("jointid.ui.shared.page.awaited", not_yet)
        at = upload(at, replace(studies[1], name="long"))
        assert not at.metric
        at = shown(at.button(key="stop").click().run())
        assert [metric.value for metric in at.metric] == answer
        assert at.selectbox(key="study").value == "paper"
        at = shown(at.selectbox(key="study").set_value("mine.zip").run())
        at.session_state["answered"] = {}  # in a new tab there is no answer to go back to
        at = shown(at.button(key="stop").click().run())
        assert at.info[0].value.endswith("stopped.")
    at = shown(at.button(key="resume").click().run())
    assert (at.title[0].value, len(at.metric)) == ("long", 2)


def test_the_laws_of_gears_are_grouped_and_stay_in_view_after_f5(app: AppTest) -> None:
    app.query_params.update(sim_gears="true", sim_backlash_rad="0.001")
    at = shown(app.switch_page("pages/8_Simulate.py").run())
    (gears,) = (each for each in at.expander if each.label == "Nonlinear gears")
    assert gears.proto.expanded
    assert len(gears.caption) == 3
    assert [field.value for field in gears.text_input] == ["0", "0.001", *["0"] * 6]
