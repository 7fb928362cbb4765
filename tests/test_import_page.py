"""The import page without a browser: mapping, sine runs, study."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from app_pages import figures, shown
from log_makers import cell_log, comma_log, mat_scope
from streamlit.testing.v1 import AppTest

from jointid import Inertia, JointIdError
from jointid.arrays import Floats
from jointid.figures.log_spans import log_spans
from jointid.importing import (
    Channel,
    JointMapping,
    MappedLog,
    Mapping,
    Segment,
    TimeColumn,
    find_segments,
    guess_mapping,
    mapping_to_json,
    read_log,
)
from jointid.ui.importing.segments import Row, apply_edits, chosen_segments
from jointid.ui.shared.method_steps import ACTIONS
from jointid.verdict.evidence import Action

PAGE = "pages/9_Import_a_log.py"
FREQUENCIES_HZ = (4.0, 6.5, 11.0)


def runs(ratio: float = 1.0) -> tuple[Floats, Floats, Floats]:
    """Time (s), joint angle (rad) and motor torque (N·m): three sine runs with rests, one joint."""
    rng = np.random.default_rng(3)
    time = np.arange(0, 9.0, 4e-3)
    theta, tau = np.full(time.size, 0.2), np.zeros(time.size)
    for k, hertz in enumerate(FREQUENCIES_HZ):
        inside = (time >= 3 * k + 0.4) & (time < 3 * k + 2.6)
        phase = 2 * np.pi * hertz * (time[inside] - 3 * k - 0.4)
        theta[inside] += 0.05 * (np.cos(phase) - 1) / ratio
        tau[inside] = -0.05 * 0.004 * (2 * np.pi * hertz) ** 2 * np.cos(phase)
    theta += 2e-6 / ratio * rng.standard_normal(time.size)
    return time, theta, tau + 1e-4 * rng.standard_normal(time.size)


@cache
def long_log(ratio: float = 1.0) -> bytes:
    rows = np.column_stack(runs(ratio))
    lines = [",".join(f"{value:.9g}" for value in row) for row in rows]
    return "\n".join(["time (s),joint position (rad),motor torque (Nm)", *lines, ""]).encode()


@pytest.fixture
def page(app: AppTest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> AppTest:
    monkeypatch.setenv("JOINTID_DATA_DIR", str(tmp_path / "data"))
    return shown(app.switch_page(PAGE).run())


@pytest.fixture
def seen(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """The facts of each study that the page would make; each is refused."""
    found: list[dict[str, Any]] = []

    def refuse(_: object, __: object, inertia: Inertia, **facts: Any) -> None:
        found.append(facts | {"inertia": inertia})
        raise JointIdError("enough seen")

    monkeypatch.setattr("jointid.ui.importing.panels.study_from_logs", refuse)
    return found


def drop(at: AppTest, *files: tuple[str, bytes]) -> AppTest:
    uploader = next(each for each in at.file_uploader if str(each.key).startswith("log_file"))
    uploader.set_value([(*file, "application/octet-stream") for file in files])
    return shown(at.run())


def widget(at: AppTest, kind: str, label: str, nth: int = 0) -> Any:
    return [w for w in getattr(at, kind) if w.label.startswith(label)][nth]


def head(at: AppTest, step: str) -> str:
    """What the head of a step says beside its name."""
    labels = [e.label for e in at.expander if step in e.label]
    return labels[0].partition("[")[2].rpartition("]")[0].replace("\xa0", " ")


def opened(at: AppTest) -> list[str]:
    return [e.label.split("**")[1] for e in at.expander if e.proto.expanded]


def assumed(at: AppTest) -> str:
    return " ".join(m.value for m in at.markdown if "Not confirmed" in m.value)


def sides(at: AppTest) -> list[list[str]]:
    """Joints whose position, and whose torque, is measured at the joint."""
    groups = [g for g in at.button_group if "behind the gear" in g.label]
    return [list(group.value) for group in groups]


def confirm(at: AppTest, what: str = "drive data") -> AppTest:
    widget(at, "button", f"Confirm the {what}").click()
    return shown(at.run())


def send(at: AppTest, M: str, M2: str, button: str = "Open as study") -> AppTest:
    at.text_input(key="import M").set_value(M)
    at.text_input(key="import M2").set_value(M2)
    widget(at, "button", button).click()
    return shown(at.run())


def stops_opening(at: AppTest) -> str:
    """The sentence at the buttons, which are disabled."""
    assert widget(at, "button", "Open as study").disabled
    assert widget(at, "button", "Open its report").disabled
    return str(at.error[-1].value)


def test_what_the_reader_left_out_is_stated_once(page: AppTest) -> None:
    at = drop(page, ("log.csv", b"Cell 2, run of Monday\n" + long_log()))
    assert sum("Lines above the table" in caption.value for caption in at.caption) == 1


def test_every_action_of_a_finding_has_its_place_on_a_page(page: AppTest) -> None:
    """The verdict says what to edit, without a page's label; the app says where."""
    at = drop(page, ("one.csv", long_log()))
    labels = [*(e.label for e in at.expander), *(s.value for s in at.header)]
    assert set(ACTIONS) == {*get_args(Action), ""} - {""}
    for step, part in ACTIONS.values():
        assert step.path == PAGE
        assert step.name == at.title[0].value
        assert sum(label.strip("*").startswith(part) for label in labels) == 1, (part, labels)


