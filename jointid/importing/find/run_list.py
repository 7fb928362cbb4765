"""The runs of logs as JSON, to be corrected by hand."""

import json
from collections.abc import Sequence
from typing import Any

from jointid.errors import JointIdError
from jointid.importing.columns.log_table import distinct_names
from jointid.importing.find.segment import Segment
from jointid.importing.find.segments import measure_run
from jointid.importing.map.mapped_log import MappedLog
from jointid.importing.map.mapping import json_values
from jointid.wording import listed, nearest, shown

_KEYS = ("log", "start_s", "stop_s", "frequency_hz", "band_hz")


def runs_to_json(logs: Sequence[MappedLog], found: Sequence[Sequence[Segment]]) -> str:
    """Write the runs of each log, a line for each; ``runs_from_json`` reads them."""
    lines = []
    for name, segments in zip(_names(logs), found, strict=True):
        for segment in segments:
            row: dict[str, Any] = {"log": name, "start_s": segment.start_s, "stop_s": segment.stop_s}
            lines_hz = list(segment.lines_hz)
            several = segment.is_multisine
            what = {"frequency_hz": lines_hz if several else segment.frequency_hz}
            row |= {"band_hz": segment.band_hz} if segment.is_motion else what
            lines.append(json.dumps(row, ensure_ascii=False))
    rows = ",\n  ".join(lines)
    return f'{{"format": 1, "runs": [\n  {rows}\n]}}\n'


def runs_from_json(text: str | bytes, logs: Sequence[MappedLog]) -> list[list[Segment]]:
    """Read the runs of each log, in order of time, and measure them as given.

    A run is a sine or multisine of ``frequency_hz``, a motion with ``band_hz``, or, with neither, what
    its span holds. Raises JointIdError when the text is no list of runs, names no log, or a run is
    empty.
    """
    remedy = "write it with jointid convert --list-runs."
    values = json_values("The list of runs", text, remedy)
    rows = values.get("runs") if isinstance(values, dict) and values.get("format") == 1 else None
    if not isinstance(rows, list):
        raise JointIdError(f'The list of runs needs "format": 1 and "runs": {remedy}')
    by_name = {name: k for k, name in enumerate(_names(logs))}
    found: list[list[Segment]] = [[] for _ in logs]
    for number, row in enumerate(rows, start=1):
        try:
            k = _log_of(row, by_name)
            found[k].append(_segment(row, logs[k]))
        except JointIdError as error:
            raise JointIdError(f"Run {number} of the list: {error}") from error
    return [sorted(segments, key=lambda s: s.start_s) for segments in found]


def _names(logs: Sequence[MappedLog]) -> list[str]:
    """Names of the logs, with a number where they repeat: "run.csv (2)"."""
    return distinct_names(log.name for log in logs)


def _log_of(row: Any, by_name: dict[str, int]) -> int:
    """Number of the log that a run belongs to; the only one where the run names none."""
    if not isinstance(row, dict):
        raise JointIdError(f"{shown(row)}; expected an object with the keys {listed(_KEYS)}.")
    for key in row:
        if key not in _KEYS:
            raise JointIdError(f'unknown key "{key:.60}".{nearest(key, _KEYS)}')
    name = row.get("log", next(iter(by_name)) if len(by_name) == 1 else None)
    if not isinstance(name, str) or name not in by_name:
        raise JointIdError(f"log = {shown(name)}; expected one of {listed(by_name)}.")
    return by_name[name]


def _segment(row: dict[str, Any], log: MappedLog) -> Segment:
    start, stop = (_number(key, row.get(key)) for key in ("start_s", "stop_s"))
    given, band = row.get("frequency_hz"), row.get("band_hz")
    if band is not None:
        if given is not None:
            raise JointIdError("it has frequency_hz and band_hz: keep one of them.")
        if not isinstance(band, list) or len(band) != 2:
            raise JointIdError(f"band_hz is {shown(band)}; expected two frequencies, Hz.")
        low, high = (_number("band_hz", value) for value in band)
        return Segment(start, stop, float("nan"), band_hz=(low, high))
    if given is None or given == []:
        return measure_run(log, start, stop)
    lines = [_number("frequency_hz", f) for f in (given if isinstance(given, list) else [given])]
    return measure_run(log, start, stop, lines)


def _number(key: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise JointIdError(f"{key} = {shown(value)}; expected a number.")
    return float(value)
