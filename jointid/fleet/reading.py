"""A table of results from a stranger: read in a process of its own, with bounded memory and time."""

from __future__ import annotations

import json

from jointid.background.child_process import Child, Ended, Limits
from jointid.errors import JointIdError
from jointid.fleet.jobs import WORKER
from jointid.fleet.row import Row, from_plain

_LIMITS = Limits(time_s=60.0, memory_bytes=2 << 30)


def read_apart(data: bytes) -> tuple[Row, ...]:
    """Return the rows of a table of a fleet's results, whatever its bytes may be.

    Parameters
    ----------
    data : bytes
        What ``jointid batch`` wrote, or something else.

    Raises
    ------
    JointIdError
        When it is something else, is damaged, or takes too much memory or time.
    """
    child = Child(WORKER, _LIMITS)
    try:
        said, body = child.ask({"do": "read"}, data)
    except Ended as ended:
        raise JointIdError(f"The table cannot be read, it is damaged. {ended}") from None
    finally:
        child.stop()
    if "error" in said:
        raise JointIdError(said["error"])
    return tuple(from_plain(row) for row in json.loads(body))