class TestMapping:
    def test_columns_units_and_sides_are_proposed(self, page: AppTest, jittered_log: bytes) -> None:
        at = drop(page, ("actuator.csv", jittered_log))
        assert widget(at, "selectbox", "Time").value == "t"
        assert widget(at, "selectbox", "Position of joint 1").value == "position"
        assert widget(at, "selectbox", "Torque of joint 1").value == "effort"
        assert figures(at) == 2
        assert any("To check" in m.value for m in at.markdown)
        guesses = at.table[0].value
        assert {"Time", "Position of joint 1"} <= set(guesses["Entry"])
        assert set(guesses["Sure"]) == {"yes", "to check"}

    def test_a_sensor_behind_the_gear_is_offered(self, page: AppTest) -> None:
        data = comma_log().replace(b"t,position,effort", b"t,motor_position,effort,link_position")
        data = b"\n".join(
            line if k == 0 or not line else line + b",%g" % (k % 7)
            for k, line in enumerate(data.split(b"\n"))
        )
        at = drop(page, ("run.csv", data))
        assert widget(at, "selectbox", "Position of joint 1").value == "motor_position"
        sensor = widget(at, "selectbox", "Arm-side position of joint 1")
        assert sensor.value == "link_position"
        assert "gear ratios" in head(at, "3 Drive data")
        at = shown(sensor.set_value("none").run())
        assert widget(at, "selectbox", "Arm-side position of joint 1").value == "none"

    def test_a_role_that_no_column_fits_is_asked_for(self, page: AppTest) -> None:
        data = comma_log().replace(b"t,position,effort", b"t,velocity,abc")
        at = drop(page, ("run.csv", data))
        assert widget(at, "selectbox", "Position of joint 1").value is None
        assert opened(at) == ["2 Columns"]
        assert head(at, "2 Columns") == "choose: position of joint 1, torque of joint 1"
        widget(at, "selectbox", "Position of joint 1").set_value("velocity")
        at = shown(at.run())
        assert widget(at, "selectbox", "Unit of position 1").value == "rad"
        assert head(at, "2 Columns") == "choose: torque of joint 1"
        assert not [w for w in at.text_input if w.label.startswith("Gear ratios")]
        widget(at, "selectbox", "Torque of joint 1").set_value("abc")
        at = shown(at.run())
        assert widget(at, "selectbox", "Unit of torque 1").value == "N·m"
        assert head(at, "2 Columns").endswith("to check")  # a unit that the file does not state
        widget(at, "selectbox", "Unit of torque 1").set_value("A")
        widget(at, "selectbox", "Unit of position 1").set_value("deg")
        at = shown(at.run())
        assert not any("Unit of" in m.value for m in at.markdown)
        assert not at.error
        assert "missing" in head(at, "3 Drive data")

    def test_open_roles_beside_many_columns(self, page: AppTest) -> None:
        rows = "".join(f"{k / 100},{k % 7},1,2,3,{k % 5}\n" for k in range(60))
        at = drop(page, ("run.csv", f"t,a,b,c,d,e\n{rows}".encode()))
        assert head(at, "2 Columns") == "choose: position of joint 1, torque of joint 1"

    def test_a_wrong_entry_is_not_confirmed_as_unknown(self, page: AppTest) -> None:
        at = drop(page, ("cell.csv", cell_log()))
        widget(at, "text_input", "Gear ratios, one per joint").set_value("101, -93,5")
        at = confirm(at)
        assert opened(at) == ["3 Drive data"]
        assert "can be read as" in at.error[0].value
        widget(at, "text_input", "Gear ratios, one per joint").set_value("101, -93.5")
        at = confirm(at)
        assert not at.error
        assert opened(at) == ["5 Inertias"]

    def test_a_unit_without_a_fixed_scale_has_an_entry_for_it(self, page: AppTest) -> None:
        at = drop(page, ("cell.csv", cell_log()))
        assert widget(at, "selectbox", "Unit of torque 1").value == "%"
        assert widget(at, "text_input", "Rated torque (N·m), one per joint").value == ""
        assert "rated torques" in head(at, "3 Drive data")
        widget(at, "selectbox", "Unit of torque 2").set_value("A")
        at = shown(at.run())
        assert widget(at, "text_input", "Torque constant (N·m/A) of joint 2").value == ""

    def test_a_column_used_twice_is_reported_and_the_file_stays_visible(self, page: AppTest) -> None:
        at = drop(page, ("log.csv", comma_log()))
        widget(at, "selectbox", "Torque of joint 1").set_value("position")
        at = shown(at.run())
        assert len(at.error) == 1
        assert "both position of joint 1 and torque" in at.error[0].value
        assert figures(at) == 1
        assert widget(at, "selectbox", "Torque of joint 1").value == "position"

    def test_the_mapping_is_offered_again_for_the_same_columns(self, page: AppTest) -> None:
        at = drop(page, ("one.csv", long_log()))
        widget(at, "text_input", "Gear ratios").set_value("101")
        at = drop(shown(at.run()), ("two.csv", long_log(ratio=50.0)))
        assert widget(at, "text_input", "Gear ratios").value == "101"
        assert any("again" in info.value for info in at.info)
        widget(at, "button", "Guess again").click()
        at = shown(at.run())
        assert widget(at, "text_input", "Gear ratios").value == ""
        assert not any("again" in info.value for info in at.info)

    def test_entries_and_logs_stay_after_a_visit_to_another_page(self, page: AppTest) -> None:
        at = drop(page, ("one.csv", long_log()))
        widget(at, "text_input", "Gear ratios").set_value("-93.5")
        at.text_input(key="import M").set_value("0.001")
        at = shown(at.run())
        at = shown(at.switch_page("pages/1_Records.py").run())
        at = shown(at.switch_page(PAGE).run())
        assert widget(at, "text_input", "Gear ratios").value == "-93.5"
        assert figures(at) == 2

    def test_a_mapping_is_taken_from_a_file_or_refused(self, page: AppTest) -> None:
        at = drop(page, ("one.csv", long_log()))
        (log,) = read_log(long_log(), "one.csv")
        guess = guess_mapping(log).mapping
        mine = replace(guess, joints=(replace(guess.joints[0], gear_ratio=-50.0),), torque_hold=True)
        text = mapping_to_json(mine).encode()
        uploader = at.file_uploader(key="import_mapping_file 0")
        uploader.set_value(("m.json", text.replace(b"motor torque", b"effort"), "application/json"))
        at = shown(at.run())
        assert "m.json was not used" in at.error[0].value
        uploader = at.file_uploader(key="import_mapping_file 0")
        uploader.set_value(("m.json", text, "application/json"))
        at = shown(at.run())
        assert not at.error
        assert widget(at, "text_input", "Gear ratios").value == "-50"
        assert widget(at, "button_group", "Torque between").value == "held until the next sample"

    def test_a_missing_torque_is_reported_and_a_column_is_proposed(self, page: AppTest) -> None:
        lines = cell_log().decode("latin-1").split("\r\n")
        lines = [line.rpartition(";")[0] if line.count(";") == 4 else line for line in lines]
        at = drop(page, ("cell.csv", "\r\n".join(lines).encode("latin-1")))
        assert widget(at, "number_input", "Joints").value == 1
        checks = [m.value for m in at.markdown if "To check" in m.value]
        assert any('"Achse 2 Ist" has no matching torque' in check for check in checks)
        widget(at, "number_input", "Joints").set_value(2)
        at = shown(at.run())
        assert widget(at, "selectbox", "Position of joint 2").value == "Achse 2 Ist"
        assert widget(at, "selectbox", "Torque of joint 2").value is None
        assert widget(at, "selectbox", "Unit of position 2").value == "deg"
        assert widget(at, "selectbox", "Unit of torque 2").value == "%"
        assert head(at, "2 Columns") == "choose: torque of joint 2"
        assert any("only a proposal" in m.value for m in at.markdown if "To check" in m.value)
        widget(at, "selectbox", "Torque of joint 1").set_value("Achse 2 Ist")
        assert "is both torque of joint 1 and position of joint 2" in shown(at.run()).error[0].value
        widget(at, "number_input", "Joints").set_value(1)
        widget(at, "selectbox", "Torque of joint 1").set_value("Moment 1")
        at = shown(at.run())
        assert sides(at) == [["1"], []]

    def test_closing_the_logs_clears_the_robot_but_not_the_mapping(self, page: AppTest) -> None:
        at = drop(page, ("one.csv", long_log()))
        widget(at, "text_input", "Gear ratios").set_value("101")
        at.text_input(key="import M").set_value("0.001")
        at.text_input(key="import M2").set_value("0.003")
        at.text_input(key="import nominal K").set_value("20")
        at.selectbox(key="import M unit").set_value("kg·cm²")
        at = shown(at.run())
        for row in next(iter(at.session_state["import_segments_last"].values())):
            object.__setattr__(row, "use", False)
        at = shown(at.switch_page("pages/1_Records.py").run())
        at = shown(at.switch_page(PAGE).run())
        assert at.text_input(key="import M").value == "0.001"
        widget(at, "button", "Start a new import").click()
        at = drop(shown(at.run()), ("one.csv", long_log()))
        assert widget(at, "text_input", "Gear ratios").value == "101"
        assert [at.text_input(key=f"import {name}").value for name in ("M", "M2", "nominal K")] == [
            ""
        ] * 3
        assert at.selectbox(key="import M unit").value == "kg·m²"
        assert all(row.use for part in at.session_state["import_segments_last"].values() for row in part)
        assert any("used again" in i.value and "Inertias are not reused" in i.value for i in at.info)


