"""File type of a log, from its first bytes, else from its name."""

from __future__ import annotations

TEXT = "text"
TYPE_NAMES = {
    "matlab": "a MATLAB file",
    "parquet": "Parquet",
    "hdf5": "HDF5",
    "excel": "a workbook",
    "db3": "a ROS 2 bag",
    "mcap": "MCAP",
    "bag": "a ROS 1 bag",
}
"""Name of each binary type in messages."""

_MAGIC = (
    (b"PAR1", "parquet"),
    (b"\x89HDF\r\n\x1a\n", "hdf5"),
    (b"PK\x03\x04", "excel"),
    (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", "excel"),
    (b"SQLite format 3\0", "db3"),
    (b"\x89MCAP0\r\n", "mcap"),
    (b"#ROSBAG V", "bag"),
)
_HDF5_MAGIC = b"\x89HDF\r\n\x1a\n"
_SUFFIXES = {
    "parquet": "parquet", "pq": "parquet", "mat": "matlab", "h5": "hdf5", "hdf5": "hdf5", "hdf": "hdf5",
    "he5": "hdf5", "xlsx": "excel", "xlsm": "excel", "xlsb": "excel", "xls": "excel", "ods": "excel",
    "db3": "db3", "mcap": "mcap", "bag": "bag",
}  # fmt: skip


def kind_of(name: str, head: bytes) -> str:
    """Return the kind of a file: "text", "parquet", "matlab", "hdf5", "excel", "db3", "mcap" or "bag".

    A zip archive counts as "excel": see ``jointid.importing.read.archives``.

    Parameters
    ----------
    name : str
        File name; its ending is used when the content is not recognised.
    head : bytes
        At least the first 1024 bytes.
    """
    for magic, kind in _MAGIC:
        if head.startswith(magic):
            return kind
    if any(head[512 * 2**k :].startswith(_HDF5_MAGIC) for k in range(4)):
        return "hdf5"  # MATLAB 7.3 adds a header in front
    if head.startswith(b"MATLAB 5.0 MAT-file") or head[126:128] in (b"IM", b"MI"):
        return "matlab"
    return _SUFFIXES.get(name.lower().rpartition(".")[2], TEXT)


def is_zip(head: bytes) -> bool:
    """Whether a file begins like a zip archive: logs, a bag, or a workbook."""
    return head.startswith(b"PK\x03\x04")
