"""Simultaneous logs of one joint each are joined; successive runs of one joint are not."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from app_pages import opened_app, shown
from streamlit.testing.v1 import AppTest
from typer.testing import CliRunner

from jointid import JointIdError, Study, load_study
from jointid.analysis import analyse
from jointid.arrays import Floats
from jointid.cli import app
from jointid.importing import LogColumn, LogTable, guess_mapping
from jointid.importing.map.simultaneous_logs import join_logs, joined_table, simultaneous_groups
from jointid.ui.shared import workspace

ROOT = Path(__file__).parents[1]
K = (43.0, 7.5)


@pytest.fixture(scope="module")
def paper() -> Study:
    """A sixth of its runs."""
    whole = load_study(ROOT / "sample_data" / "paper.zip")
    return replace(whole, records=tuple(r for k, r in enumerate(whole.records) if k % 12 < 2))


@pytest.fixture(scope="module")
def axes(paper: Study) -> tuple[bytes, bytes]:
    """The paper's robot, all runs one after another, each axis in a file of its own."""
    clock, start = [], 0.0
    for record in paper.records:
        clock.append(record.time_s + start)
        start = clock[-1][-1] + 0.0005
    time = np.concatenate(clock)
    theta = np.vstack([record.theta_rad for record in paper.records])
    tau = np.vstack([record.tau_Nm for record in paper.records])
    return tuple(_csv(time, theta[:, j], tau[:, j]) for j in (0, 1))  # type: ignore[return-value]


def _csv(time: Floats, position: Floats, torque: Floats) -> bytes:
    lines = [f"{t:.4f},{q:.9g},{u:.9g}" for t, q, u in zip(time, position, torque, strict=True)]
    return "\n".join(["time_s,position_rad,torque_Nm", *lines, ""]).encode()


def log(
    name: str,
    *,
    hertz: float = 5.0,
    start: float = 0.0,
    rows: int = 2000,
    gain: float = 1.0,
    seed: int = 0,
) -> LogTable:
    """A sine over some seconds at 1 kHz."""
    time = start + np.arange(rows) / 1000
    noise = 1e-3 * np.random.default_rng(seed).standard_normal((2, rows))
    wave = np.sin(2 * np.pi * hertz * time)
    values = {"time": time, "position": gain * wave + noise[0], "torque": 2 * gain * wave + noise[1]}
    units = {"time": "s", "position": "rad", "torque": "N·m"}
    return LogTable(name, tuple(LogColumn(key, value, units[key]) for key, value in values.items()))


def pair(one: str, two: str, **of_second: float) -> list[LogTable]:
    return [log(one, seed=1), log(two, seed=2, gain=0.3, **of_second)]  # type: ignore[arg-type]


# --- what is recognised


@pytest.mark.parametrize(
    ("one", "two"),
    [
        ("axis1.csv", "axis2.csv"),
        ("J1.csv", "J2.csv"),
        ("shoulder.csv", "elbow.csv"),
        ("a.csv", "b.csv"),
    ],
)
def test_logs_with_equal_times_and_sines_are_joined_as_joints(one: str, two: str) -> None:
    tables = pair(one, two)
    assert simultaneous_groups(tables) == ((0, 1),)
    joined = joined_table(tables)
    mapping = guess_mapping(joined).mapping
    assert mapping.n == 2
    for joint, table in zip(mapping.joints, tables, strict=True):
        for channel, role in ((joint.position, "position"), (joint.torque, "torque")):
            np.testing.assert_array_equal(
                joined.column(channel.column).values, table.column(role).values
            )
    assert one.removesuffix(".csv").lower() in mapping.joints[0].position.column.lower()


@pytest.mark.parametrize(
    ("names", "second"),
    [
        (("run1.csv", "run2.csv"), {}),
        (("axis1_run1.csv", "axis1_run2.csv"), {}),
        (("5hz.csv", "7hz.csv"), {"hertz": 7.0}),
        (("a.csv", "b.csv"), {"hertz": 7.0}),
        (("axis1.csv", "axis2.csv"), {"rows": 1990}),
        (("axis1.csv", "axis2.csv"), {"start": 0.0005}),
    ],
)
def test_other_logs_stay_runs(names: tuple[str, str], second: dict[str, float]) -> None:
    one, two = names
    assert simultaneous_groups(pair(one, two, **second)) == ()


def test_one_program_run_twice_is_one_joint() -> None:
    assert simultaneous_groups([log("a.csv", seed=1), log("b.csv", seed=2)]) == ()


def test_raw_and_filtered_tables_of_a_file_are_one_joint() -> None:
    raw, smooth = (
        log("bag.mcap: /raw", start=1.7e9, seed=1),
        log("bag.mcap: /smooth", start=1.7e9, seed=2),
    )
    other = replace(smooth.column("torque"), values=0.5 * smooth.column("torque").values)
    smooth = replace(smooth, columns=(*smooth.columns[:2], other))
    assert simultaneous_groups([raw, smooth]) == ()


def test_a_copy_is_no_second_joint() -> None:
    one = log("axis1.csv")
    assert simultaneous_groups([one, replace(one, name="axis2.csv")]) == ()


def test_an_absolute_clock_needs_only_overlap() -> None:
    one, two = log("p.csv", start=1.7e9, seed=1), log("q.csv", start=1.7e9 + 0.2, gain=0.3, seed=2)
    assert simultaneous_groups([one, two]) == ((0, 1),)
    joined = joined_table([one, two])
    assert joined.rows == 1800
    assert joined.column("time").values[0] == pytest.approx(1.7e9 + 0.2, abs=1e-6)
    np.testing.assert_array_equal(joined.column("p torque").values, one.column("torque").values[200:])
    np.testing.assert_array_equal(joined.column("q torque").values, two.column("torque").values[:1800])


