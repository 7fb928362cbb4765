"""All file formats: equal numbers with equal names and units."""

from __future__ import annotations

import datetime
import io
import math
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from log_makers import (
    ANGLE,
    ROWS,
    TIME_S,
    TORQUE,
    cell_log,
    comma_log,
    excel,
    hdf5,
    mat_arrays,
    mat_scope,
    mat_v73,
    parquet,
    ros_bag,
)
from random_cases import examples

from jointid import JointIdError, importing
from jointid.arrays import Floats
from jointid.background.child_process import Limits
from jointid.errors import import_optional
from jointid.importing import LogColumn, LogTable, read_log, read_logs
from jointid.importing.columns import log_table
from jointid.importing.columns.units import split_unit
from jointid.importing.read.formats import excel as workbooks
from jointid.importing.read.reader_process import ReaderProcess


def only(tables: tuple[LogTable, ...]) -> LogTable:
    assert len(tables) == 1
    return tables[0]


def columns(table: LogTable) -> dict[str, tuple[str, Floats]]:
    return {column.name: (column.unit, column.values) for column in table.columns}


def text(table: str, name: str = "log.csv") -> LogTable:
    return only(read_log(table.encode(), name))


# --- text


@pytest.mark.parametrize(
    "encoding", ["latin-1", "utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"]
)
def test_german_log_in_every_encoding(encoding: str) -> None:
    table = only(read_log(cell_log(encoding), "cell.csv"))
    assert [(c.name, c.unit) for c in table.columns] == [
        ("Zeit", "ms"),
        ("Achse 1 Ist", "deg"),
        ("Achse 2 Ist", "deg"),
        ("Moment 1", "%"),
        ("Moment 2", "%"),
    ]
    np.testing.assert_allclose(table.column("Achse 1 Ist").values, np.degrees(ANGLE), rtol=1e-6)
    np.testing.assert_array_equal(table.column("Zeit").values, 2 * np.arange(ROWS))
    assert table.place(0) == "cell.csv, line 5"


@pytest.mark.parametrize(
    ("separator", "decimal"),
    [(s, d) for s in (",", ";", "\t", "|", "  ", " \t ") for d in ".," if s != d],
)
@pytest.mark.parametrize("comment", ["", "# made by a test, at 9:30\n\n", "% Versuch 3\n% Probe;7\n"])
def test_separators_and_decimal_marks(separator: str, decimal: str, comment: str) -> None:
    rows = [
        separator.join(f"{value:.6f}".replace(".", decimal) for value in row)
        for row in np.column_stack([TIME_S, ANGLE, TORQUE])
    ]
    table = text(comment + "\n".join([separator.join(["time", "angle", "torque"]), *rows]))
    assert table.names == ("time", "angle", "torque")
    np.testing.assert_allclose(table.columns[2].values, TORQUE, atol=1e-6)


def test_quoted_decimal_commas() -> None:
    rows = "\n".join(f'"{k}","{k},5","-0,{k}"' for k in range(10))
    table = text(f'"t","q","tau"\n{rows}')
    np.testing.assert_allclose(table.column("q").values, np.arange(10) + 0.5)


def test_row_of_units_below_the_header() -> None:
    rows = "\n".join(f"{k};{k},25;3" for k in range(20))
    table = text(f"Zeit;Winkel;Moment\nms;°;Nm\n{rows}")
    assert [(c.name, c.unit) for c in table.columns] == [
        ("Zeit", "ms"),
        ("Winkel", "deg"),
        ("Moment", "N·m"),
    ]


def test_header_in_a_comment_line() -> None:
    rows = "\n".join(f"{k} {k / 10} {k / 7}" for k in range(20))
    table = text(f"# run 3\n# time [s] q1 [deg] tau1 [Nm]\n{rows}")
    assert [(c.name, c.unit) for c in table.columns] == [("time", "s"), ("q1", "deg"), ("tau1", "N·m")]


def test_without_a_header_the_columns_are_numbered() -> None:
    table = text("\n".join(f"{k},{k * 0.5},{k * k}" for k in range(20)))
    assert table.names == ("column 1", "column 2", "column 3")
    assert any("no line with names" in note for note in table.notes)


def test_text_columns_are_left_out_with_a_note() -> None:
    table = text("t,mode,q\n" + "\n".join(f"{k},auto,{k}" for k in range(9)))
    assert table.names == ("t", "q")
    assert any("mode" in note for note in table.notes)


