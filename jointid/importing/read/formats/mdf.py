"""ASAM MDF measurement files of versions 3 and 4, with asammdf.

A channel may name a file of the computer as its attachment, and a formula that converts its values.
Neither is followed: asammdf reads the file from anywhere, and numexpr runs programs in formulas.
"""

from typing import Any

import numpy as np

from jointid.errors import import_optional
from jointid.importing.columns.log_table import MAX_COLUMNS, LogTable, require_few_values
from jointid.importing.read.clocks import Signal, tables_of_signals
from jointid.importing.read.reader import Reader, begins_with
from jointid.wording import listed


def read(file: str, path: str) -> tuple[LogTable, ...]:
    """Read the channels of an MDF file; every channel group has its own clock."""
    asammdf = import_optional("asammdf", "asammdf", "MDF files", "mdf")
    for version in ("v2_v3", "v4"):
        blocks = import_optional(f"asammdf.blocks.{version}_blocks", "asammdf", "MDF files", "mdf")
        blocks.evaluate, blocks.lambdify = _refuse, None
    signals: list[Signal] = []
    seen: list[str] = []
    formulas: list[str] = []
    with asammdf.MDF(path) as mdf:
        held = 0
        for number, group in enumerate(mdf.groups):
            master = mdf.masters_db.get(number)
            count = group.channel_group.cycles_nr
            held += count * len(group.channels)
            require_few_values(file, held)
            if master is None or count == 0:
                continue
            is_timed = not _has_formula(group.channels[master].conversion)
            for index, channel in enumerate(group.channels[:MAX_COLUMNS]):
                seen.append(channel.name)
                if getattr(channel, "attachment", None) is not None:
                    channel.attachment = None
                if not is_timed or _has_formula(channel.conversion):
                    formulas.append(channel.name)
                elif index != master:
                    found = mdf.get(group=number, index=index)  # with the conversion to physical values
                    if found.samples.dtype.kind in "biuf" and found.samples.ndim == 1:
                        time, values = (np.asarray(a, float) for a in (found.timestamps, found.samples))
                        signals.append(Signal(channel.name, time, values, str(found.unit or "")))
    left_out = f"Channels with a formula, left out: {listed(formulas)}. Export their converted values."
    otherwise = (
        f"{file} has no channels of numbers with times; channels with formulas are not read. "
        f"Channels found: {listed(seen)}."
    )
    return tables_of_signals(file, signals, [left_out] if formulas else [], otherwise=otherwise)


def _has_formula(conversion: Any) -> bool:
    """Whether a conversion, or one that it refers to, is a formula in text."""
    inner = getattr(conversion, "referenced_blocks", None) or {}
    return bool(getattr(conversion, "formula", "")) or any(map(_has_formula, inner.values()))


def _refuse(*_: object) -> None:
    raise TypeError("formulas are not run")  # asammdf then computes polynomials itself


READERS = {"mdf": Reader("an MDF file", begins_with(b"MDF     ", b"UnFinMF "), read, ("mf4", "mdf"))}
