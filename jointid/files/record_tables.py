"""The table of one record, CSV or Parquet: from bytes to arrays and back."""

import io
import math
import re
from collections.abc import Collection, Iterator, Sequence
from typing import NoReturn

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.csv as pa_csv  # type: ignore[import-untyped]
import pyarrow.parquet as pa_parquet  # type: ignore[import-untyped]

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.files.container_limits import CHUNK, MAX_RATIO, MAX_TOTAL_BYTES, mebibytes
from jointid.files.csv_tables import (
    are_usable,
    parquet_faults,
    read_columns,
    read_header,
    row_error,
    time_error,
)
from jointid.records import JointRecord, MotionRecord
from jointid.wording import counted, listed, nearest

_JOINT_COLUMN = re.compile(r"(?:theta_[am]([1-9]\d{0,3})_rad|tau_m([1-9]\d{0,3})_Nm)")
_BATCH = 1 << 16  # rows of a Parquet file that Arrow decodes at a time


def column_names(joints: int) -> list[str]:
    """Return the columns of a record of ``joints`` joints: time, motor angles, motor torques."""
    numbers = range(1, joints + 1)
    return ["time_s", *(f"theta_m{j}_rad" for j in numbers), *(f"tau_m{j}_Nm" for j in numbers)]


def _arm_names(joints: int) -> list[str]:
    """Columns of sensors behind the gears, which may be missing or empty."""
    return [f"theta_a{j}_rad" for j in range(1, joints + 1)]


def read_record_table(
    file: str, data: bytes, joints: int, *, arm: bool = False, left: int = MAX_TOTAL_BYTES
) -> dict[str, Floats]:
    """Read the columns of one record from a .csv or .parquet file; others are ignored.

    The numbers take at most ``left`` bytes.

    Returns the arrays of a record: time_s (N,), ascending; theta_rad and tau_Nm (N, n), motor side,
    finite; with ``arm`` also arm_rad (N, n), NaN for a joint without a column or with an empty one.
    Raises JointIdError when the table cannot be read, a column is missing, a value is not a finite
    number or the times do not increase; with file, row, column, value and remedy.
    """
    if not data:
        raise JointIdError(f"{file} is empty (0 bytes): export the record again.")
    kind = file.lower().rpartition(".")[2]
    if kind == "csv":
        header, body = read_header(file, data)
        positions = _find_columns(file, header, joints, arm)
        _require_size(file, data.count(b"\n") * len(positions) * 8, left)
        found = list(positions)
        sensors = [k for name, k in positions.items() if name in _arm_names(joints)]
        columns = read_columns(file, data, header, body, list(positions.values()), sensors)
    elif kind == "parquet":
        found, columns = _read_parquet(file, data, joints, arm, left)
    else:
        raise JointIdError(f"{file}: a record must be a .csv or .parquet file.")
    by_name = dict(zip(found, columns, strict=True))
    nothing = np.full(columns[0].size, np.nan) if arm else columns[0]

    def joined(names: Sequence[str]) -> Floats:
        return np.asfortranarray(np.column_stack([by_name.get(name, nothing) for name in names]))

    names = column_names(joints)
    arrays = {"time_s": columns[0], "theta_rad": joined(names[1 : joints + 1])}
    arrays["tau_Nm"] = joined(names[joints + 1 :])
    return arrays | ({"arm_rad": joined(_arm_names(joints))} if arm else {})


def write_record_table(record: JointRecord, record_format: str) -> bytes:
    """Return a record's table as the bytes of a "csv" or "parquet" file, exact to the last bit."""
    names = column_names(record.n)
    arrays = [record.time_s, *record.theta_rad.T, *record.tau_Nm.T]
    if isinstance(record, MotionRecord) and record.arm_rad is not None:
        for j in np.flatnonzero(~np.isnan(record.arm_rad[0])).tolist():
            names.append(_arm_names(record.n)[j])
            arrays.append(record.arm_rad[:, j])
    table = pa.table([pa.array(array) for array in arrays], names=names)
    buffer = io.BytesIO()
    if record_format == "parquet":
        pa_parquet.write_table(table, buffer)
    else:
        # Arrow writes the shortest decimals that give the same float64 again.
        buffer.write((",".join(names) + "\n").encode())
        pa_csv.write_csv(table, buffer, pa_csv.WriteOptions(include_header=False))
    return buffer.getvalue()


def _find_columns(file: str, found: Sequence[str], joints: int, arm: bool = False) -> dict[str, int]:
    """Positions of a record's columns among those of its file, by name."""
    for name in found:
        match = _JOINT_COLUMN.fullmatch(name)
        number = int(match[1] or match[2]) if match else 0
        if number > joints:
            raise JointIdError(
                f"{file} has the column {name}, but the inertia in study.toml has "
                f"{counted(joints, 'joint')}.",
                column=name,
                hint=f"Give M and M2 of all {number} joints, or remove the columns of joint {number}.",
            )
    positions = {}
    expected = column_names(joints)
    for name in [*expected, *(n for n in _arm_names(joints) if arm and n in found)]:
        count = found.count(name)
        if count > 1:
            raise JointIdError(f"{file} has {count} columns {name}: rename all but one.", column=name)
        if count == 0:
            others = [other for other in found if other not in expected]
            raise JointIdError(
                f"{_meaning(name)} is missing in {file}: expected a column {name}."
                f"{_conversion(name, others)} Columns found: {listed(found)}.",
                column=name,
            )
        positions[name] = found.index(name)
    return positions


