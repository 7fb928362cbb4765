"""The studies of a batch: where they are, the digest of their files, and one zip of them to send."""

import glob
import io
import os
import re
import zipfile
from collections.abc import Iterable, Iterator
from hashlib import blake2b
from pathlib import Path

from jointid.errors import JointIdError
from jointid.files.container_limits import MAX_TOTAL_BYTES, chunks
from jointid.files.containers import Folder
from jointid.files.study_parts import STUDY_PARTS, is_long
from jointid.files.study_saving import STUDY_FILE

_MAGIC = re.compile(r"[*?\[]")
_ESCAPE = re.compile(rb"\\(?=x(?:[89a-f][0-9a-f]|5c))")
"""A backslash that looks like the beginning of an escape."""


def find_studies(paths: Iterable[str | os.PathLike[str]]) -> tuple[Path, ...]:
    """Return the studies of paths and patterns, each once, in a fixed order.

    Each path is a study (a folder with study.toml, that file, or a .zip), a folder of studies at any
    depth, or a pattern such as ``cells/*/2026-*.zip`` or ``cells/**``. Hidden names (".…") are skipped.
    The result is absolute and without links, so that a study has one path; in the order of ``paths``,
    below a folder by name, numbers in names by value. An existing file is included even when it is no
    study: its row has the error. Raises JointIdError when ``paths`` is empty, nothing is at a path, or a
    pattern or folder has no study.
    """
    given = [os.fspath(path) for path in paths]
    if not given:
        raise JointIdError("No study is given: name folders, .zip files or patterns.")
    found = dict.fromkeys(os.path.realpath(path) for text in given for path in _expanded(text))
    return tuple(Path(path) for path in found)


def path_text(path: Path) -> str:
    r"""Return a path as text without surrogates; different paths give different texts.

    An undecodable byte becomes ``\xff``; a backslash before such a text in a name becomes ``\x5c``.
    """
    return _ESCAPE.sub(rb"\\x5c", os.fsencode(path)).decode("utf-8", "backslashreplace")


def _expanded(text: str) -> list[Path]:
    path = Path(text).absolute()  # resolving ".." here would be wrong after a link
    if not _MAGIC.search(text) or os.path.lexists(text):
        if not os.path.lexists(path):
            raise JointIdError(f"{text:.200}: no such file or folder. Check the path.", file=text)
        found, fault = [*_at(path)], f"{path} holds no study"
        if not path.is_dir():
            found = found or [path]
    else:
        matches = (Path(match).absolute() for match in glob.glob(text, recursive=True))
        found = [study for match in sorted(matches, key=_natural) for study in _at(match, outside=True)]
        fault = f"{text} matches no study"
    if not found:
        raise JointIdError(f"{fault}: a study is a folder with {STUDY_FILE}, or that folder as .zip.")
    return found


def _at(path: Path, *, outside: bool = False) -> Iterator[Path]:
    """The study of a path, or those below a folder, which with ``outside`` is itself in no study."""
    if path.name == STUDY_FILE:
        yield path.parent
    elif _is_study(path):
        yield path
    elif path.is_dir() and not (outside and any(_is_study(parent) for parent in path.parents)):
        yield from _below(path, set())


def _below(folder: Path, seen: set[str]) -> Iterator[Path]:
    """Studies in a folder and in those below it; links are followed once."""
    real = os.path.realpath(folder)
    if real in seen:
        return
    seen.add(real)
    try:
        entries = sorted(folder.iterdir(), key=_natural)
    except OSError as error:
        raise JointIdError(
            f"{folder} cannot be listed: {error.strerror or error}. Check its permissions."
        ) from error
    for entry in entries:
        if entry.name.startswith(".") or entry.name == "__MACOSX":
            continue
        if _is_study(entry):
            yield entry
        elif entry.is_dir():
            yield from _below(entry, seen)


def _is_study(path: Path) -> bool:
    if path.is_dir():
        return (path / STUDY_FILE).is_file()
    return path.suffix.lower() == ".zip" and path.is_file()


def _natural(path: Path) -> list[tuple[int, int, str]]:
    """Sort key that puts 2 before 10."""
    parts = re.split(r"(\d+)", str(path))
    return [(0, int(part), part) if part.isdecimal() else (1, 0, part) for part in parts]


def content_digest(source: Path | bytes) -> str:
    """Return a key, 32 hexadecimal digits (blake2b), that changes with any byte of a study's files.

    ``source`` is a folder or .zip by its path, or the zip itself. Of a folder, only study.toml, tables
    and robot models count. Raises JointIdError when the path does not exist, or the folder cannot be
    listed; OSError when a zip cannot be read.
    """
    state = blake2b(digest_size=16)
    if isinstance(source, bytes):
        state.update(source)
    elif source.is_dir():
        folder = Folder(source)
        for name in _names(folder):
            state.update(f"{name}\0".encode("utf-8", "surrogateescape"))
            try:
                with folder.path(name).open("rb") as file:
                    size = os.fstat(file.fileno()).st_size
                    state.update(f"{size}\0\0".encode())
                    for chunk in chunks(file, size):
                        state.update(chunk)
            except (JointIdError, OSError) as error:
                state.update(f"0\0{error}\0".encode("utf-8", "surrogateescape"))
    else:
        with source.open("rb") as archive:
            for chunk in chunks(archive):
                state.update(chunk)
    return state.hexdigest()


def packed(path: Path) -> bytes:
    """Return a study as one zip: a .zip unchanged, of a folder what ``content_digest`` counts.

    Raises JointIdError when the path does not exist, the folder cannot be listed, a file cannot be read,
    a record is so long that it is read in parts, or the files exceed the limit of an archive; OSError
    when a zip cannot be read.
    """
    if not path.is_dir():
        return path.read_bytes()
    buffer, left, folder = io.BytesIO(), MAX_TOTAL_BYTES, Folder(path)
    with zipfile.ZipFile(buffer, "w") as archive:
        for name in _names(folder):
            try:
                source = folder.path(name)
            except JointIdError:  # a link to nowhere: missing there too
                continue
            try:
                with source.open("rb") as file, archive.open(zipfile.ZipInfo(name), "w") as member:
                    size = os.fstat(file.fileno()).st_size
                    left -= size
                    if left < 0 or is_long(name, source):
                        raise JointIdError(
                            f"{path} cannot be sent to a cluster: {name} is too long. Analyse it on "
                            "this computer, without a scheduler: long Parquet files are then read in "
                            "parts."
                        )
                    for chunk in chunks(file, size):
                        member.write(chunk)
            except OSError as error:
                raise JointIdError(
                    f"{name} in {path} cannot be read: {error.strerror or error}. Check its permissions."
                ) from error
    return buffer.getvalue()


def _names(folder: Folder) -> list[str]:
    """Files of a study among those of its folder."""
    return [name for name in folder.names() if name.lower().endswith(STUDY_PARTS)]