def test_each_run_of_two_axes_is_joined_for_itself() -> None:
    names = [(run, axis) for run in (1, 2) for axis in (2, 1)]
    tables = [
        log(f"run{run}_axis{axis}.csv", hertz=4.0 + run, gain=axis, seed=10 * run + axis)
        for run, axis in names
    ]
    tables_joined, notes = join_logs([[table] for table in tables])
    assert not notes
    assert len(tables_joined) == 2
    assert tables_joined[0].signature == tables_joined[1].signature
    first = guess_mapping(tables_joined[0]).mapping.joints[0].torque.column
    np.testing.assert_array_equal(
        tables_joined[1].column(first).values, tables[3].column("torque").values
    )


def test_a_mapping_of_single_logs_or_the_option_keeps_them_separate() -> None:
    tables = pair("axis1.csv", "axis2.csv")
    single = guess_mapping(tables[0]).mapping
    kept, notes = join_logs([[table] for table in tables], single)
    assert [table.name for table in kept] == ["axis1.csv", "axis2.csv"]
    assert "runs of one joint" in notes[0]
    kept, notes = join_logs([[table] for table in tables], separate=True)
    assert (len(kept), notes) == (2, ())


def test_tables_of_one_file_are_joined_too() -> None:
    sheets = pair("book.xlsx: Axis1", "book.xlsx: Axis2")
    (joined,), _ = join_logs([sheets])
    assert joined.name == "book.xlsx: Axis1+Axis2"
    (only,), _ = join_logs([sheets], separate=True)
    assert only is sheets[0]


# --- the paper's robot, known answer


def check(study: Study, paper: Study) -> None:
    assert study.inertia.n == 2
    fit = analyse(study).fit
    assert np.all(np.abs(fit.K - K) < 4 * fit.standard_error[:2])
    # The runs are trimmed differently; free inertias would amplify that noise.
    exact = [analyse(replace(each, inertia_std=None)).fit for each in (study, paper)]
    np.testing.assert_allclose(exact[0].K, exact[1].K, rtol=2e-4)


@pytest.fixture
def here(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, axes: tuple[bytes, bytes], paper: Study
) -> Path:
    monkeypatch.chdir(tmp_path)
    for number, data in enumerate(axes, start=1):
        (tmp_path / f"axis{number}.csv").write_bytes(data)
    inertia = f"M = {paper.inertia.M.tolist()}\nM2 = {paper.inertia.M2.tolist()}\n"
    (tmp_path / "robot.toml").write_text(inertia, "utf-8")
    return tmp_path


def ok(*arguments: str) -> str:
    result = CliRunner().invoke(app, list(arguments))
    assert result.exit_code == 0, result.stderr
    return result.output


def test_convert_finds_both_joints_in_two_files(here: Path, paper: Study) -> None:
    assert "joined as joints logged simultaneously" in ok(
        "convert", "axis1.csv", "axis2.csv", "--guess", "m.json"
    )
    mapping = json.loads((here / "m.json").read_text("utf-8"))
    mapping["torque_hold"] = True
    (here / "m.json").write_text(json.dumps(mapping), "utf-8")
    given = ("--mapping", "m.json", "--inertia", "robot.toml", "-o", "new.zip")
    said = ok("convert", "axis1.csv", "axis2.csv", *given)
    assert "axis1+axis2.csv: axis1.csv, axis2.csv have the same times" in said
    check(load_study(here / "new.zip"), paper)


def test_convert_keeps_them_as_runs_when_asked(here: Path) -> None:
    ok("convert", "axis1.csv", "axis2.csv", "--separate", "--guess", "m.json")
    assert len(json.loads((here / "m.json").read_text("utf-8"))["joints"]) == 1


def test_the_page_joins_them_and_can_leave_it(
    here: Path, axes: tuple[bytes, bytes], paper: Study, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(workspace, "SAMPLES", here)
    monkeypatch.setenv("JOINTID_DATA_DIR", str(here / "data"))
    made: list[Study] = []

    def noted(study: Study, name: str) -> None:
        made.append(study)
        raise JointIdError("enough seen")

    monkeypatch.setattr("jointid.ui.importing.panels.keep", noted)
    at = opened_app()
    at = at.switch_page("pages/9_Import_a_log.py").run()
    files = [(f"axis{k}.csv", data, "text/csv") for k, data in enumerate(axes, start=1)]
    at.file_uploader(key="log_file").set_value(files)
    at = shown(at.run())
    assert any("look like joints logged simultaneously" in info.value for info in at.info)
    assert joints(at) == 2
    join = next(box for box in at.checkbox if box.label.startswith("Join axis1.csv, axis2.csv"))
    join.uncheck()
    at = shown(at.run())
    assert joints(at) == 1
    next(box for box in at.checkbox if box.label.startswith("Join")).check()
    at = shown(at.run())
    next(b for b in at.button_group if b.label.startswith("Torque between")).set_value(
        "held until the next sample"
    )
    at = shown(at.run())
    at.text_input(key="import M").set_value(" ".join(map(str, paper.inertia.M)))
    M2 = "; ".join(" ".join(map(str, row)) for row in paper.inertia.M2)
    at.text_input(key="import M2").set_value(M2)
    next(button for button in at.button if button.label.startswith("Open as study")).click()
    at = shown(at.run())
    check(made[-1], paper)


def joints(at: AppTest) -> int:
    return int(next(w for w in at.number_input if w.label == "Joints").value or 0)
