"""LabVIEW TDMS files, with npTDMS."""

from typing import Any

import numpy as np

from jointid.errors import import_optional
from jointid.importing.columns.log_table import LogTable, require_few_values
from jointid.importing.columns.units import TIME_UNITS, split_unit
from jointid.importing.read.clocks import Signal, tables_of_signals
from jointid.importing.read.reader import Reader, begins_with
from jointid.wording import listed

_UNIT_PROPERTIES = ("unit_string", "NI_UnitDescription", "Unit", "unit")


def read(file: str, path: str) -> tuple[LogTable, ...]:
    """Read the channels of a TDMS file: waveforms, and channels beside a time channel."""
    nptdms = import_optional("nptdms", "npTDMS", "TDMS files")
    with nptdms.TdmsFile.open(path) as tdms:
        groups = tdms.groups()
        channels = [channel for group in groups for channel in group.channels()]
        require_few_values(file, sum(len(channel) for channel in channels))
        signals = [s for group in groups for s in _signals(group, len(groups) > 1)]
    otherwise = (
        f"{file} has no channels of numbers with times (wf_increment or a time channel). "
        f"Channels found: {listed(channel.path for channel in channels)}."
    )
    return tables_of_signals(file, signals, otherwise=otherwise)


def _signals(group: Any, several: bool) -> list[Signal]:
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
        if step > 0:
            time = float(channel.properties.get("wf_start_offset", 0.0)) + step * np.arange(values.size)
        else:
            found = [t for t in times.values() if t.size == values.size]
            if not found:
                continue
            time = found[0]
        label = f"{group.name}/{name}" if several else name
        signals.append(Signal(label, np.asarray(time, np.float64), values, _unit(channel)))
    return signals


def _unit(channel: Any) -> str:
    return str(next((channel.properties[k] for k in _UNIT_PROPERTIES if k in channel.properties), ""))


READERS = {"tdms": Reader("a TDMS file", begins_with(b"TDSm"), read, ("tdms",))}
