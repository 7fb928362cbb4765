"""The studies of a batch: folders, zips, patterns, and folders of studies."""

import glob
import os
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from jointid.errors import JointIdError
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
            raise JointIdError(f"{text:.200}: nothing is there. Check the path.", file=text)
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