def _meaning(column: str) -> str:
    kind, _, rest = column.partition("_m")
    what = {"theta": "Motor position", "tau": "Torque"}.get(kind)
    return f"{what} of joint {rest.partition('_')[0]}" if what else "Time"


def _conversion(name: str, found: Sequence[str]) -> str:
    """Suggest a conversion from a column in another unit, else the most similar name."""
    quantity = name.rpartition("_")[0]
    for other, unit, how in (
        (f"{quantity}_deg", "degrees to radians", "multiply by π/180"),
        (f"{quantity}_ms", "milliseconds to seconds", "divide by 1000"),
        (f"{quantity}_us", "microseconds to seconds", "divide by 1000000"),
    ):
        if other in found:
            return f" Convert {other} from {unit} ({how})."
    return nearest(name, found)


def numeric_columns(file: str, schema: pa.Schema, joints: int, arm: bool = False) -> dict[str, int]:
    """Positions of a Parquet record's columns by name: time, motor angles, torques, arm angles.

    Raises JointIdError when one is missing or holds no numbers.
    """
    positions = _find_columns(file, list(schema.names), joints, arm)
    for k in positions.values():
        kind = schema.types[k]
        if not (pa.types.is_floating(kind) or pa.types.is_integer(kind)):
            raise JointIdError(
                f"{file}, column {schema.names[k]}: holds {kind}; expected numbers (float64).",
                column=schema.names[k],
            )
    return positions


def _read_parquet(
    file: str, data: bytes, joints: int, arm: bool, left: int
) -> tuple[list[str], list[Floats]]:
    with parquet_faults(file):
        source = pa_parquet.ParquetFile(pa.BufferReader(data))
        names = list(numeric_columns(file, source.schema_arrow, joints, arm))
        if source.metadata.num_rows == 0:
            raise JointIdError(f"{file} has columns but no rows: export the record again.")
        size = _unpacked_bytes(source.metadata, len(names))
        _require_size(file, size, left)
        if size > CHUNK and size > MAX_RATIO * len(data):
            raise JointIdError(
                f"{file} would take {mebibytes(size)}, more than {MAX_RATIO} times its packed size: it "
                "is damaged. Export the record again."
            )
    sensors = _arm_names(joints) if arm else []
    columns = list(np.concatenate([*parquet_rows(file, source, names, may_lack=sensors)]).T)
    pairs = zip(names, columns, strict=True)
    given = {name: c for name, c in pairs if name not in sensors or not np.isnan(c).all()}
    if not are_usable([*given.values()]):
        explain_fault(file, [*given], [*given.values()])
    return names, columns


def parquet_rows(
    file: str,
    source: pa_parquet.ParquetFile,
    names: Sequence[str],
    first: int = 0,
    may_lack: Collection[str] = (),
) -> Iterator[Floats]:
    """Yield the rows from ``first`` on, counted from 0, in batches of shape (rows, columns).

    Missing values of the columns ``may_lack`` are NaN. Raises JointIdError when another value is
    missing, or the file cannot be read.
    """
    row = 0
    with parquet_faults(file):
        # A thread of Arrow that outlives the interpreter must not hold the Python buffer: one thread.
        for batch in source.iter_batches(batch_size=_BATCH, columns=names, use_threads=False):
            above = min(max(first - row, 0), batch.num_rows)
            columns = [batch.column(name).slice(above) for name in names]
            for name, column in zip(names, columns, strict=True):
                if column.null_count and name not in may_lack:
                    at = row + above + int(np.argmax(column.is_null().to_numpy(zero_copy_only=False)))
                    raise row_error(
                        (file, "row", at + 1),
                        "the value is missing.",
                        column=name,
                        hint="Fill it in or remove the row.",
                    )
            yield np.array([column.to_numpy(zero_copy_only=False) for column in columns], float).T
            row += batch.num_rows


def _unpacked_bytes(metadata: pa_parquet.FileMetaData, columns: int) -> int:
    """Size of a table unpacked, as its file states it."""
    # Not by column: Arrow ends the whole process over some damaged column metadata.
    stated = sum(metadata.row_group(k).total_byte_size for k in range(metadata.num_row_groups))
    return int(max(metadata.num_rows * columns * 8, stated))


def _require_size(file: str, size: int, left: int) -> None:
    if size > min(left, MAX_TOTAL_BYTES):
        limit = mebibytes(MAX_TOTAL_BYTES)
        before = "" if left == MAX_TOTAL_BYTES else " of all records together"
        raise JointIdError(
            f"{file} would take {mebibytes(size)}, more than the limit of {limit}{before}.",
            hint="Split the record, or log less data.",
        )


def explain_fault(
    file: str, names: Sequence[str], columns: Sequence[Floats], above: int = 0, before: float = -math.inf
) -> NoReturn:
    """Raise for the first fault of columns, time first, that ``are_usable`` refuses.

    ``above`` is the number of rows of the file above these, ``before`` the time of the last of them.
    """
    for name, column in zip(names, columns, strict=True):
        if not np.isfinite(column).all():
            row = int(np.argmin(np.isfinite(column)))
            raise row_error(
                (file, "row", above + row + 1),
                f"{column[row]} is not a finite number.",
                column=name,
                hint="Repair the value or remove the row.",
            )
    time = np.concatenate([[before], columns[0]])
    row = int(np.argmax(time[1:] <= time[:-1]))
    raise time_error((file, "row", above + row + 1), time[row + 1], time[row], above + row)