def test_cells_that_are_no_numbers_are_missing_with_a_note() -> None:
    rows = [f"{k},{k},{k}" for k in range(20)]
    rows[7], rows[9] = "7,ERR,7", "9,,9"
    table = text("t,q,tau\n" + "\n".join(rows))
    assert np.flatnonzero(np.isnan(table.column("q").values)).tolist() == [7, 9]
    assert any("ERR" in note and "line 9" in note for note in table.notes)


def test_incomplete_last_line_is_left_out_with_a_note() -> None:
    table = text("t,q,tau\n" + "\n".join(f"{k},{k},{k}" for k in range(20)) + "\n20,2")
    assert table.rows == 20
    assert any("cut short" in note for note in table.notes)


def test_line_with_other_cells_in_the_middle_is_refused_with_its_number() -> None:
    rows = [f"{k},{k},{k}" for k in range(20)]
    rows[4] = "4,4"
    with pytest.raises(JointIdError, match=r"log\.csv, line 6: 2 cell"):
        text("t,q,tau\n" + "\n".join(rows))


def test_lines_above_the_header_are_named() -> None:
    table = text("Trace;Cell 7\n-----\nt;q;tau\n" + "".join(f"{k};{k}.5;{k}.25\n" for k in range(20)))
    assert table.names == ("t", "q", "tau")
    assert table.notes == ("Lines above the table, not used: 'Trace;Cell 7'.",)


@pytest.mark.parametrize(
    ("encoding", "names"), [("cp932", "時間 位置 トルク"), ("cp1251", "время угол момент")]
)
def test_other_scripts_have_encodings_of_their_own(encoding: str, names: str) -> None:
    rows = "".join(f"{k},{k}.5,{k}.25\n" for k in range(20))
    (table,) = read_log(f"{names.replace(' ', ',')}\n{rows}".encode(encoding), "log.csv")
    assert table.names == tuple(names.split())


@pytest.mark.parametrize("names", [("stamp.sec", "stamp.nanosec"), ("timeSec", "timeNanoSec")])
def test_seconds_and_nanoseconds_are_one_clock(names: tuple[str, str]) -> None:
    lines = [f"{1_700_000_000 + k // 500},{k % 500 * 2_000_000},{k}.5,{k}.25" for k in range(900)]
    (table,) = read_log("\n".join([f"{','.join(names)},q,tau", *lines]).encode(), "log.csv")
    assert table.names == ("time", "q", "tau")
    np.testing.assert_allclose(table.column("time").values, 0.002 * np.arange(900), atol=1e-9)


def test_dates_become_seconds() -> None:
    rows = "\n".join(f"2024-05-07 10:11:{k:02d}.{k}00;{k},5;{k}" for k in range(10))
    table = text(f"Zeitstempel;q;tau\n{rows}")
    assert table.column("Zeitstempel").unit == "s"
    np.testing.assert_allclose(table.column("Zeitstempel").values, 1.1 * np.arange(10), atol=1e-6)


def test_leading_plus_and_fortran_exponents() -> None:
    table = text("t,q,tau\n" + "\n".join(f"+{k},1.5d-{k % 5},2E+1" for k in range(9)))
    assert table.column("q").values[3] == 1.5e-3
    assert table.column("tau").values[0] == 20.0


def test_columns_of_equal_names_are_numbered() -> None:
    assert text("t,q,q\n" + "\n".join(f"{k},{k},{k}" for k in range(9))).names == ("t", "q", "q (2)")


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "is empty"),
        (b" \n\n ", "only blank lines"),
        (b"hello\nworld\n", "not a table of numbers"),
        (b"\x00\x01\x02" * 50, "neither text nor a file of a known kind"),
        (b"t,q\n", "not a table of numbers"),
        (b"5\n6\n7\n", "not a table of numbers"),
    ],
)
def test_a_file_without_a_table_is_refused(content: bytes, said: str) -> None:
    with pytest.raises(JointIdError, match=said):
        read_log(content, "x.csv")