class TestStudy:
    def test_robot_entries_are_saved_in_the_study(self, page: AppTest, seen: list[Any]) -> None:
        at = drop(page, ("one.csv", long_log()))
        at.text_input(key="import nominal K").set_value("20,5; ")
        at.text_input(key="import robot").set_value("cell 7")
        at.text_input(key="import date").set_value("last week")
        at = send(at, "soft", "3e-3")
        assert not seen
        assert '"soft" is not a number' in at.error[0].value
        assert "Nominal D is missing" in at.error[0].value
        assert "'last week' is not a date" in at.error[0].value
        for kind in ("M", "M2"):
            at.selectbox(key=f"import {kind} unit").set_value("kg·cm²")
        at.text_input(key="import date").set_value("2026-11-20")
        at.text_input(key="import nominal K").set_value("20.5, 3")
        at.text_input(key="import nominal D").set_value("0.1, 0.2")
        assert "are for 2 joints" in send(at, "10", "30").error[0].value
        at.text_input(key="import nominal K").set_value("20.5")
        at.text_input(key="import nominal D").set_value("0.1")
        assert "enough seen" in send(at, "10", "30").error[0].value
        (facts,) = seen
        assert (facts["nominal"].K.tolist(), facts["nominal"].D.tolist()) == ([20.5], [0.1])
        assert (facts["robot"], str(facts["date"])) == ("cell 7", "2026-11-20")
        assert pytest.approx([1e-3]) == facts["inertia"].M
        assert pytest.approx(np.array([[3e-3]])) == facts["inertia"].M2

    def test_assumptions_are_listed_at_the_button_until_values_are_entered(self, page: AppTest) -> None:
        at = drop(page, ("cell.csv", cell_log()))
        assert "rated torque 1 N·m (joints 1 and 2)" in assumed(at)
        assert "position measured at the joint (joints 1 and 2)" in assumed(at)
        assert "direction of torque as logged" in assumed(at)
        at = drop(page, ("one.csv", long_log()))
        assert "gear ratio 1 (joint 1)" in assumed(at)
        widget(at, "selectbox", "Unit of torque 1").set_value("A")
        at = shown(at.run())
        assert "torque constant 1 N·m/A (joint 1); gear ratio 1 (joint 1)" in assumed(at)
        widget(at, "text_input", "Gear ratios").set_value("50")
        widget(at, "text_input", "Torque constant").set_value("0.3")
        widget(at, "button_group", "Torque between").set_value("held until the next sample")
        at = shown(at.run())
        assert "torque constant" not in assumed(at)
        assert "gear ratio" not in assumed(at)
        assert "direction of position" in assumed(at)
        assert assumed(confirm(at)) == ""

    def test_unproven_columns_stay_open_until_confirmed(self, page: AppTest) -> None:
        at = drop(page, ("cell.csv", cell_log()))
        assert opened(at) == ["3 Drive data"]
        for label, text in (("Gear ratios", "101; -93,5"), ("Rated torque", "8.2, 2.1")):
            widget(at, "text_input", label).set_value(text)
        widget(at, "button_group", "Torque between").set_value("held until the next sample")
        at = shown(at.run())
        assert head(at, "3 Drive data").endswith("to confirm")
        said = [m.value for m in at.markdown if "accelerates towards positive" in m.value]
        assert ["Direction of position and torque of joints 1 and 2" in text for text in said] == [True]
        at = confirm(at)
        assert (assumed(at), opened(at)) == ("", ["5 Inertias"])
        assert not any("To check" in m.value for m in at.markdown)
        assert head(at, "3 Drive data").startswith(
            "gear ratios 101, −93.5, rated torque 8.2 N·m (joint 1)"
        )
        at = shown(at.switch_page("pages/1_Records.py").run())
        at = shown(at.switch_page(PAGE).run())
        assert assumed(at) == ""
        widget(at, "text_input", "Gear ratios").set_value("100, -93.5")
        at = shown(at.run())
        assert "direction of position" in assumed(at)
        assert head(at, "3 Drive data").endswith("to confirm")

    def test_assumptions_and_gear_ratios_go_into_the_study(self, page: AppTest, seen: list[Any]) -> None:
        at = drop(page, ("cell.csv", cell_log()))
        widget(at, "text_input", "Gear ratios").set_value("101, ?")
        widget(at, "text_input", "Rated torque").set_value("8.2, 2.1")
        at = send(confirm(at), "0.001, 0.002", "0.01, 0; 0, 0.01")
        assert seen[-1]["assumed"] == ("gear ratio 1 (joint 2)", "torque not held between samples")
        assert seen[-1]["gear_ratio"] is None
        widget(at, "text_input", "Gear ratios").set_value("101, -93.5")
        widget(at, "button_group", "Torque between").set_value("held until the next sample")
        at.text_input(key="import gear temperature").set_value("24 °C")
        at.text_input(key="import note").set_value("after two hours")
        at = send(confirm(shown(at.run())), "0.001, 0.002", "0.01, 0; 0, 0.01")
        assert (seen[-1]["assumed"], seen[-1]["gear_ratio"]) == ((), (101.0, -93.5))
        assert (seen[-1]["gear_temperature_C"], seen[-1]["note"]) == (24.0, "after two hours")

    def test_the_first_step_that_lacks_something_is_open(self, page: AppTest) -> None:
        assert opened(page) == ["1 Logs"]
        at = drop(page, ("one.csv", long_log()))
        assert opened(at) == ["3 Drive data"]
        assert head(at, "4 Runs") == "3 sine runs, 4 to 11 Hz"
        assert "3 runs, 3 used" in [m.value for m in at.markdown]
        assert head(at, "5 Inertias") == "missing"
        at.text_input(key="import M").set_value("0.001")
        at.text_input(key="import M2").set_value("0.003")
        at = shown(at.run())
        assert head(at, "5 Inertias") == "M and M2 ± 5 %"
        assert opened(at) == ["3 Drive data"]
        widget(at, "selectbox", "Torque of joint 1").set_value("joint position")
        assert head(shown(at.run()), "2 Columns") == "to correct"

    def test_unclear_columns_are_open_until_they_are_confirmed(self, page: AppTest) -> None:
        at = drop(page, ("scope.mat", mat_scope()))
        assert opened(at) == ["2 Columns"]
        assert "signal 1" in widget(at, "selectbox", "Position of joint 1").options
        assert figures(at) >= 1
        for end in ("position", "torque"):
            if widget(at, "selectbox", f"{end.capitalize()} of joint 1").value is None:
                widget(at, "selectbox", f"{end.capitalize()} of joint 1").set_value("signal 1")
        assert head(at, "2 Columns").endswith("to check")
        at = confirm(at, "columns")
        assert opened(at) == ["3 Drive data"]

    def test_a_jittered_log_becomes_a_study_of_one_record(
        self, page: AppTest, jittered_log: bytes
    ) -> None:
        at = send(drop(page, ("actuator.csv", jittered_log)), "0.001", "0.002")
        assert at.title[0].value == "actuator"
        facts = " ".join(m.value for m in at.markdown)
        assert "measured" in facts
        assert "1 record" in facts
        at = shown(at.switch_page("pages/1_Records.py").run())
        assert figures(at) == 1
        at = shown(at.switch_page("pages/2_Phasors.py").run())
        assert figures(at) == 2

    def test_a_long_log_gives_a_record_per_run(self, page: AppTest) -> None:
        at = drop(page, ("one.csv", long_log(ratio=50.0)))
        assert sides(at) == [["1"], []]
        widget(at, "text_input", "Gear ratios").set_value("50")
        at = send(shown(at.run()), "0.001", "0.003")
        assert "3 records" in " ".join(m.value for m in at.markdown)

    def test_two_logs_make_one_study(self, page: AppTest) -> None:
        at = drop(page, ("one.csv", long_log()), ("two.csv", long_log(ratio=1.5)))
        at = send(at, "0.001", "0.003")
        assert "6 records" in " ".join(m.value for m in at.markdown)

    def test_the_report_is_one_click_from_the_log(self, page: AppTest) -> None:
        at = send(drop(page, ("one.csv", long_log())), "0.001", "0.003", "Open its report")
        assert at.title[0].value == "Report and export"
        assert at.session_state["chosen"]
        assert at.session_state["report_at_once"] == at.session_state["chosen"]

    def test_a_repeated_import_opens_the_existing_study(self, page: AppTest) -> None:
        at = send(drop(page, ("one.csv", long_log())), "0.001", "0.003")
        first = at.session_state["chosen"]
        for _ in range(2):
            at = shown(at.switch_page(PAGE).run())
            widget(at, "button", "Open as study").click()
            at = shown(at.run())
            assert at.title[0].value == "one"
            assert at.session_state["chosen"] == first
            assert not any("in this workspace" in info.value for info in at.info)

    @pytest.mark.parametrize(
        ("M", "M2", "said"),
        [
            ("", "", "Inertias are missing"),
            ("0.001", "soft", '"soft" is not a number'),
            ("0.001, 0.002", "0.01, 0; 0, 0.01", "step 2 has 1"),
        ],
    )
    def test_an_invalid_inertia_is_reported_and_the_entry_stays(
        self, page: AppTest, M: str, M2: str, said: str
    ) -> None:
        at = send(drop(page, ("one.csv", long_log())), M, M2)
        assert len(at.error) == 1
        assert said in at.error[0].value
        assert at.text_input(key="import M2").value == M2
        assert figures(at) == 2

    @pytest.mark.parametrize(
        ("label", "text", "good"),
        [("Gear ratios", "abc", "50"), ("Gear ratios", "50, 80", "50"), ("Torque constant", "0", "0.3")],
    )
    def test_a_wrong_number_of_the_drive_stops_opening_until_it_is_corrected(
        self, page: AppTest, seen: list[Any], label: str, text: str, good: str
    ) -> None:
        at = drop(page, ("one.csv", long_log()))
        widget(at, "selectbox", "Unit of torque 1").set_value("A")
        at.text_input(key="import M").set_value("0.001")
        at.text_input(key="import M2").set_value("0.003")
        widget(shown(at.run()), "text_input", label).set_value(text)
        at = shown(at.run())
        assert stops_opening(at).startswith(f"Step 3, {label}")
        assert head(at, "3 Drive data") == "to correct"
        assert widget(at, "text_input", label).value == text
        assert at.text_input(key="import M").value == "0.001"
        widget(at, "text_input", label).set_value(good)
        at = send(shown(at.run()), "0.001", "0.003")
        assert "enough seen" in at.error[0].value
        assert len(seen) == 1

    def test_a_wrong_number_stops_opening_also_while_another_log_is_shown(self, page: AppTest) -> None:
        at = drop(page, ("one.csv", long_log()), ("cell.csv", cell_log()))
        widget(at, "text_input", "Gear ratios").set_value("abc")
        at = shown(at.run())
        look = at.selectbox(key="import look")
        at = shown(look.set_value(look.options[1]).run())
        assert stops_opening(at).startswith("one.csv: Step 3, Gear ratios")

    def test_a_wrong_run_stops_opening(self, page: AppTest) -> None:
        drop(page, ("one.csv", long_log()))
        at = shown(page.switch_page("pages/1_Records.py").run())
        (rows,) = at.session_state["import_segments_last"].values()
        rows[0] = replace(rows[0], found=None, frequency_hz=-1.0)
        at = shown(at.switch_page(PAGE).run())
        assert stops_opening(at).startswith("Step 4, Runs: 0.5")
        assert "a frequency of -1 Hz" in stops_opening(at)

    def test_a_log_that_lacks_a_column_stops_opening(self, page: AppTest) -> None:
        other = comma_log().replace(b"t,position,effort", b"t,velocity,abc")
        at = drop(page, ("one.csv", long_log()), ("run.csv", other))
        assert "run.csv" in stops_opening(at)

    def test_a_number_of_joints_beyond_the_limit_is_to_correct(self, page: AppTest) -> None:
        at = drop(page, ("one.csv", long_log()))
        widget(at, "number_input", "Joints").set_value(99)
        at = shown(at.run())
        assert at.error[0].value.startswith("Joints: 99 is not between 1 and 20")
        assert head(at, "2 Columns") == "to correct"
        assert not [button for button in at.button if button.label == "Open as study"]

    @pytest.mark.parametrize("data", [b"", b"\x00\x01\x02", b"hello", b"a,b\nx,y\n", b"PAR1"])
    def test_a_file_that_is_no_log_is_reported_and_the_others_open(
        self, page: AppTest, data: bytes
    ) -> None:
        at = drop(page, ("bad.csv", data), ("good.csv", comma_log()))
        assert len(at.error) == 1
        assert "bad.csv" in at.error[0].value
        assert figures(at) == 2


