"""Bounds on files, messages and exported texts."""

from __future__ import annotations

import csv
import io
import json
import time
import tomllib
import warnings
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from log_makers import TIME_S, excel

from jointid import JointIdError
from jointid.exporting.tables import csv_text, phasor_table
from jointid.files.csv_tables import read_columns, read_header
from jointid.importing import apply_mapping, guess_mapping, read_log
from jointid.importing.columns.log_table import MAX_LOG_BYTES
from jointid.importing.read import reader_process
from jointid.importing.read.formats import json_lines

ROOT = Path(__file__).parents[1]
ROWS = [f"{t},{np.sin(t)},{np.cos(t)}" for t in TIME_S]


def test_the_page_and_the_server_agree_on_the_largest_upload() -> None:
    server = tomllib.loads((ROOT / ".streamlit/config.toml").read_text())["server"]
    assert server["maxUploadSize"] << 20 == MAX_LOG_BYTES


@pytest.mark.parametrize(
    "text", ["=1+1", "+1", "-1+cmd|' /C calc'!A0", "@SUM(1)", "\tx", "\r=x", "x\r=y"]
)
def test_texts_are_not_read_as_formulas_by_a_spreadsheet(text: str) -> None:
    header, row = csv.reader(io.StringIO(csv_text([text, "b"], [[text, -1.5]]), newline=""))
    plain = text.replace("\r", " ")
    assert header[0] == row[0] == (plain if text[0] == "x" else f"'{plain}")
    assert row[1] == "-1.5"


def test_labels_of_records_are_not_read_as_formulas() -> None:
    from jointid import Inertia, SineRecord, Study, analyse

    wave = 0.1 * np.sin(2 * np.pi * 10 * TIME_S)[:, None]
    record = SineRecord(10.0, TIME_S, wave, -3.0 * wave, label="=HYPERLINK(1)")
    other = replace(record, frequency_hz=20.0, theta_rad=0.1 * np.sin(2 * np.pi * 20 * TIME_S)[:, None])
    table = phasor_table(analyse(Study([record, other], Inertia(0.01, 0.02))))
    assert "'=HYPERLINK(1)" in table
    assert "\n=" not in table


def test_messages_are_bounded_and_keep_their_remedy() -> None:
    error = JointIdError("x" * 100_000, hint="Do this.")
    assert len(str(error)) < 3100
    assert str(error).endswith("Do this.")
    with pytest.raises(JointIdError) as caught:
        read_log(b"hello", "n" * 50_000)
    assert len(str(caught.value)) < 3100


@pytest.mark.parametrize("at", [1, 150])
def test_an_open_quote_is_refused(at: int) -> None:
    """In an unused column it would drop the lines up to the next quote without a message."""
    lines = [f"{row},ok" for row in ROWS]
    lines[at] = lines[at].replace("ok", '"ok')
    lines[at + 100] = lines[at + 100].replace("ok", '"ok')
    (table,) = read_log("\n".join(["t,q,tau,state", *lines]).encode(), "log.csv")
    assert table.rows == len(ROWS)
    data = "\n".join(["time_s,theta_m1_rad,tau_m1_Nm,state", *lines]).encode()
    names, body = read_header("01.csv", data)
    with pytest.raises(JointIdError, match=f"01.csv, line {at + 2}: a quote is not closed") as caught:
        read_columns("01.csv", data, names, body, [0, 1, 2])
    assert caught.value.line == at + 2
    closed = data.replace(b'"ok', b'"ok"')
    assert read_columns("01.csv", closed, names, body, [0, 1, 2])[0] == pytest.approx(TIME_S)


def test_an_open_quote_is_named_by_the_line_on_which_it_opens() -> None:
    lines = [f"{row},ok" for row in ROWS]
    lines[7] = lines[7].replace("ok", '"ok')
    data = "\n".join(["time_s,theta_m1_rad,tau_m1_Nm,state", "", *lines]).encode()
    header = read_header("01.csv", data)
    with pytest.raises(JointIdError, match=r"01\.csv, line 10"):
        read_columns("01.csv", data, *header, [0, 1, 2])