@examples(30, derandomize=True)
@given(
    st.lists(
        st.lists(st.floats(-1e9, 1e9, allow_subnormal=False), min_size=3, max_size=3),
        min_size=3,
        max_size=20,
    ),
    st.sampled_from([(",", "."), (";", ","), (";", "."), ("\t", ","), (" ", ".")]),
)
def test_numbers_are_read_exactly(rows: list[list[float]], marks: tuple[str, str]) -> None:
    separator, decimal = marks
    lines = [separator.join(repr(value).replace(".", decimal) for value in row) for row in rows]
    table = text("\n".join([separator.join("abc"), *lines]))
    np.testing.assert_array_equal(np.column_stack([c.values for c in table.columns]), rows)


@pytest.mark.parametrize(
    ("name", "bare", "unit"),
    [
        ("Zeit [ms]", "Zeit", "ms"),
        ("torque (N m)", "torque", "N·m"),
        ("angle_deg", "angle", "deg"),
        ("t in µs", "t", "µs"),
        ("tau_m1_Nm", "tau_m1", "N·m"),
        ("speed [U/min]", "speed", "rpm"),
        ("vel_rad_s", "vel", "rad/s"),
        ("Lage {Inkremente}", "Lage", "counts"),
        ("position", "position", ""),
        ("a", "a", ""),
        ("Strom [A]", "Strom", "A"),
        ("time_s", "time", "s"),
    ],
)
def test_units_in_names(name: str, bare: str, unit: str) -> None:
    assert split_unit(name) == (bare, unit)


# --- everything else


def test_matlab_scope() -> None:
    table = only(read_log(mat_scope(), "scope.mat"))
    assert table.name == "scope.mat: ScopeData"
    assert table.names == ("time", "signal 1", "signal 2", "signal 3")
    assert table.column("time").unit == "s"
    np.testing.assert_array_equal(table.column("signal 2").values, ANGLE)


def test_matlab_arrays() -> None:
    table = only(read_log(mat_arrays(), "run.mat"))
    named = columns(table)
    assert {name: unit for name, (unit, _) in named.items()} == {
        "t": "s",
        "q 1": "rad",
        "q 2": "rad",
        "tau 1": "N·m",
        "tau 2": "N·m",
    }
    np.testing.assert_array_equal(named["tau 2"][1], 2 * TORQUE)


def test_matlab_scope_of_frames() -> None:
    """Simulink logs vectors as (m, 1, N): samples last."""
    frames = np.vstack([TORQUE, ANGLE])[:, None, :]
    table = only(read_log(mat_scope(frames), "scope.mat"))
    np.testing.assert_array_equal(table.column("signal 2").values, ANGLE)


def test_matlab_of_version_7_3() -> None:
    table = only(read_log(mat_v73(), "scope.mat"))
    assert table.names == ("time", "signal 1", "signal 2")
    np.testing.assert_array_equal(table.column("time").values, TIME_S)
    np.testing.assert_array_equal(table.column("signal 2").values, ANGLE)


def test_hdf5_group_with_units() -> None:
    table = only(read_log(hdf5(), "log.h5"))
    assert table.name == "log.h5: run1"
    assert columns(table)["joint1_pos"][0] == "deg"
    np.testing.assert_array_equal(columns(table)["time"][1], 1e3 * TIME_S)


def test_hdf5_compound_table() -> None:
    table = only(read_log(hdf5(compound=True), "log.h5"))
    assert table.names == ("time", "pos", "torque")
    np.testing.assert_allclose(table.column("pos").values, ANGLE, rtol=1e-6)


def test_parquet() -> None:
    table = only(read_log(parquet(), "log.parquet"))
    assert [(c.name, c.unit) for c in table.columns] == [
        ("stamp", "s"),
        ("pos", "rad"),
        ("torque", "N·m"),
    ]
    np.testing.assert_allclose(table.column("stamp").values, TIME_S, atol=1e-9)
    assert any("state" in note for note in table.notes)


def test_excel() -> None:
    table = only(read_log(excel(), "log.xlsx"))
    assert table.name == "log.xlsx: Messung"
    assert [(c.name, c.unit) for c in table.columns] == [
        ("Zeit", "ms"),
        ("Position", "deg"),
        ("Drehmoment", "N·m"),
    ]
    np.testing.assert_allclose(table.column("Position").values, np.degrees(ANGLE), rtol=1e-14)
    assert table.place(0) == "log.xlsx: Messung, row 5"


