"""The one error that a user of jointid meets."""

from __future__ import annotations


class JointIdError(ValueError):
    """Input that cannot be used.

    The message says what is wrong, where (file, row, column, value, unit) and what to do.
    """
