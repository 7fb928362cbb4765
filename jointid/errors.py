"""The one error that a user of jointid meets, also where an optional library is missing."""

from __future__ import annotations

from importlib import import_module
from typing import Any

_MOST = 3000
"""Most characters of a message; names from files can make it any length."""


class JointIdError(ValueError):
    """Input that cannot be used.

    ``str(error)`` is the whole message for the user: the fault, its place (file, row, column, value,
    unit) and what to do. A program reads the place from the attributes, never from the message.

    Parameters
    ----------
    message : str
        The fault and its place.
    file : str, optional
        File at fault, as the message names it.
    line : int, optional
        Line of a text file or row of a table, from 1.
    column : str, optional
        Name of the column.
    hint : str, optional
        What to do; the message ends with it.
    """

    def __init__(
        self,
        message: str,
        *,
        file: str | None = None,
        line: int | None = None,
        column: str | None = None,
        hint: str | None = None,
    ) -> None:
        super().__init__(_shortened(f"{message} {hint}" if hint else message))
        self.file = file
        self.line = line
        self.column = column
        self.hint = hint

    def within(self, place: str, *, file: str | None = None) -> JointIdError:
        """Return the error with a place before its message; ``file`` applies if no file is set."""
        outer = JointIdError(f"{place}: {self}")
        outer.file, outer.line, outer.column = self.file or file, self.line, self.column
        outer.hint = self.hint
        return outer


def _shortened(message: str) -> str:
    """Return a message without its middle if it is too long; the remedy at its end remains."""
    if len(message) <= _MOST:
        return message
    return f"{message[: _MOST - 1000]} … {message[-900:]}"


def import_optional(module: str, package: str, needed_for: str, extra: str = "import") -> Any:
    """Import a module of an optional library.

    Raises JointIdError when it is not installed; the message names the package.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise JointIdError(
            f"{needed_for} need the package {package}, which is not installed. "
            f'Install it with: pip install "jointid[{extra}]" (or: pip install {package}).'
        ) from error