@pytest.mark.parametrize("kind", ["sqlite3", "mcap"])
@pytest.mark.parametrize("whole", [True, False], ids=["folder", "file"])
def test_ros_bag(tmp_path: Path, kind: str, whole: bool) -> None:
    bag = ros_bag(tmp_path, kind)
    (file,) = [p for p in bag.iterdir() if p.suffix in (".db3", ".mcap")]
    table = only(read_log(bag) if whole else read_log(file.read_bytes(), "drop.bin"))
    assert "/joint_states" in table.name
    named = columns(table)
    assert named["elbow effort"][0] == "N·m"
    np.testing.assert_allclose(named["time"][1], TIME_S, atol=1e-12)
    np.testing.assert_array_equal(named["shoulder position"][1], ANGLE)
    np.testing.assert_array_equal(named["elbow effort"][1], 2 * TORQUE)


def test_ros_bag_without_stamps_uses_the_time_of_recording(tmp_path: Path) -> None:
    table = only(read_log(ros_bag(tmp_path, "mcap", stamped=False)))
    np.testing.assert_allclose(table.column("time").values, TIME_S, atol=1e-9)
    assert any("time of recording" in note for note in table.notes)


def test_the_content_and_not_the_name_determines_the_format() -> None:
    for content in (mat_scope(), hdf5(), parquet(), excel()):
        assert read_log(content, "log.csv")[0].rows == ROWS


