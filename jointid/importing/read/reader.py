"""The interface of a reader of logs: how a format is recognised, and the function that reads it."""

from __future__ import annotations

import codecs
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from jointid.importing.columns.log_table import LogTable


@dataclass(frozen=True)
class Reader:
    """One format of logs.

    A plug-in offers a ``Reader`` under the entry point group ``jointid.readers``.
    """

    name: str
    """Noun for messages: "a TwinCAT Scope export"."""
    recognises: Callable[[bytes], bool]
    """Whether a file is of this format, from its first 4096 bytes."""
    read: Callable[[str, str], Sequence[LogTable]]
    """Read a file: its name, for messages, and its path. It runs in a process with bounded memory and
    time, and raises a ``JointIdError`` where the file holds no log."""
    endings: tuple[str, ...] = ()
    """Endings of file names, used where no reader recognises the content: "mat"."""


def begins_with(*magic: bytes) -> Callable[[bytes], bool]:
    """Return a test for files that begin with one of some byte sequences."""
    return lambda head: head.startswith(magic)


def text_of(data: bytes) -> str:
    """Decode a text, or the beginning of one; bytes that are no text become other characters."""
    marks = {
        codecs.BOM_UTF8: "utf-8",
        codecs.BOM_UTF16_LE: "utf-16-le",
        codecs.BOM_UTF16_BE: "utf-16-be",
    }
    for mark, encoding in marks.items():
        if data.startswith(mark):
            return _lines(data[len(mark) :].decode(encoding, "replace"))
    try:
        return _lines(data.decode("utf-8"))
    except UnicodeDecodeError as error:
        cut = error.start > len(data) - 4  # the beginning of a file may end within a character
        return _lines(data.decode("utf-8", "ignore") if cut else data.decode("latin-1"))


def file_text(path: str) -> str:
    """Return the decoded text of a file."""
    return text_of(Path(path).read_bytes())


def _lines(text: str) -> str:
    return text.replace("\r\n", "\n").replace("\r", "\n")
