"""A table of results from an unknown source, read in a child process with bounded memory and time."""

from __future__ import annotations

import json

from jointid.background.child_process import Child, Ended, Limits
from jointid.errors import JointIdError
from jointid.fleet.jobs import WORKER
from jointid.fleet.row import Row, from_plain

_LIMITS = Limits(time_s=60.0, memory_bytes=2 << 30)


def read_untrusted(data: bytes) -> tuple[Row, ...]:
    """Return the rows of a table of a fleet's results from any bytes.

    Parameters
    ----------
    data : bytes
        Content of a file that may or may not come from ``jointid batch``.

    Raises
    ------
    JointIdError
        When it is another kind of file, damaged, or needs too much memory or time.
    """
    child = Child(WORKER, _LIMITS)
    try:
        answer, body = child.ask({"do": "read"}, data)
    except Ended as ended:
        raise JointIdError(f"The table cannot be read, it is damaged. {ended}") from None
    finally:
        child.stop()
    if "error" in answer:
        raise JointIdError(answer["error"])
    return tuple(from_plain(row) for row in json.loads(body))
