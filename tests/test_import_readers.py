"""File formats with stated names, units, scales and clocks: each is read with them."""

from __future__ import annotations

import io
import json
import os
import re
import struct
import subprocess
import sys
import time
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import format_makers as make
import numpy as np
import pyarrow as pa
import pyarrow.feather as feather
import pyarrow.parquet as pa_parquet
import pytest
from format_makers import FORMATS
from log_makers import ANGLE, KINDS, ROWS, SINES_HZ, TIME_S, TORQUE, sheet_of, two_joint_log, zipped
from plants import PAPER, PARALLELOGRAM

from jointid import JointIdError, analyse
from jointid.importing import (
    LogTable,
    apply_mapping,
    find_segments,
    guess_mapping,
    read_log,
    read_logs,
    study_from_logs,
)
from jointid.importing.read.formats import tidy
from jointid.importing.read.readers import readers


def refused(data: bytes, name: str) -> str:
    with pytest.raises(JointIdError) as caught:
        read_log(data, name)
    return str(caught.value)


def check_motion(table: LogTable, *, digits: float = 1e-6, torque_digits: float = 1e-3) -> None:
    """The guessed mapping gives back what the log was made of."""
    log = apply_mapping(table, guess_mapping(table).mapping)
    rows = np.round(log.time_s / make.STEP_S).astype(int)
    assert log.time_s == pytest.approx(TIME_S[rows], abs=1e-9)
    assert rows.size in (ROWS, ROWS // 2)
    assert log.theta_rad[:, 0] == pytest.approx(ANGLE[rows], abs=digits)
    assert log.tau_Nm[:, 0] == pytest.approx(TORQUE[rows], abs=torque_digits)


@pytest.mark.parametrize("name", FORMATS)
def test_each_format_gives_its_motion(name: str, tmp_path: Path) -> None:
    data = FORMATS[name](tmp_path)
    path = tmp_path / name
    path.write_bytes(data)
    for tables in read_logs([(path, ""), (data, "log.bin")]):  # the content decides, not the name
        assert not isinstance(tables, JointIdError), tables
        check_motion(tables[0])


@pytest.mark.parametrize("name", KINDS)
def test_each_kind_of_log_gives_k_and_d(name: str, tmp_path: Path) -> None:
    """As guessed by its names and units; no log states that its torque is held."""
    (table,) = read_log(KINDS[name](two_joint_log(), tmp_path), name)
    mapping = replace(guess_mapping(table).mapping, torque_hold=True)
    mapped = apply_mapping(table, mapping)
    study = study_from_logs(mapped, list(find_segments(mapped)), PARALLELOGRAM)
    assert [record.frequency_hz for record in study.records] == pytest.approx(
        np.repeat(SINES_HZ, 2), rel=1e-3
    )
    fit = analyse(study).fit
    np.testing.assert_allclose(fit.K, PAPER.K, rtol=2e-3)
    np.testing.assert_allclose(fit.D, PAPER.D, rtol=2e-2)


@pytest.mark.parametrize(
    ("name", "below", "column"),
    [
        ("twincat.csv", 60, "Axis1.ActPos"),
        ("codesys.csv", 60, "Application.PLC_PRG.lrActPosition"),
        ("halscope.log", 60, "axis.0.joint-pos-fb"),
        ("halscope.csv", 60, "axis.0.joint-pos-fb"),
        ("labview.lvm", 60, "X_Value"),
    ],
)
def test_a_cell_that_is_no_number_is_named_by_line_and_column(
    name: str, below: int, column: str, tmp_path: Path
) -> None:
    lines = FORMATS[name](tmp_path).decode().splitlines()
    number = re.compile(r"[-+]?\d+[.,]\d+")
    lines[below] = number.sub("+oops", lines[below], count=1)
    assert "oops" in lines[below]
    said = refused("\n".join(lines).encode(), name)
    assert re.match(rf'{name}(: segment 1)?, line {below + 1}, column {column}: "\+oops" is not', said)


def test_formats_inside_a_zip(tmp_path: Path) -> None:
    names = ("twincat.csv", "labview.lvm", "log.npz", "log.jsonl")
    tables = read_log(zipped({name: FORMATS[name](tmp_path) for name in names}), "week.zip")
    assert {table.source for table in tables} == {f"week.zip/{name}" for name in names}
    assert not any("could not" in note for note in tables[0].notes)


class TestTwinCat:
    @pytest.mark.parametrize(
        ("separator", "decimal"), [("\t", ","), ("\t", "."), (";", ","), (";", "."), (",", ".")]
    )
    @pytest.mark.parametrize("full_stamps", [False, True])
    def test_separators_marks_and_stamps(self, separator: str, decimal: str, full_stamps: bool) -> None:
        data = make.twincat(separator=separator, decimal=decimal, full_stamps=full_stamps)
        tables = read_log(data, "scope.csv")
        check_motion(tables[0])
        assert [column.unit for column in tables[0].columns] == ["s", "deg", "N·m"]
        assert [table.rows for table in tables] == [ROWS, ROWS, ROWS // 2]
        assert "2 clocks" in tables[0].notes[-1]
        assert "factor 0.001" in tables[0].notes[0]

    def test_channels_that_share_a_time_are_one_table(self) -> None:
        (table,) = read_log(make.twincat(shared=True, eof=False), "scope.csv")
        check_motion(table, torque_digits=1e-6)

    def test_a_scale_of_unknown_use_is_reported(self) -> None:
        data = make.twincat().replace(b"INT16", b"REAL64")
        assert "does not say whether its values include them" in read_log(data, "scope.csv")[0].notes[0]

    @pytest.mark.parametrize(("separator", "decimal"), [("\t", ","), (",", ".")])
    def test_names_alone_above_the_columns_of_each_clock(self, separator: str, decimal: str) -> None:
        """A preset of the export that writes no other properties; slow samples are repeated."""
        lines = make.twincat(separator=separator, decimal=decimal).decode().split("\r\n")
        properties = ("Data-", "Sample", "Scale", "Unit", "Variable", "NetID")
        names, *cells = [line.split(separator) for line in lines[6:] if not line.startswith(properties)]
        slow = [cells[1 + k // 2][2:] for k in range(ROWS)]
        rows = [cells[1 + k][:2] + slow[k] for k in range(ROWS)]
        text = "\r\n".join([*lines[:6], *(separator.join(row) for row in (names, *rows))])
        log = apply_mapping(
            table := read_log(text.encode(), "scope.csv")[0], guess_mapping(table).mapping
        )
        assert table.names == ("time", "Axis1.ActPos", "Axis1.ActTorque")
        assert log.time_s == pytest.approx(TIME_S[::2], abs=1e-9)
        assert log.tau_Nm[:, 0] == pytest.approx(1e3 * TORQUE[::2], abs=1)

    def test_the_symbol_of_cia_402_gives_the_unit_where_none_is_stated(self) -> None:
        data = make.twincat().replace(b"0.001", b"1").replace(b"Nm (Torque)", b"")
        symbols = b"SymbolName\tIn.Position actual value\tSymbolName\tIn.Torque actual value\r\nNetID"
        table = read_log(data.replace(b"NetID", symbols, 1), "scope.csv")[0]
        assert [column.unit for column in table.columns] == ["s", "deg", "‰"]
        assert "thousandths of the rated value, as in CiA 402" in table.notes[0]
        assert read_log(data, "scope.csv")[0].columns[2].unit == ""

    def test_a_comment_of_several_lines_gives_no_row(self) -> None:
        comment = b"SymbolComment\t(* angle\r\n2\r\n3\t*)\tSymbolComment\t\r\nData-Type"
        (table, *_) = read_log(make.twincat().replace(b"Data-Type", comment, 1), "scope.csv")
        check_motion(table)

    def test_names_with_the_separator_are_refused(self) -> None:
        data = make.twincat(separator=" ", decimal=".").replace(b"Axis1.ActPos", b"Axis 1.ActPos")
        assert "export it with tabs or semicolons" in refused(data, "scope.csv")


def test_codesys_states_microseconds() -> None:
    for data in (make.codesys_trace(microseconds=True), make.codesys_csv(microseconds=True)):
        check_motion(read_log(data, "trace.bin")[0])
    lines = make.codesys_trace().decode("utf-16").replace(",", ",\n ")
    check_motion(read_log(lines.encode("utf-16"), "trace.bin")[0])
    bits = re.sub(rb"; (\d+); -\S+", rb"; \1; FALSE", make.codesys_csv())
    torque = read_log(bits, "trace.bin")[0].columns[2].values
    assert torque == pytest.approx(np.maximum(TORQUE, 0.0), abs=1e-6)
    empty = make.codesys_trace().split(b"<\0T\0r\0a\0c\0e\0D\0")[0]
    assert "without samples" in refused(empty, "cell.trace")


class TestLabView:
    @pytest.mark.parametrize("decimal", [",", "."])
    @pytest.mark.parametrize("x_columns", ["One", "No", "Multi"])
    @pytest.mark.parametrize("segments", [1, 4])
    def test_every_layout(self, decimal: str, x_columns: str, segments: int) -> None:
        (table,) = read_log(make.lvm(decimal=decimal, x_columns=x_columns, segments=segments), "run.lvm")
        check_motion(table, torque_digits=1e-6)
        assert [column.unit for column in table.columns] == ["s", "deg", "N·m"]

    def test_an_old_file_leaves_the_decimal_mark_to_its_numbers(self) -> None:
        data = make.lvm(x_columns="Multi").replace(b"Decimal_Separator\t,\r\n", b"")
        check_motion(read_log(data, "run.lvm")[0], torque_digits=1e-6)

    def test_channels_beside_a_time_channel(self) -> None:
        (table,) = read_log(make.tdms(waveform=False), "run.tdms")
        check_motion(table, torque_digits=1e-9)


def test_both_kinds_of_halscope_captures() -> None:
    for old, decimal in ((False, "."), (True, "."), (False, ","), (True, ",")):
        (table,) = read_log(make.halscope(old=old, decimal=decimal), "scope.log")
        check_motion(table, torque_digits=1e-9)


def test_time_stamps_keep_nanoseconds_beside_a_missing_one(tmp_path: Path) -> None:
    ticks = 1_790_000_000_000_000_001 + 1_000_001 * np.arange(20)
    stamps = pa.array([*ticks.tolist(), None], pa.int64()).cast(pa.timestamp("ns"))
    table = pa.table({"t": stamps, "q": np.arange(21.0)})
    pa_parquet.write_table(table, path := tmp_path / "log.parquet")
    (found,) = readers()["parquet"].read("log.parquet", str(path))
    assert found.column("t").values[:-1] == pytest.approx(1.000001e-3 * np.arange(20), abs=1e-12)


def test_rates_side_by_side_keep_their_clocks() -> None:
    slow = [f"{TIME_S[k]:.3f};{TORQUE[k]:.9f}" for k in range(0, ROWS, 2)] + [";"] * (ROWS // 2)
    rows = [f"{TIME_S[k]:.3f};{ANGLE[k]:.9f};{slow[k]}" for k in range(ROWS)]
    tables = read_log("\n".join(["time1;pos;time2;torque", *rows]).encode(), "run.csv")
    check_motion(tables[0], torque_digits=1e-9)
    assert [table.rows for table in tables] == [ROWS, ROWS, ROWS // 2]
    assert {table.read_as for table in tables} == {"a table of text"}
    of_computer = [
        f"{TIME_S[k]:.3f};{ANGLE[k]:.9f};{2e3 * k + k % 7};{TORQUE[k]:.9f}" for k in range(ROWS)
    ]
    (table,) = read_log("\n".join(["time;pos;stamp;torque", *of_computer]).encode(), "run.csv")
    check_motion(table, torque_digits=1e-9)


def test_an_array_of_dates_is_the_clock() -> None:
    buffer = io.BytesIO()
    time = np.datetime64("2026-05-07T09:00") + (1e6 * TIME_S).round().astype("m8[us]")
    np.savez(buffer, stamp=time, q=ANGLE, tau=TORQUE)
    check_motion(read_log(buffer.getvalue(), "log.npz")[0], torque_digits=1e-9)


def test_errors_of_excel_in_any_language_are_missing_values() -> None:
    rows = [f"{2 * k};{ANGLE[k]:.9f};{TORQUE[k] if k % 2 == 0 else '#NV'}" for k in range(ROWS)]
    text = "\n".join(["Zeit [ms];Lage [rad];Moment [Nm]", *rows]).replace(".", ",")
    (table,) = read_log(text.encode(), "run.csv")
    check_motion(table, torque_digits=1e-9)
    table = read_log(text.replace("#NV", "#WERT!").encode(), "run.csv")[0]
    check_motion(table, torque_digits=1e-9)


@pytest.mark.parametrize("name", ["log.parquet", "log.feather"])
def test_rows_that_name_their_joint_or_signal_are_separated(name: str) -> None:
    """Read as one signal, two joints in turn would be a motion of twice the rate."""

    def saved(rows: list[dict[str, object]]) -> bytes:
        table, buffer = pa.Table.from_pylist(rows), io.BytesIO()
        (pa_parquet.write_table if name == "log.parquet" else feather.write_feather)(table, buffer)
        return buffer.getvalue()

    rows = [{**row, "axis": f"J{row['axis']:.0f}"} for row in make.per_joint_rows()]
    (table,) = read_log(saved(rows), name)
    assert guess_mapping(table).mapping.n == 2
    check_motion(table, torque_digits=1e-9)
    pairs = {"position": ANGLE, "torque": TORQUE}
    each = [
        {"t": TIME_S[k], "signal": signal, "value": values[k]}
        for k in range(ROWS)
        for signal, values in pairs.items()
    ]
    check_motion(read_log(saved(each), name)[0], torque_digits=1e-9)


def test_a_row_per_run_is_a_table_per_run() -> None:
    one, two = read_log(make.parquet_runs(), "runs.parquet")
    check_motion(one, torque_digits=1e-9)
    assert two.column("q").values == pytest.approx(2 * ANGLE)


@pytest.mark.parametrize(("separator", "decimal"), [(";", ","), (",", "."), ("\t", ".")])
@pytest.mark.parametrize("stamps", [False, True])
def test_long_tables(separator: str, decimal: str, stamps: bool) -> None:
    tables = read_log(make.tidy(separator=separator, decimal=decimal, stamps=stamps), "long.csv")
    check_motion(tables[0], torque_digits=1e-6)
    assert [column.unit for column in tables[0].columns] == ["s" if stamps else "ms", "rad", "N·m"]


@pytest.mark.parametrize("changed", ["", "missing", "infinite", "device", "blanks", "quotes"])
def test_long_tables_are_read_alike_at_once_and_row_by_row(
    changed: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    lines = make.tidy(separator=";", decimal=".").decode().splitlines()
    for k in (4, 11):
        time, name, _, unit = lines[k].split(";")
        if changed in ("missing", "infinite"):
            lines[k] = ";".join([time, name, "" if changed == "missing" else "inf", unit])
        elif changed:
            name = {"device": "Speed 1", "blanks": f" {name} ", "quotes": f'"{name}"'}[changed]
            lines[k] = ";".join([time, name, "1.5", unit])
    data = "\n".join([*lines, ""]).encode()
    fast = read_log(data, "long.csv")
    read_fast = tidy._read_fast
    layout = tidy._layout("\n".join(lines[:40]))
    assert layout is not None
    assert (read_fast(layout, lines) is None) == (changed == "blanks")
    monkeypatch.setattr(tidy, "_read_fast", lambda *_: None)
    for one, other in zip(fast, read_log(data, "long.csv"), strict=True):
        assert one.notes == other.notes
        for a, b in zip(one.columns, other.columns, strict=True):
            assert (a.name, a.unit) == (b.name, b.unit)
            np.testing.assert_array_equal(a.values, b.values)


def test_times_of_day_in_a_long_parquet_table_are_seconds() -> None:
    ticks = np.repeat((1.8e18 + 1e9 * TIME_S).astype(np.int64), 2)
    values = np.column_stack([ANGLE, TORQUE]).ravel()
    columns = {"time": pa.array(ticks, pa.timestamp("ns")), "signal": ["q", "tau"] * ROWS}
    out = io.BytesIO()
    pa_parquet.write_table(pa.table({**columns, "value": values}), out)
    (table,) = read_log(out.getvalue(), "long.parquet")
    assert table.column("time").values == pytest.approx(TIME_S - TIME_S[0], abs=1e-6)
    assert table.column("time").unit == "s"
    assert table.column("tau").values == pytest.approx(TORQUE)


def test_a_labview_file_with_a_header_per_row_is_refused() -> None:
    head = "LabVIEW Measurement\nSeparator\tTab\n***End_of_Header***\n"
    data = head + "Channels\t1\n***End_of_Header***\nX_Value\tq\n0\t1\n" * 10_001
    with pytest.raises(JointIdError, match=r"10001 segments .* the limit is 10000\. Export"):
        read_log(data.encode(), "log.lvm")


def test_empty_records_of_a_wpilog_are_passed_over() -> None:
    data = make.wpilog()
    empty = bytes([0, 1, 0, 9])  # of the position, at a stamp of 9 µs
    one, other = read_log(data, "a.wpilog"), read_log(data + empty * 1000, "a.wpilog")
    assert [table.rows for table in one] == [table.rows for table in other]


@pytest.mark.parametrize("unit", ["", " sec"])
def test_a_colon_in_a_name_makes_no_time_of_day(unit: str) -> None:
    """Only the time column decides; it may hold durations with their unit."""
    data = make.tidy(separator=";", decimal=".").decode()
    data = data.replace("Position", "Drive:Position").replace("Moment", "Drive:Moment")
    lines = [line.split(";") for line in data.splitlines()]
    for row in lines[1:] if unit else []:
        row[0] = f"{int(row[0]) / 1000:g}{unit}"
    table = read_log("\n".join(map(";".join, lines)).encode(), "long.csv")[0]
    check_motion(table, torque_digits=1e-6)


@pytest.mark.parametrize("named", [False, True])
def test_a_row_per_joint_keeps_the_joints_apart(named: bool) -> None:
    (table,) = read_log(make.per_joint(named=named), "joints.csv")
    check_motion(table, torque_digits=1e-6)
    log = apply_mapping(table, guess_mapping(table).mapping)
    assert log.theta_rad[:, 1] == pytest.approx(-ANGLE, abs=1e-6)
    assert log.tau_Nm[:, 1] == pytest.approx(-TORQUE, abs=1e-6)


@pytest.mark.parametrize("kind", ["jsonl", "xlsx", "csv"])
def test_long_tables_of_other_kinds_keep_the_joints_apart(kind: str) -> None:
    """JSON and workbooks hold long tables as well; in CSV two devices have signals of equal names."""
    rows = make.per_joint_rows()
    data = make.json_per_joint()
    if kind == "xlsx":
        data = sheet_of([[*rows[0]], *([*row.values()] for row in rows)])
    elif kind == "csv":
        lines = (
            f"{r['ts']},axis{r['axis']:d},{name},{r[name]}" for r in rows for name in ("pos", "trq")
        )
        data = "\n".join(["ts,device,metric,value", *lines]).encode()
    table = read_log(data, f"long.{kind}")[0]
    check_motion(table, torque_digits=1e-6)
    log = apply_mapping(table, guess_mapping(table).mapping)
    assert log.theta_rad[:, 1] == pytest.approx(-ANGLE, abs=1e-6)


def test_structs_of_times_and_values_keep_their_clocks() -> None:
    """As Simulink's signals become structs: one of times and values each, of different rates."""
    import scipy.io

    signals = {
        name: {"Time": TIME_S[::step], "Data": values[::step]}
        for name, values, step in (("q_rad", ANGLE, 1), ("tau", TORQUE, 2))
    }
    buffer = io.BytesIO()
    scipy.io.savemat(buffer, {"logsout": signals})
    check_motion(read_log(buffer.getvalue(), "run.mat")[0])


def test_a_labview_file_without_a_header_is_a_table() -> None:
    rows = "\n".join(f"{t:.6f}\t{q:.9f}\t{u:.9f}" for t, q, u in zip(TIME_S, ANGLE, TORQUE, strict=True))
    check_motion(read_log(rows.encode(), "run.lvm")[0])


def test_numpy_objects_are_never_loaded(tmp_path: Path) -> None:
    """An array of objects is a pickle: this one would write a file."""
    trap = tmp_path / "written"

    class Trap:
        def __reduce__(self) -> tuple[object, ...]:
            return Path.write_text, (trap, "gone")

    buffer = io.BytesIO()
    np.savez(buffer, t_s=TIME_S, q_rad=ANGLE, tau_Nm=TORQUE, trap=np.array([Trap()], dtype=object))
    (table,) = read_log(buffer.getvalue(), "log.npz")
    assert len(table.columns) == 3
    assert table.notes == ("Arrays of Python objects, left out: trap.",)
    assert not trap.exists()


def test_topics_of_other_types_are_named_where_efforts_are_missing(tmp_path: Path) -> None:
    table = read_log(make.ros_arrays(tmp_path), "run.mcap")[0]
    assert "Topics of other types, left out: /status (std_msgs/msg/String)." in table.notes


@pytest.mark.parametrize("formula", ["(*({} for i in (1,)),)", "X+({})"])
def test_formulas_of_mdf_are_never_run(formula: str, tmp_path: Path) -> None:
    """The library that evaluates them runs programs: these would write a file."""
    from asammdf import MDF, Signal

    trap = tmp_path / "written"
    place = str(trap).replace("x", '"+chr(120)+"')  # asammdf turns every x into X
    text = formula.format(f'eval(\'open("{place}", "w")\')')
    with MDF(version="4.10") as file:
        pair = [Signal(ANGLE, TIME_S, "rad", "motor_position"), Signal(TORQUE, TIME_S, "Nm", "torque_1")]
        spoiled = Signal(TORQUE, TIME_S, "Nm", "torque_2", conversion={"formula": text})
        file.append([*pair, spoiled])
        path = file.save(tmp_path / "log", overwrite=True)
    (table,) = read_log(path)
    check_motion(table)
    assert "Channels with a formula, left out: torque_2." in table.notes[0]
    assert not trap.exists()


@pytest.mark.parametrize("table", [True, False])
def test_json_as_pandas_writes_it(table: bool) -> None:
    rows = np.column_stack([TIME_S, ANGLE, TORQUE]).tolist()
    names = ["t", "q", "tau"]
    data: dict[str, object] = {"columns": names, "index": [*range(ROWS)], "data": rows}
    if not table:
        data = {name: {str(k): row[j] for k, row in enumerate(rows)} for j, name in enumerate(names)}
    check_motion(read_log(json.dumps(data).encode(), "log.json")[0])
    (bare,) = read_log(json.dumps(rows).encode(), "log.json")
    assert bare.names == ("column 1", "column 2", "column 3")


def test_series_in_nested_json_objects_are_columns() -> None:
    joints = {"j1": {"position": ANGLE.tolist(), "torque": TORQUE.tolist()}}
    data = {"robot": {"name": "cell", "rate": 500}, "time": TIME_S.tolist(), "joints": joints}
    (table,) = read_log(json.dumps(data).encode(), "log.json")
    assert table.names == ("time", "joints.j1.position", "joints.j1.torque")
    check_motion(table)


@pytest.mark.parametrize(
    "head",
    ["t,q" + " " * 30_000 + "b,tau\n", "t," + "_" * 30_000 + ",tau\n", "t" + " " * 30_000 + "q tau\n"],
)
@pytest.mark.parametrize("gap", ["", " " * 30_000])
def test_long_runs_of_blanks_take_linear_time(head: str, gap: str) -> None:
    separator = "," if "," in head else " "
    rows = zip(TIME_S.tolist(), ANGLE.tolist(), TORQUE.tolist(), strict=True)
    body = "\n".join(separator.join([f"{t}", gap + f"{q}", f"{tau}"]) for t, q, tau in rows)
    begin = time.process_time()
    (table,) = read_log((head + body).encode(), "log.txt")
    assert time.process_time() - begin < 2
    assert table.rows == ROWS


def huge_npy() -> bytes:
    buffer = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        buffer, {"descr": "<f8", "fortran_order": False, "shape": (1 << 40,)}
    )
    return buffer.getvalue()


def mat_bomb() -> bytes:
    """A variable of MATLAB 5 that unpacks to 300 MB."""
    pack = zlib.compressobj(1)
    body = b"".join([*(pack.compress(bytes(1 << 20)) for _ in range(300)), pack.flush()])
    head = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<HH", 0x0100, 0x4D49)
    return head + struct.pack("<II", 15, len(body)) + body


def lists_of_one_column() -> bytes:
    """Parquet with a list longer than the rows, but no second one."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    buffer = io.BytesIO()
    pq.write_table(pa.table({"t": [0.0, 1.0], "q": [[0.0] * 90, [1.0] * 90]}), buffer)
    return buffer.getvalue()


@pytest.mark.parametrize(
    ("data", "name", "said"),
    [
        (lists_of_one_column(), "log.parquet", "has no numbers"),
        (mat_bomb, "log.mat", "million numbers, more than the limit"),
        (huge_npy(), "log.npy", "more memory than the limit"),
        (b'{"a":' * 100_000 + b"1", "log.json", "not JSON"),
        (b"WPILOG\0\1" + b"\xff" * 400, "log.wpilog", "no entries of numbers"),
        (make.wpilog().replace(b"double", b"strung").replace(b"float[]", b"strings"), "a", "no entries"),
        (b"<Trace>" + b'<TraceVariable VarName="' * 20_000, "a.trace", "without samples"),
        (b"Sampling period is 0 nSec \n\nx +1.0 \n", "halscope.log", "sampling period of 0"),
        (b"LabVIEW Measurement\t\nSeparator\tTab\n", "a.lvm", "cut off"),
    ],
    ids=["list", "mat", "npy", "nested", "wpilog size", "wpilog texts", "regex", "period", "header"],
)  # fmt: skip
def test_hostile_files_are_refused_soon(data: bytes | Callable[[], bytes], name: str, said: str) -> None:
    data = data() if callable(data) else data
    began = time.process_time()
    assert said in refused(data, name)
    assert time.process_time() - began < 20


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"%PDF-1.7\n%\xe2\xe3", "is a PDF"),
        (b"DIAEXTENDED  {@:ENGLISH\n#BEGINGLOBALHEADER\n", "is the header of a DIAdem or KUKA trace"),
        (b"\x89PNG\r\n\x1a\n" + bytes(50), "is a picture (PNG)"),
        (b"\x1f\x8b\x08\0" + bytes(range(200)), "is a gzip archive"),
        (b"ULog\x01\x12\x35\x01" + bytes(300), "is a PX4 log (ULog)"),
        (b"\xa3\x95\x80\x80\x59FMT" + bytes(300), "is an ArduPilot log"),
        (b"LOGG\x90\0\0\0" + bytes(300), "is a Vector BLF log"),
        (b"TDSh\x0e\0\0\0" + bytes(300), "is the index of a TDMS file"),
        (b"\xd4\xc3\xb2\xa1\x02\0\x04\0" + bytes(300), "is a capture of network packets"),
        (b"CDF\x01" + bytes(300), "is a NetCDF 3 file"),
        (b"\x80\x04\x95" + bytes(300), "is a Python pickle"),
        (b"\x7fELF\x02" + bytes(300), "is a Linux program"),
        (bytes(range(1, 255)) * 8 + bytes(50), "neither text nor a file of a known kind"),
        (b"".join(bytes([k % 251, 0 if k % 3 else k % 7]) for k in range(4000)), "neither text nor"),
    ],
)
def test_known_binaries_are_named(data: bytes, said: str) -> None:
    message = refused(data, "log.csv")
    assert said in message
    assert "UTF-16" not in message


def test_recordings_without_a_magic_are_named_by_their_ending() -> None:
    assert "is a TwinCAT Scope recording" in refused(b"\x3e\x03\x03\0" * 40, "cell.svdx")
    assert read_log(make.twincat(), "cell.svdx")


def test_a_text_with_the_first_bytes_of_a_binary_is_read_as_text() -> None:
    (table,) = read_log(b"MZ,ORC\n" + b"".join(b"%d,%d\n" % (k, k % 5) for k in range(50)), "log.csv")
    assert table.names == ("MZ", "ORC")


PLUGIN = """
from jointid.importing.columns.log_table import LogColumn, LogTable, numbers
from jointid.importing.read.reader import Reader, begins_with

def read(file, path):
    values = [float(line) for line in open(path).read().split()[1:]]
    columns = LogColumn("t", numbers(values[0::3]), "s"), LogColumn("q", numbers(values[1::3]), "rad")
    return (LogTable(file, (*columns, LogColumn("tau", numbers(values[2::3]), "N·m"))),)

READER = Reader("a log of plant 7", begins_with(b"PLANT7"), read)
"""


@pytest.mark.parametrize("works", [True, False])
def test_an_entry_point_adds_a_reader(works: bool, tmp_path: Path) -> None:
    """Another package with an entry point, without a change of this one."""
    (tmp_path / "plant7.py").write_text(PLUGIN)
    about = tmp_path / "plant7-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: plant7\nVersion: 1.0\n")
    target = "READER" if works else "read"
    (about / "entry_points.txt").write_text(f"[jointid.readers]\nplant7 = plant7:{target}\n")
    numbers = " ".join(str(v) for row in zip(TIME_S, ANGLE, TORQUE, strict=True) for v in row)
    log = tmp_path / "log.p7"
    log.write_text(f"PLANT7 {numbers}")
    program = (
        "import sys, json; from jointid import JointIdError; from jointid.importing import read_log\n"
        "try:\n    (table,) = read_log(sys.argv[1]); print(json.dumps([table.names, table.rows]))\n"
        "except JointIdError as error: print(json.dumps(str(error)))"
    )
    root = str(Path(__file__).parents[1])
    run = subprocess.run(
        [sys.executable, "-c", program, str(log)], capture_output=True, text=True, check=True, cwd=root,
        env=os.environ | {"PYTHONPATH": f"{tmp_path}{os.pathsep}{root}"},
    )  # fmt: skip
    answer = json.loads(run.stdout)
    if works:
        assert answer == [["t", "q", "tau"], ROWS]
    else:
        assert 'The log reader "plant7" (plant7:read)' in answer


def test_the_readers_are_one_table() -> None:
    kinds = readers()
    assert len(kinds) >= 19
    assert all(reader.name and not any(map(str.isupper, kind)) for kind, reader in kinds.items())
    assert not any(reader.recognises(b"") for reader in kinds.values())


def test_a_zip_bomb_of_arrays_is_refused() -> None:
    buffer = io.BytesIO()
    with (
        zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open("a.npy", "w") as part,
    ):
        np.lib.format.write_array_header_1_0(
            part, {"descr": "<f8", "fortran_order": False, "shape": (40 << 20,)}
        )
        zeros = bytes(8 << 20)
        for _ in range(40):
            part.write(zeros)
    assert "more than the limit" in refused(buffer.getvalue(), "log.npz")
