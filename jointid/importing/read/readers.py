"""All readers of logs: the formats of this package, and those of plug-ins."""

from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path

from jointid.errors import JointIdError
from jointid.importing.read.reader import Reader
from jointid.importing.read.text.tables import read_text_table

TEXT = "text"
PLUGINS = "jointid.readers"
"""Group of the entry points by which other packages add a reader."""

_FORMATS = (
    "npz", "arrow", "hdf5", "matlab", "excel", "ros", "mdf", "wpilog",
    "twincat", "codesys", "labview", "halscope", "json_lines", "tidy",
)  # fmt: skip
"""Modules of ``formats``; each has ``READERS`` by kind. The first that recognises a file reads it."""

_UNSUPPORTED = (
    (b"%PDF", "a PDF"),
    (b"DIAEXTENDED", "the header of a DIAdem or KUKA trace, whose values are in another file"),
    (b"\x89PNG", "a picture (PNG)"),
    (b"\xff\xd8\xff", "a picture (JPEG)"),
    (b"GIF8", "a picture (GIF)"),
    (b"RIFF", "a sound or video file (RIFF)"),
    (b"\x1f\x8b", "a gzip archive"),
    (b"7z\xbc\xaf\x27\x1c", "a 7-Zip archive"),
    (b"Rar!\x1a\x07", "a RAR archive"),
    (b"BZh", "a bzip2 archive"),
    (b"\xfd7zXZ\0", "an xz archive"),
    (b"\x28\xb5\x2f\xfd", "a Zstandard archive"),
    (b"ULog\x01\x12\x35", "a PX4 log (ULog)"),
    (b"\xa3\x95\x80", "an ArduPilot log (DataFlash)"),
    (b"LOGG", "a Vector BLF log"),
    (b"TDSh", "the index of a TDMS file, whose values are in the .tdms file beside it"),
    (b"\xd4\xc3\xb2\xa1", "a capture of network packets (pcap)"),
    (b"\n\r\r\n", "a capture of network packets (pcapng)"),
    (b"\x04\x22\x4d\x18", "an LZ4 archive"),
    (b"|CF,", "an imc FAMOS file"),
    (b"CDF\x01", "a NetCDF 3 file"),
    (b"CDF\x02", "a NetCDF 3 file"),
    (b"\x0e\x03\x13\x01", "an HDF4 file"),
    (b"SIMPLE  =", "a FITS file"),
    (b"FEA1", "a Feather file of version 1"),
    (b"ORC", "an ORC file"),
    (b"Obj\x01", "an Avro file"),
    (b"RRF", "a Rerun recording"),
    *((bytes([0x80, k]), "a Python pickle, which could run code here") for k in range(2, 6)),
    (b"MZ", "a Windows program"),
    (b"\x7fELF", "a Linux program"),
)
"""First bytes of binary files without a reader."""
_TEXT_MAGIC = (b"%PDF", b"DIAEXTENDED")
_UNSUPPORTED_ENDINGS = {"svdx": "a TwinCAT Scope recording", "r64": "a KUKA trace"}


_TEXT = Reader(
    "a table of text",
    lambda head: False,  # any other file
    lambda file, path: (read_text_table(file, Path(path).read_bytes()),),
)


@cache
def readers() -> dict[str, Reader]:
    """Return all readers by kind; those of plug-ins first, that of any text last.

    Raises JointIdError when a plug-in cannot be loaded.
    """
    found: dict[str, Reader] = {}
    for entry in sorted(entry_points(group=PLUGINS), key=lambda e: e.name):
        try:
            reader = entry.load()
        except Exception as error:
            reader = error
        if not isinstance(reader, Reader):
            raise JointIdError(
                f'The log reader "{entry.name}" ({entry.value}) of an installed package cannot be used '
                f"({reader!r:.200}): update or remove the package."
            )
        found[entry.name] = reader
    for module in _FORMATS:
        own: dict[str, Reader] = import_module(f"jointid.importing.read.formats.{module}").READERS
        found |= {kind: reader for kind, reader in own.items() if kind not in found}
    return found | {TEXT: _TEXT}


def kind_of(name: str, head: bytes) -> str:
    """Return the kind of a file, a key of ``readers()``, from its first 4096 bytes.

    The ending of its name is used when the content is not recognised. A zip archive counts as "excel":
    see ``jointid.importing.read.logs``. Raises JointIdError when it is a binary file of a known
    format that no reader takes.
    """
    for kind, reader in readers().items():
        if reader.recognises(head):
            return kind
    ending = name.lower().rpartition(".")[2]
    named = _UNSUPPORTED_ENDINGS.get(ending) if b"\0" in head else None
    for magic, what in _UNSUPPORTED:
        # A text may begin with the same letters.
        if head.startswith(magic) and (not magic.isascii() or b"\0" in head or magic in _TEXT_MAGIC):
            named = what
    if named:
        raise JointIdError(f"{name} cannot be read: it is {named}. Export it as CSV, Parquet or HDF5.")
    return next((kind for kind, reader in readers().items() if ending in reader.endings), TEXT)


def is_zip(head: bytes) -> bool:
    """Whether a file begins like a zip archive: logs, a bag, or a workbook."""
    return head.startswith(b"PK\x03\x04")
