"""Archives of logs, ROS bags, MATLAB timeseries, thousands separators."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from log_makers import (
    ANGLE,
    ROWS,
    TORQUE,
    cell_log,
    comma_log,
    excel,
    mat_scope,
    mat_timeseries,
    ros1_bag,
    ros_bag,
    zipped,
)
from random_cases import examples

from jointid import JointIdError
from jointid.importing import apply_mapping, find_segments, guess_mapping, main_tables, read_log


def bag_files(folder: Path, kind: str) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in ros_bag(folder, kind).iterdir()}


def refused(data: bytes, name: str = "log.zip") -> str:
    with pytest.raises(JointIdError) as caught:
        read_log(data, name)
    return str(caught.value)


class TestArchives:
    def test_each_file_of_an_archive_is_a_log(self, tmp_path: Path) -> None:
        files = {
            "runs/one.csv": comma_log(),
            "runs/cell 2.csv": cell_log(),
            "runs/README.md": b"# logs",
            "__MACOSX/runs/._one.csv": b"x",
            "scope.mat": mat_scope(),
        }
        for source in (zipped(files), tmp_path / "week.zip"):
            if isinstance(source, Path):
                source.write_bytes(zipped(files))
            tables = main_tables(read_log(source, "week.zip"))
            names = ["week.zip/runs/cell 2.csv", "week.zip/runs/one.csv", "week.zip/scope.mat"]
            assert [table.source for table in tables] == names
            assert not any("could not" in note for table in tables for note in table.notes)
            position = tables[1].column("position").values
            assert position == pytest.approx(ANGLE)

    @pytest.mark.parametrize("kind", ["sqlite3", "mcap"])
    @pytest.mark.parametrize("top", ["", "bag/", "week/bag 3/"])
    def test_a_zipped_bag_is_read(self, tmp_path: Path, kind: str, top: str) -> None:
        files = bag_files(tmp_path, kind)
        (table,) = read_log(zipped({top + name: data for name, data in files.items()}), "bag.zip")
        assert table.rows == ROWS
        assert table.column("shoulder position").values == pytest.approx(ANGLE)
        assert table.column("elbow effort").values == pytest.approx(2 * TORQUE)

    def test_bags_and_files_side_by_side(self, tmp_path: Path) -> None:
        files = {f"a/{name}": data for name, data in bag_files(tmp_path, "mcap").items()}
        files |= {f"b/{name}": data for name, data in bag_files(tmp_path, "sqlite3").items()}
        tables = read_log(zipped(files | {"c.csv": comma_log()}), "all.zip")
        assert [table.source for table in tables] == ["all.zip/a", "all.zip/b", "all.zip/c.csv"]

    def test_unreadable_members_are_named_and_the_others_are_read(self) -> None:
        tables = read_log(zipped({"bad.csv": b"hello", "good.csv": comma_log()}), "log.zip")
        assert [table.source for table in tables] == ["log.zip/good.csv"]
        assert "1 file of log.zip could not be read. log.zip/bad.csv" in tables[0].notes[0]

    def test_a_workbook_is_not_opened_as_a_zip(self) -> None:
        assert read_log(excel(), "log.zip")[0].source == ""

    def test_an_archive_without_logs_is_refused(self) -> None:
        assert "holds a study" in refused(zipped({"study.toml": b"format = 1"}))
        assert "no log that can be read" in refused(zipped({"README.md": b"# nothing"}))
        assert "bad.csv is not a table" in refused(zipped({"bad.csv": b"hello"}))
        assert "archive within" in refused(zipped({"in.zip": zipped({"a.csv": comma_log()})}))
        assert "leaves its folder" in refused(zipped({"../a.csv": comma_log()}))
        assert "limit of 50 logs" in refused(zipped({f"{k}.csv": b"1,2" for k in range(60)}))
        assert "not a readable zip" in refused(b"PK\x03\x04" + bytes(100))
        bomb = zipped({"a.csv": b"1,2\n" * (20 << 20)})
        assert "compress that well" in refused(bomb)


def test_a_bag_of_ros_1_is_read(tmp_path: Path) -> None:
    path = ros1_bag(tmp_path)
    for source in (path, path.read_bytes()):
        (table,) = read_log(source, "cell.bag")
        assert table.column("shoulder position").values == pytest.approx(ANGLE)
        assert table.column("elbow effort").unit == "N·m"


def test_time_series_saved_as_structs_are_read() -> None:
    (table,) = read_log(mat_timeseries(), "log.mat")
    log = apply_mapping(table, guess_mapping(table).mapping)
    assert log.theta_rad[:, 0] == pytest.approx(ANGLE)
    assert log.tau_Nm[:, 0] == pytest.approx(TORQUE)
    assert [round(s.frequency_hz, 2) for s in find_segments(log)] == [10.0]


def written(value: float, decimal: str, thousands: str, digits: int) -> str:
    text = f"{value:,.{digits}f}"
    return text.translate(str.maketrans({",": thousands, ".": decimal}))


def table_of(rows: np.ndarray, decimal: str, thousands: str, digits: int, separator: str = ";") -> bytes:
    quote = '"' if separator in (decimal, thousands) else ""
    lines = [
        separator.join(quote + written(v, decimal, thousands, digits) + quote for v in row)
        for row in rows
    ]
    return ("t;q;tau".replace(";", separator) + "\n" + "\n".join(lines) + "\n").encode("utf-8")


class TestThousands:
    @examples(150, derandomize=True)
    @given(
        st.sampled_from(
            [
                (decimal, thousands, separator)
                for decimal, thousands in [
                    (",", "."),
                    (".", ","),
                    (".", "'"),
                    (",", " "),
                    (".", "\u202f"),
                ]
                for separator in (";", "\t", ",")
                if separator != thousands or decimal == "."
            ]
        ),
        st.integers(1, 6),
        st.integers(0, 2**32 - 1),
    )
    def test_numbers_are_read_exactly_or_refused(
        self, marks: tuple[str, str, str], digits: int, seed: int
    ) -> None:
        """No number is changed without a message."""
        decimal, thousands, separator = marks
        rng = np.random.default_rng(seed)
        rows = (rng.standard_normal((12, 3)) * 10.0 ** rng.integers(0, 7, 3)).round(digits)
        data = table_of(rows, decimal, thousands, digits, separator)
        try:
            (table,) = read_log(data, "log.csv")
        except JointIdError as error:
            if "may be" not in str(error):
                raise
            return
        values = np.column_stack([column.values for column in table.columns])
        assert values.shape == rows.shape
        np.testing.assert_allclose(values, rows, atol=0.5 * 10.0**-digits)

    def test_the_assumed_number_format_is_stated(self) -> None:
        (table,) = read_log(b"t;q\n0,5;1.234,5\n1,5;-12.345,25\n", "log.csv")
        assert table.column("q").values.tolist() == [1234.5, -12345.25]
        assert '"1.234,5" is read as 1234.5' in table.notes[0]
        (table,) = read_log(b't,q\n"0.5","1,234.5"\n"1.5","-12,345.25"\n', "log.csv")
        assert table.column("q").values.tolist() == [1234.5, -12345.25]

    @pytest.mark.parametrize(
        "rows",
        [
            "0,5;1.234\n1,5;2.345\n",
            "0.5;1,234\n1.5;2,345\n",
            "1,234;2,345\n1,235;3,456\n",
        ],
    )
    def test_ambiguous_numbers_are_refused(self, rows: str) -> None:
        said = refused(("t;q\n" + rows).encode(), "log.csv")
        assert "may be" in said
        assert "Export" in said

    def test_points_before_three_digits_are_decimal_with_a_note(self) -> None:
        (table,) = read_log(b"t;q\n1.001;2.345\n1.002;3.456\n", "log.csv")
        assert table.column("q").values.tolist() == [2.345, 3.456]
        assert "decimal marks" in table.notes[0]
        (table,) = read_log(b"t;q\n0.001;2.345\n0.002;3.456\n", "log.csv")
        assert table.notes == ()

    def test_decimal_marks_far_down_the_file_are_found(self) -> None:
        """A value passes 1000 only far beyond the part that is looked at first."""
        values = np.arange(60_000) * 0.05 + 0.01
        lines = [f"{k};{written(value, ',', '.', 2)}" for k, value in enumerate(values)]
        (table,) = read_log(("t;q\n" + "\n".join(lines) + "\n").encode(), "log.csv")
        np.testing.assert_allclose(table.column("q").values, values, atol=0.005)

    def test_a_mark_in_a_wrong_place_is_no_number(self) -> None:
        rows = "".join(f"{k},5;1.234,5\n" for k in itertools.chain(range(20)))
        (table,) = read_log(f"t;q\n{rows}30,5;12.34,5\n".encode(), "log.csv")
        assert np.isnan(table.column("q").values[-1])
        assert any('"12.34,5"' in note for note in table.notes)
