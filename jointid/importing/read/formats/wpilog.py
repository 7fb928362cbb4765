"""WPILib data logs (.wpilog): entries with a stamp in microseconds for every value."""

import struct
from array import array
from pathlib import Path

import numpy as np

from jointid.importing.columns.log_table import LogTable, require_few_values
from jointid.importing.read.clocks import Signal, tables_of_signals
from jointid.importing.read.reader import Reader, begins_with
from jointid.wording import listed

_TYPES = {"double": "d", "float": "f", "int64": "q", "boolean": "?"}
_TYPES |= {f"{name}[]": code for name, code in _TYPES.items()}
_MOST_ENTRIES = 2000


class _Entry:
    def __init__(self, name: str, kind: str) -> None:
        self.name, self.code, self.is_array = name, _TYPES.get(kind, ""), kind.endswith("[]")
        self.size, self.width = struct.calcsize(f"<{self.code}"), 0
        self.stamps, self.values = array("q"), array("d")

    def add(self, stamp: int, payload: bytes) -> None:
        count, odd = divmod(len(payload), self.size)
        if odd:
            return
        self.width = self.width or count
        if count != self.width or (count > 1 and not self.is_array):
            return  # an array of varying length gives no columns
        self.stamps.append(stamp)
        self.values.extend(struct.unpack(f"<{count}{self.code}", payload))


def read(file: str, path: str) -> tuple[LogTable, ...]:
    """Read the numbers of a WPILib data log; every entry has its own clock."""
    data = Path(path).read_bytes()
    entries: dict[int, _Entry] = {}
    from_bytes = int.from_bytes  # most of the time of logs with many records goes to their heads
    place, held, notes = 12 + from_bytes(data[8:12], "little"), 0, []
    while place < len(data):
        lengths, a = data[place], place + 1
        b = a + (lengths & 3) + 1
        c = b + (lengths >> 2 & 3) + 1
        start = c + (lengths >> 4 & 7) + 1
        number, place = from_bytes(data[a:b], "little"), start + from_bytes(data[b:c], "little")
        if place > len(data) or (start - c == 8 and data[start - 1] >= 0x80):
            notes.append("The log ends within a record: its last record is left out.")
            break
        if number == 0:
            _control(data[start:place], entries)
        elif start < place and (entry := entries.get(number)) and entry.code:
            entry.add(from_bytes(data[c:start], "little"), data[start:place])
            held += 1 + entry.width
            if held & 0xFFFF == 0:
                require_few_values(file, held)
    require_few_values(file, held)
    signals = [signal for entry in entries.values() for signal in _signals(entry)]
    otherwise = f"{file} has no entries of numbers. Found: {listed(e.name for e in entries.values())}."
    return tables_of_signals(file, signals, notes, otherwise=otherwise)


def _control(payload: bytes, entries: dict[int, _Entry]) -> None:
    """Begin an entry; other control records (end, metadata) change no value."""
    if len(payload) < 13 or payload[0] != 0 or len(entries) >= _MOST_ENTRIES:
        return
    texts, place = [], 5
    for _ in range(2):
        size = int.from_bytes(payload[place : place + 4], "little")
        texts.append(payload[place + 4 : place + 4 + size].decode("utf-8", "replace"))
        place += 4 + size
    entries.setdefault(int.from_bytes(payload[1:5], "little"), _Entry(*texts))


def _signals(entry: _Entry) -> list[Signal]:
    if not entry.stamps:
        return []
    time = np.array(entry.stamps, dtype=np.float64) * 1e-6
    values = np.array(entry.values).reshape(-1, entry.width)
    order = np.argsort(time, kind="stable")
    names = [entry.name] if entry.width == 1 else [f"{entry.name}[{k}]" for k in range(entry.width)]
    return [Signal(name, time[order], values[order, k]) for k, name in enumerate(names)]


READERS = {"wpilog": Reader("a WPILib data log", begins_with(b"WPILOG"), read, ("wpilog",))}