def test_many_comments_and_columns_are_read_in_bounded_time() -> None:
    begin = time.process_time()
    with pytest.raises(JointIdError, match="no column names in 65537 bytes"):
        read_header("01.csv", b"#\n" * 10_000_000)
    with pytest.raises(JointIdError, match="has 30000 columns, more than the limit of 2000"):
        read_log((",".join(["1"] * 30_000) + "\n").encode() * 50, "log.csv")
    assert time.process_time() - begin < 3


def test_values_that_overflow_are_refused_without_a_warning() -> None:
    rows = [f"{k},{(-1) ** k}e308,1" for k in range(60)]
    (table,) = read_log("\n".join(["t,angle_rad,torque_Nm", *rows]).encode(), "log.csv")
    joint = guess_mapping(table).mapping.joints[0]
    on_joint = replace(joint, position=replace(joint.position, side="joint"), gear_ratio=100.0)
    mapping = replace(guess_mapping(table).mapping, joints=(on_joint,))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(JointIdError, match="theta_rad: the value at index"):
            apply_mapping(table, mapping)


def test_the_limit_of_a_workbook_counts_its_unpacked_size() -> None:
    buffer = io.BytesIO(excel())
    pack = zipfile.ZipFile(buffer, "a", zipfile.ZIP_DEFLATED)
    with pack as archive, archive.open("xl/media/x.bin", "w") as part:
        for _ in range(130):
            part.write(bytes(1 << 20))
    with pytest.raises(JointIdError, match=r"unpacks to 130.1 MiB, more than the limit of 128 MiB"):
        read_log(buffer.getvalue(), "log.xlsx")


def test_a_long_table_is_judged_by_its_text(tmp_path: Path) -> None:
    """A name of 200 characters in every row takes no space in the file."""
    rows = 1_200_000
    names = pa.DictionaryArray.from_arrays(
        pa.array(np.arange(rows) % 2, pa.int8()), ["q" * 200, "t" * 200]
    )
    table = pa.table({"t": np.zeros(rows, "f4"), "signal": names, "value": np.zeros(rows, "f4")})
    pq.write_table(table, path := tmp_path / "long.parquet")
    with pytest.raises(JointIdError, match=r"as text has 2\d+.* more than the limit"):
        read_log(path)


def test_large_texts_are_read_within_the_limits_of_a_process(monkeypatch: pytest.MonkeyPatch) -> None:
    data = "\n".join(["Zeit [ms],q,tau", *ROWS]).encode()
    (here,) = read_log(data, "log.csv")
    monkeypatch.setattr(reader_process, "_SMALL_TEXT", 1000)
    (there,) = read_log(data, "log.csv")
    assert (there.names, there.notes, there.read_as) == (here.names, here.notes, "a table of text")
    assert [c.unit for c in there.columns] == [c.unit for c in here.columns] == ["ms", "", ""]
    for one, two in zip(here.columns, there.columns, strict=True):
        np.testing.assert_array_equal(one.values, two.values)
    monkeypatch.setattr(reader_process, "read_text_table", None)  # not called in this process
    assert read_log(data, "log.csv")[0].rows == here.rows


def test_json_of_too_many_values_is_refused_before_it_is_parsed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = tmp_path / "log.json"
    log.write_text(json.dumps([{"t": k, "q": k % 7} for k in range(50)]))
    assert json_lines.read("log.json", str(log))[0].rows == 50
    monkeypatch.setattr(json_lines, "_MOST_VALUES", 90)
    monkeypatch.setattr(json_lines, "_rows", None)
    with pytest.raises(JointIdError, match="million values, the limit for JSON"):
        json_lines.read("log.json", str(log))
