"""The studies that can be chosen: samples on disk, and those opened in this browser session.

Only inputs live here, never results. A store that outlives a refresh would keep ``Opened.study`` under
``Opened.key``: ``opened_here`` and ``keep`` are the two places to change.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import streamlit as st

from jointid import JointIdError, Study
from jointid.digest import study_digest
from jointid.study_files import PeekedTable, load_study, peek_study

SAMPLES = Path(__file__).parents[2] / "sample_data"
_FIRST_SAMPLE = "paper"
_MOST_OPENED = 12


@dataclass(frozen=True, eq=False)
class Opened:
    """A study ready to be shown."""

    key: str
    """Its name in the list of studies and in the address (?study=...)."""
    digest: str
    study: Study


@dataclass(frozen=True)
class Refused:
    """A file that could not be opened as a study; its tables can still be looked at."""

    file: str
    message: str
    tables: tuple[PeekedTable, ...]
    """The beginning of each table in it."""


def refuse(file: str, error: JointIdError, data: bytes) -> None:
    """Remember a file that could not be opened, with the beginning of its tables."""
    try:
        tables = peek_study(data)
    except JointIdError:
        tables = ()
    st.session_state["refused"] = Refused(file, str(error), tables)


def sample_paths() -> dict[str, Path]:
    """Return the sample studies by key, the paper's first."""
    found: dict[str, Path] = {}
    for path in sorted(SAMPLES.iterdir()) if SAMPLES.is_dir() else []:
        if path.suffix == ".zip" or (path / "study.toml").is_file():
            found.setdefault(path.stem.replace("_", " "), path)
    return dict(sorted(found.items(), key=lambda item: item[0] != _FIRST_SAMPLE))


def opened_here() -> dict[str, Opened]:
    """Return what this session has opened, newest first."""
    opened: dict[str, Opened] = st.session_state.setdefault("opened", {})
    return dict(reversed(opened.items()))


def keep(study: Study, name: str) -> None:
    """Add a study to this session's list; the next run of the page shows it."""
    digest = study_digest(study)
    opened: dict[str, Opened] = st.session_state.setdefault("opened", {})
    taken = {*sample_paths(), *(k for k, other in opened.items() if other.digest != digest)}
    key, number = name, 1
    while key in taken:
        number += 1
        key = f"{name} ({number})"
    opened.pop(key, None)
    opened[key] = Opened(key, digest, study)
    while len(opened) > _MOST_OPENED:
        del opened[next(iter(opened))]
    st.session_state["chosen"] = key
    st.session_state.pop("refused", None)


def open_study(key: str) -> Opened:
    """Return a study of the list.

    Raises
    ------
    JointIdError
        When a sample cannot be read.
    """
    opened = opened_here()
    if key in opened:
        return opened[key]
    path = sample_paths()[key]
    stamp = (path / "study.toml" if path.is_dir() else path).stat()
    return _load_sample(key, str(path), stamp.st_mtime_ns, stamp.st_size)


@st.cache_resource(max_entries=8, show_spinner="Reading the sample study")
def _load_sample(key: str, path: str, changed_ns: int, size: int) -> Opened:
    study = load_study(path)
    return Opened(key, study_digest(study), study)
