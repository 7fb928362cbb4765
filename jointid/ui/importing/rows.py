"""Rows of the table of sine runs with their corrections, kept beyond page and session."""

from dataclasses import asdict, dataclass
from typing import Any

import streamlit as st

from jointid.importing import Segment

_LAST = "import_segments_last"
SHOWN = "import_segments_shown"
"""Key of the rows that the table began with."""


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    log: str
    """Key of its log."""
    start_s: float | None = None
    stop_s: float | None = None
    frequency_hz: float | None = None
    """None: to be estimated."""
    use: bool = True
    found: Segment | None = None
    """The segment itself as long as nothing of it was changed."""
    motion: bool = False
    """Any motion, not a sine."""


def last_rows() -> dict[str, list[Row]]:
    """Return the rows by digest of the segments found in their log."""
    rows: dict[str, list[Row]] = st.session_state.setdefault(_LAST, {})
    return rows


def forget_rows() -> None:
    """Forget every correction."""
    for key in (_LAST, SHOWN):
        st.session_state.pop(key, None)


def rows_to_json() -> dict[str, list[dict[str, Any]]]:
    """Return the session's rows as values that JSON can hold."""
    return {key: [asdict(row) for row in rows] for key, rows in last_rows().items()}


def rows_from_json(values: dict[str, list[dict[str, Any]]]) -> None:
    """Restore the result of ``rows_to_json``.

    Raises JointIdError, TypeError or AttributeError when it is something else.
    """
    st.session_state[_LAST] = {key: [_row(**row) for row in rows] for key, rows in values.items()}


def _row(found: dict[str, Any] | None, **values: Any) -> Row:
    return Row(**values, found=None if found is None else Segment(**found))