@pytest.mark.own_reader
def test_many_files_a_bad_one_among_them(tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    path.write_bytes(mat_scope())
    sources = [
        (comma_log(), "a.csv"),
        (b"\x89HDF\r\n\x1a\nrubbish", "b.h5"),
        (path, ""),
        (parquet(), "d"),
    ]
    good, bad, scope, last = read_logs(sources)
    assert isinstance(bad, JointIdError)
    assert "b.h5 cannot be read as HDF5" in str(bad)
    assert not isinstance(good, JointIdError)
    assert not isinstance(scope, JointIdError)
    assert not isinstance(last, JointIdError)
    assert scope[0].name == "run.mat: ScopeData"


def test_missing_files_and_wrong_sources(tmp_path: Path) -> None:
    with pytest.raises(JointIdError, match=r"no such file\. Check the path"):
        read_log(tmp_path / "none.csv")
    with pytest.raises(JointIdError, match=r"without metadata\.yaml"):
        read_log(tmp_path)
    with pytest.raises(JointIdError, match="comes from a path or bytes, not from int"):
        read_log(7)  # type: ignore[arg-type]


def bomb(cell: bytes) -> bytes:
    """A workbook of a few kilobytes whose second sheet has a value in one cell far away."""
    row = cell.lstrip(b"ABCDEFGHIJKLMNOPQRSTUVWXYZ")
    far = b'<row r="%b"><c r="%b"><v>1</v></c></row></sheetData>' % (row, cell)
    book = zipfile.ZipFile(io.BytesIO(excel()))
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as changed:
        for name in book.namelist():
            data = book.read(name)
            if name.endswith("sheet2.xml"):
                data = data.replace(b"</sheetData>", far)
            changed.writestr(name, data)
    return buffer.getvalue()


def test_workbook_bomb_is_refused() -> None:
    """A sheet of 17 thousand million cells."""
    with pytest.raises(JointIdError, match=r"more than the limit|cannot be read|memory"):
        read_log(bomb(b"XFD1048576"), "bomb.xlsx")


def test_large_workbook_is_refused_before_it_is_unpacked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the numbers that its sheets stand for, and by the size of its parts."""
    pytest.importorskip("python_calamine")
    path = tmp_path / "bomb.xlsx"
    path.write_bytes(bomb(b"Z9000"))
    monkeypatch.setattr(log_table, "MAX_VALUES", 200_000)
    with pytest.raises(JointIdError, match=r"bomb\.xlsx holds 0\.2\d* million numbers, more than"):
        workbooks.read(path.name, str(path))
    monkeypatch.setattr(log_table, "MAX_VALUES", 1 << 20)
    assert workbooks.read(path.name, str(path))
    monkeypatch.setattr(workbooks, "_MAX_UNPACKED", 1 << 10)
    with pytest.raises(JointIdError, match=r"unpacks to .* MiB, more than the limit"):
        workbooks.read(path.name, str(path))


def test_reader_that_takes_too_long_is_ended(tmp_path: Path) -> None:
    path = tmp_path / "x.mat"
    path.write_bytes(mat_scope())
    reader = ReaderProcess(Limits(time_s=0.01))
    try:
        with pytest.raises(JointIdError, match=r"took more than 0\.01 s"):
            reader.read("matlab", "x.mat", path)
    finally:
        reader.close()


def test_missing_extra_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(JointIdError, match=r'pip install "jointid\[import\]"'):
        import_optional("h5py", "h5py", "HDF5 files")


def test_signature_depends_on_names_and_units() -> None:
    one, same = text("t [s],q\n1,2\n2,3\n3,4"), text("t [s],q\n5,6\n7,8\n9,9\n10,11")
    other = text("t [ms],q\n1,2\n2,3\n3,4")
    assert one.signature == same.signature != other.signature


# --- times of day and dates


def clock_log(stamp: str, step_s: float = 0.002, rows: int = 40, first: str = "") -> str:
    """A log at 500 Hz whose times are written by ``stamp`` with the parts of a date."""
    begin = datetime.datetime.fromisoformat(first or "2026-05-07T09:00:59.950")
    lines = ["Zeit;q;tau"]
    for k in range(rows):
        at = begin + datetime.timedelta(seconds=k * step_s)
        ms = f"{at.microsecond // 1000:03d}"
        lines.append(f"{at.strftime(stamp).replace('{ms}', ms)};{math.sin(k):.6f};{math.cos(k):.6f}")
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    "stamp",
    [
        "%d.%m.%Y %H:%M:%S.{ms}",
        "%d.%m.%Y %H:%M:%S,{ms}",
        "%d.%m.%y %H:%M:%S:{ms}",
        "%d/%m/%Y %H:%M:%S.{ms}",
        "%m/%d/%Y %I:%M:%S.{ms} %p",
        "%d-%b-%Y %H:%M:%S.{ms}",
        "%d. %B %Y %H:%M:%S.{ms}",
        "%Y/%m/%d %H:%M:%S.{ms}",
        "%Y-%m-%dT%H:%M:%S.{ms}Z",
        "%H:%M:%S,{ms}",
        "%Y%m%d%H%M%S.{ms}",
        "%Y%m%dT%H%M%S,{ms}Z",
    ],
)
def test_dates_of_controllers(stamp: str) -> None:
    """Only differences count, so day and month may stand in any order; over noon as well."""
    for first in ("2026-05-07T09:00:59.950", "2026-05-07T11:59:59.950"):
        table = text(clock_log(stamp, first=first))
        assert table.column("Zeit").unit == "s"
        np.testing.assert_allclose(table.column("Zeit").values, 0.002 * np.arange(40), atol=1e-6)


@pytest.mark.parametrize(
    ("stamp", "first"),
    [
        ("%d.%m.%Y %H:%M:%S.{ms}", "2026-05-07T23:59:59.950"),
        ("%m/%d/%Y %H:%M:%S.{ms}", "2026-05-07T23:59:59.950"),
        ("%d/%m/%Y %H:%M:%S.{ms}", "2026-05-31T23:59:59.950"),
        ("%d-%b-%Y %H:%M:%S.{ms}", "2026-02-28T23:59:59.950"),
        ("%Y.%m.%d %H:%M:%S.{ms}", "2026-12-31T23:59:59.950"),
    ],
)
def test_dates_over_midnight(stamp: str, first: str) -> None:
    table = text(clock_log(stamp, first=first))
    np.testing.assert_allclose(table.column("Zeit").values, 0.002 * np.arange(40), atol=1e-6)


def test_a_pause_of_days_counts_as_one_day() -> None:
    """The order of day and month need not be known: a pause is no part of a run."""
    first = clock_log("%d/%m/%Y %H:%M:%S.{ms}")
    second = clock_log("%d/%m/%Y %H:%M:%S.{ms}", first="2026-05-09T09:00:59.950")
    time = text(first + second.partition("\n")[2]).column("Zeit").values
    expected = 0.002 * np.arange(40)
    np.testing.assert_allclose(time, np.concatenate([expected, 86400 + expected]), atol=1e-6)


def test_a_sheet_of_dates_from_midnight() -> None:
    """Readers of workbooks give a date without a time of day for midnight."""
    import openpyxl

    book, buffer = openpyxl.Workbook(), io.BytesIO()
    book.active.append(["Zeit", "Lage", "Moment"])
    for k in range(40):
        time = datetime.datetime(2026, 5, 7) + datetime.timedelta(milliseconds=2 * k)
        book.active.append([time, math.sin(k), math.cos(k)])
    book.save(buffer)
    table = only(read_log(buffer.getvalue(), "log.xlsx"))
    np.testing.assert_allclose(table.column("Zeit").values, 0.002 * np.arange(40), atol=1e-6)


def test_cells_that_are_no_time_are_missing() -> None:
    log = clock_log("%d.%m.%Y %H:%M:%S.{ms}").splitlines()
    log[30] = "broken;0;0"
    table = text("\n".join(log))
    assert np.isnan(table.column("Zeit").values[29])
    assert any('"broken" in line 31' in note for note in table.notes)


def test_a_time_that_is_not_read_is_named() -> None:
    table = text("Zeit;q;tau\n" + "".join(f"Mo {k}h;{k}.5;{k}.25\n" for k in range(20)))
    assert any('name of "Zeit" indicates time, but it holds' in note for note in table.notes)


def test_time_of_a_group_above_belongs_to_the_groups_below(tmp_path: Path) -> None:
    """HDF5: /time at the root, the channels in a group; a time of the group's own comes first."""
    h5py = pytest.importorskip("h5py")
    time = np.arange(40) * 0.002
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file["time"] = time
        file["motor/position"] = np.sin(np.outer(time, [3, 4]))
        file["motor/torque"] = np.cos(np.outer(time, [3, 4]))
        file["arm/log/t"] = 2 * time
        file["arm/log/q"] = np.sin(time)
        file["short/q"] = np.arange(20.0)
        file["short/tau"] = np.arange(20.0)
    tables = {table.name: table for table in read_log(tmp_path / "log.h5")}
    assert tables["log.h5: motor"].names == ("time", "position 1", "position 2", "torque 1", "torque 2")
    np.testing.assert_array_equal(tables["log.h5: motor"].column("time").values, time)
    assert sorted(tables["log.h5: arm/log"].names) == ["q", "t"]
    assert tables["log.h5: short"].names == ("q", "tau")


def test_groups_of_joints_with_one_clock_are_one_table(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    time = np.arange(40) * 0.002
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file["log/time"] = time
        for number in (1, 2):
            file[f"log/joint_{number}/position"] = np.sin(number * time)
            file[f"log/joint_{number}/torque"] = np.cos(number * time)
            file[f"log/run{number}/q"] = file[f"log/run{number}/tau"] = time
    tables = {table.name: table for table in read_log(tmp_path / "log.h5")}
    joints = importing.guess_mapping(tables["log.h5: log"]).mapping.joints
    pairs = [(joint.position.column, joint.torque.column) for joint in joints]
    assert pairs == [(f"joint_{k} position", f"joint_{k} torque") for k in (1, 2)]
    assert {"log.h5: log/run1", "log.h5: log/run2"} < tables.keys()


def test_a_table_has_a_row() -> None:
    columns = [LogColumn(name, log_table.numbers([1.0])) for name in "ab"]
    assert LogTable("log", tuple(columns)).rows == 1
    with pytest.raises(JointIdError, match="columns but no rows"):
        LogTable("log", tuple(LogColumn(name, log_table.numbers([])) for name in "ab"))


@pytest.mark.parametrize("head", ["0,1,2", "1,2,3"])
def test_a_line_of_column_numbers_is_no_row(head: str) -> None:
    rows = "\n".join(f"{0.002 * k:.3f},{np.sin(k):.6f},{np.cos(k):.6f}" for k in range(50))
    (table,) = read_log(f"{head}\n{rows}\n".encode(), "log.csv")
    assert table.rows == 50
    assert table.names == ("column 1", "column 2", "column 3")


@pytest.mark.parametrize("rows", ["1,2,3\n", '"1",2,3\n'])
def test_one_row_of_numbers_is_refused(rows: str) -> None:
    with pytest.raises(JointIdError, match="has 1 row of numbers"):
        read_log(f"t,q,tau\n{rows}".encode(), "log.csv")


def test_minus_signs_are_those_of_negative_numbers() -> None:
    (table,) = read_log(comma_log().replace(b"-", "\N{MINUS SIGN}".encode()), "cell.csv")
    (plain,) = read_log(comma_log(), "cell.csv")
    assert min(table.columns[1].values) < 0
    for one, two in zip(table.columns, plain.columns, strict=True):
        np.testing.assert_array_equal(one.values, two.values)
