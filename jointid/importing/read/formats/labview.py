"""LabVIEW's measurements: .lvm, segments of text with X0 and Delta_X, and TDMS, with npTDMS."""

import re
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from jointid.arrays import Floats
from jointid.errors import JointIdError, import_optional
from jointid.importing.columns.log_table import MAX_TABLES, LogTable, most_first, require_few_values
from jointid.importing.columns.units import TIME_UNITS, split_unit
from jointid.importing.read.clocks import Signal, tables_of_signals
from jointid.importing.read.reader import Reader, begins_with, file_text, text_matches
from jointid.importing.read.text.numbers import number_or
from jointid.importing.read.text.tables import columns_of
from jointid.wording import listed

_END = "***End_of_Header***"
_MOST_SEGMENTS = 10_000
_UNIT_PROPERTIES = ("unit_string", "NI_UnitDescription", "Unit", "unit")


def read_lvm(file: str, path: str) -> tuple[LogTable, ...]:
    """Read the segments of an .lvm file; those of the same channels in order of time are one table."""
    lines = file_text(path).split("\n")
    starts, ends = (
        [k for k, line in enumerate(lines) if line.startswith(mark)] for mark in ("Channels", _END)
    )
    if not ends:
        raise JointIdError(f"{file}: the header does not end: the file is cut off. Export it again.")
    if len(starts) > _MOST_SEGMENTS:
        raise JointIdError(
            f"{file} has {len(starts)} segments with a header of their own; the limit is "
            f"{_MOST_SEGMENTS}. Export it with one header only, or as TDMS."
        )
    head = lines[: ends[0]]
    separator = next((line[9:10] for line in head if re.match(r"Separator[\t,;]", line)), "\t")
    main = dict(line.split(separator)[:2] for line in head if separator in line)
    decimal = main.get("Decimal_Separator", "").strip()  # old files leave it to the numbers
    if decimal not in ("", ".", ",") or decimal == separator:
        raise JointIdError(f'{file}: Decimal_Separator = "{decimal:.5}"; expected a point or a comma.')
    has_times = main.get("X_Columns", "One").strip() != "No"
    runs: list[list[list[Signal]]] = []
    # A segment's header ends like that of the file, its rows at the next header.
    segments = zip(starts, ends[1:], [*starts[1:], len(lines)], strict=False)
    for number, (start, end, stop) in enumerate(segments, start=1):
        top = next((k for k in range(end + 1, stop) if lines[k].strip()), stop)
        rows = lines[top + 1 : stop]
        if not any(row.strip() for row in rows):
            continue
        names = [name.strip() for name in lines[top].split(separator)]
        names = names[: len(names) - (names[-1] in ("Comment", ""))]
        where = f"{file}: segment {number}"
        columns = columns_of(
            where, rows, names, separator=separator, decimal=decimal, first_line=top + 2
        )
        about = {key.strip(): cells for key, *cells in (x.split(separator) for x in lines[start:end])}
        signals = [*_signals(where, about, zip(names, columns, strict=True), has_times)]
        before_it = runs[-1][-1] if signals and runs else []
        follows = [s.name for s in before_it] == [s.name for s in signals] and all(
            b.time_s[0] > a.time_s[-1] for a, b in zip(before_it, signals, strict=True)
        )
        if signals and follows:
            runs[-1].append(signals)
        elif signals:
            runs.append([signals])
    tables = [
        table
        for number, run in enumerate(runs[:MAX_TABLES], start=1)
        for table in tables_of_signals(
            file if len(runs) == 1 else f"{file}: part {number}", _joined(run)
        )
    ]
    if not tables:
        raise JointIdError(f"{file} holds no samples: export the measurement again.")
    return most_first(file, tables) if len(runs) > 1 else tuple(tables)


def _joined(run: list[list[Signal]]) -> list[Signal]:
    return [
        Signal(
            parts[0].name,
            np.concatenate([part.time_s for part in parts]),
            np.concatenate([part.values for part in parts]),
            parts[0].unit,
        )
        for parts in zip(*run, strict=True)
    ]


def _signals(
    where: str, about: dict[str, list[str]], columns: Iterable[tuple[str, Floats]], has_times: bool
) -> Iterator[Signal]:
    """Signals of a segment, with the entries of its header by channel."""
    time = np.zeros(0)
    for place, (name, values) in enumerate(columns):
        if name == "X_Value":
            time = values
            continue
        at = place - 1  # the entries of a channel are above its values, after their key
        entries = {key: cells[at].strip() for key, cells in about.items() if 0 <= at < len(cells)}
        if not has_times or time.size != values.size:
            start, delta = (number_or(entries.get(key, ""), 0.0) for key in ("X0", "Delta_X"))
            if delta <= 0:
                raise JointIdError(
                    f"{where}: {name} has neither times nor a Delta_X above 0: export it again."
                )
            time = start + delta * np.arange(len(values), dtype=np.float64)
        known = np.isfinite(time) & np.isfinite(values)
        if known.any():
            yield Signal(name, time[known], values[known], entries.get("Y_Unit_Label", ""))


def read_tdms(file: str, path: str) -> tuple[LogTable, ...]:
    """Read the channels of a TDMS file: waveforms, and channels beside a time channel."""
    nptdms = import_optional("nptdms", "npTDMS", "TDMS files")
    with nptdms.TdmsFile.open(path) as tdms:
        groups = tdms.groups()
        channels = [channel for group in groups for channel in group.channels()]
        require_few_values(file, sum(len(channel) for channel in channels))
        signals = [s for group in groups for s in _tdms_signals(group, len(groups) > 1)]
    otherwise = (
        f"{file} has no channels of numbers with times (wf_increment or a time channel). "
        f"Channels found: {listed(channel.path for channel in channels)}."
    )
    return tables_of_signals(file, signals, otherwise=otherwise)


def _tdms_signals(group: Any, several: bool) -> list[Signal]:
    """Signals of one group that have times."""
    arrays = {
        c.name: c for c in group.channels() if len(c) and c.dtype is not None and c.dtype.kind in "biufM"
    }
    times: dict[str, Any] = {}
    for name, channel in arrays.items():
        bare, unit = split_unit(name)
        stated = _unit(channel) or unit
        values = np.asarray(channel[:])
        if values.dtype.kind == "M":
            times[name] = values.astype("datetime64[ns]").astype(np.int64) * 1e-9
        elif bare.lower() in ("time", "t", "zeit", "x_value") or stated in TIME_UNITS:
            times[name] = values * TIME_UNITS.get(stated, 1.0)
    signals = []
    for name, channel in arrays.items():
        if name in times:
            continue
        step = float(channel.properties.get("wf_increment", 0.0) or 0.0)
        values = np.asarray(channel[:], np.float64)
        time = next((t for t in times.values() if t.size == values.size), None)
        if step > 0:
            time = float(channel.properties.get("wf_start_offset", 0.0)) + step * np.arange(values.size)
        label = f"{group.name}/{name}" if several else name
        if time is not None:
            signals.append(Signal(label, np.asarray(time, np.float64), values, _unit(channel)))
    return signals


def _unit(channel: Any) -> str:
    return str(next((channel.properties[k] for k in _UNIT_PROPERTIES if k in channel.properties), ""))


READERS = {
    "lvm": Reader("a LabVIEW measurement", text_matches(r"\s*LabVIEW Measurement"), read_lvm),
    "tdms": Reader("a TDMS file", begins_with(b"TDSm"), read_tdms, ("tdms",)),
}
