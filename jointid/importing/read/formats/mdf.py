"""ASAM MDF measurement files of versions 3 and 4, with asammdf."""

import numpy as np

from jointid.errors import import_optional
from jointid.importing.columns.log_table import MAX_COLUMNS, LogTable, require_few_values
from jointid.importing.read.clocks import Signal, tables_of_signals
from jointid.importing.read.reader import Reader, begins_with
from jointid.wording import listed


def read(file: str, path: str) -> tuple[LogTable, ...]:
    """Read the channels of an MDF file; every channel group has its own clock."""
    asammdf = import_optional("asammdf", "asammdf", "MDF files", "mdf")
    signals: list[Signal] = []
    seen: list[str] = []
    with asammdf.MDF(path) as mdf:
        held = 0
        for number, group in enumerate(mdf.groups):
            master = mdf.masters_db.get(number)
            count = group.channel_group.cycles_nr
            held += count * len(group.channels)
            require_few_values(file, held)
            if master is None or count == 0:
                continue
            for index, channel in enumerate(group.channels[:MAX_COLUMNS]):
                seen.append(channel.name)
                if index == master:
                    continue
                found = mdf.get(group=number, index=index)  # with the conversion to physical values
                if found.samples.dtype.kind in "biuf" and found.samples.ndim == 1:
                    time, values = np.asarray(found.timestamps, float), np.asarray(found.samples, float)
                    signals.append(Signal(channel.name, time, values, str(found.unit or "")))
    otherwise = f"{file} has no channels of numbers with times. Channels found: {listed(seen)}."
    return tables_of_signals(file, signals, otherwise=otherwise)


READERS = {"mdf": Reader("an MDF file", begins_with(b"MDF     ", b"UnFinMF "), read, ("mf4", "mdf"))}