class TestCorrectedRuns:
    @pytest.fixture
    def log(self) -> MappedLog:
        time, theta, tau = runs()
        return MappedLog(time, theta[:, None], tau[:, None], name="one")

    @pytest.fixture
    def rows(self, log: MappedLog) -> list[Row]:
        found = find_segments(log)
        assert len(found) == 3
        return [Row("k", s.start_s, s.stop_s, s.frequency_hz, found=s) for s in found]

    def kept(self, rows: list[Row], log: MappedLog) -> list[Segment]:
        kept, _, problems = chosen_segments(rows, {"k": log}, {"k": "{}"})
        assert not problems
        return kept["k"]

    def test_unchanged_rows_are_the_found_segments(self, rows: list[Row], log: MappedLog) -> None:
        assert self.kept(apply_edits(rows, {}, {"one": "k"}), log) == [row.found for row in rows]

    def test_rows_are_dropped_deleted_and_corrected(self, rows: list[Row], log: MappedLog) -> None:
        edits = {
            "edited_rows": {0: {"Use": False}, 2: {"Start (s)": 7.0, "Frequency (Hz)": None}},
            "deleted_rows": [1],
        }
        (segment,) = self.kept(apply_edits(rows, edits, {"one": "k"}), log)
        assert segment.start_s == pytest.approx(7.0, abs=1e-3)
        assert segment.frequency_hz == pytest.approx(11.0, rel=1e-4)

    def test_a_corrected_row_has_all_its_shares(self, rows: list[Row], log: MappedLog) -> None:
        edits = {"edited_rows": {1: {"Start (s)": 3.7, "Frequency (Hz)": 6.5}}}
        segment = self.kept(apply_edits(rows, edits, {"one": "k"}), log)[1]
        assert segment.share == pytest.approx(1, abs=1e-3)
        assert segment.torque_share == pytest.approx(1, abs=1e-3)

    def test_an_added_row_is_measured_and_sorted_by_time(self, rows: list[Row], log: MappedLog) -> None:
        edits = {"added_rows": [{"Start (s)": 0.6, "Stop (s)": 2.4}], "deleted_rows": [0]}
        kept = self.kept(apply_edits(rows, edits, {"one": "k"}), log)
        assert [s.frequency_hz for s in kept] == pytest.approx(FREQUENCIES_HZ, rel=1e-4)

    def test_an_incomplete_row_is_ignored_and_an_invalid_one_is_reported(
        self, rows: list[Row], log: MappedLog
    ) -> None:
        edits = {"added_rows": [{"Start (s)": 0.6}, {"Start (s)": 50.0, "Stop (s)": 60.0}]}
        _, _, problems = chosen_segments(apply_edits(rows, edits, {"one": "k"}), {"k": log}, {"k": "{}"})
        assert len(problems) == 1
        assert "holds 0 samples" in problems[0]

    def test_the_picture_has_a_span_for_each_run(self, rows: list[Row], log: MappedLog) -> None:
        kept = [row.found for row in rows if row.found]
        spans = log_spans(log, kept[:2], kept[2:]).layout.shapes
        assert [span.x0 for span in spans] == [s.start_s for s in kept]
        assert spans[0].fillcolor == spans[1].fillcolor != spans[2].fillcolor

    def test_a_motion_has_no_row_of_frequencies(self, log: MappedLog) -> None:
        layout = log_spans(log, [Segment(0.0, 2.0, np.nan, band_hz=(2.0, 9.0))]).layout
        assert layout.yaxis.title.text == "Position 1 (rad)"
        assert len(layout.shapes) == 1


def test_the_picture_shows_a_torque_of_unknown_scale_as_logged() -> None:
    """Percent of an unstated rated torque cannot be converted to newton metres."""
    joint = JointMapping(Channel("q", "rad"), Channel("load", "%", 1.0, "joint", -1), gear_ratio=50)
    mapping = Mapping(TimeColumn("t", "s"), (joint,))
    percent = np.linspace(-3, 4, 99)
    log = MappedLog(np.arange(99.0), np.ones((99, 1)), -percent[:, None] / 100 / 50)
    assumed = replace(mapping, assumed=("scale of torque of joint 1",))
    for of, title, largest in ((mapping, "Torque 1 (N·m)", 4e-2 / 50), (assumed, "Torque 1 (%)", 4.0)):
        figure = log_spans(log, (), mapping=of)
        assert figure.layout.yaxis2.title.text == title
        assert np.abs(np.array(figure.data[-1].y, float)).max() == pytest.approx(largest)
