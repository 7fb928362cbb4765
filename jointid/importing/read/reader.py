"""The interface of a reader of logs: how a format is recognised, and the function that reads it."""

import codecs
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from jointid.importing.columns.log_table import LogTable
from jointid.importing.read.text.layout import stated_encoding, unix_lines


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


def text_matches(pattern: str) -> Callable[[bytes], bool]:
    """Return a test for files whose text begins with a match."""
    compiled = re.compile(pattern)
    return lambda head: compiled.match(text_of(head)) is not None


def text_of(data: bytes) -> str:
    """Decode a text, or the beginning of one; invalid bytes become replacement characters."""
    encoding = stated_encoding(data)
    try:  # the beginning of a file may end within a character
        text = codecs.getincrementaldecoder(encoding or "utf-8")().decode(data)
    except UnicodeDecodeError:
        text = data.decode(encoding or "latin-1", "replace")
    return unix_lines(text)


def file_text(path: str) -> str:
    """Return the decoded text of a file."""
    return text_of(Path(path).read_bytes())
