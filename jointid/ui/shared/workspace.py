"""The studies to choose from: samples on disk, and those kept in the workspace of this address.

Only inputs are kept, never results. The address holds ?w=<workspace> from the first kept study on:
anyone with the address can open its studies, which outlive session, tab and server. Studies that the
store refuses stay in the session, with a message.
"""

from collections.abc import Container, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal
from weakref import WeakValueDictionary

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from jointid import JointIdError, Study
from jointid.files.application import application_folder, sample_studies
from jointid.files.digest import study_digest
from jointid.files.store import Store, new_workspace
from jointid.files.store_files import Entry, part_of, user_folder
from jointid.files.study_files import lines_around, load_study, pack_study, study_name
from jointid.ui.shared.method_steps import Step
from jointid.ui.shared.settings import SETTINGS
from jointid.wording import free_name

SAMPLES = application_folder() / "sample_data"
_MOST_OPENED = 12


@dataclass(frozen=True, eq=False)
class Opened:
    """A study ready to be shown."""

    key: str
    """Its name in the list of studies."""
    digest: str
    study: Study


def refuse(file: str, error: JointIdError, data: bytes) -> None:
    """Remember a file that could not be opened, with the lines around its fault."""
    st.session_state["refused"] = file, str(error), lines_around(data, error)


def sample_paths() -> Mapping[str, Path]:
    """Return the sample studies by key, the paper's first, the exercises last."""
    return _samples_in(SAMPLES, SAMPLES.stat().st_mtime_ns if SAMPLES.is_dir() else 0)


@lru_cache(maxsize=4)
def _samples_in(folder: Path, _changed_ns: int) -> Mapping[str, Path]:
    """List a folder once: a page asks for it some forty times."""
    found = {name.replace("_", " "): path for name, path in sample_studies(folder).items()}
    return dict(sorted(found.items(), key=lambda item: item[0].startswith("exercise")))


def label(key: str) -> str:
    """Return a study's name as the list shows it: of a sample the study's own, else the file's."""
    path = sample_paths().get(key)
    return key if path is None or key in _in_session() else _sample_name(key, path, *_stamp(path))


@lru_cache(maxsize=32)
def _sample_name(key: str, path: Path, changed_ns: int, size: int) -> str:
    try:
        return study_name(path) or key
    except JointIdError:
        return key  # the reason is shown when it is opened


def _stamp(path: Path) -> tuple[int, int]:
    stamp = (path / "study.toml" if path.is_dir() else path).stat()
    return stamp.st_mtime_ns, stamp.st_size


def store() -> Store:
    """Return the store of this computer's user."""
    return Store(user_folder())


def workspace() -> str | None:
    """Return the workspace of this session, initially from the address; None before the first study."""
    found: str | None = st.session_state.get("workspace") or st.query_params.get("w")
    if found is None:
        return None
    if not store().known(found):
        st.session_state.pop("workspace", None)
        st.query_params.pop("w", None)
        st.session_state["unknown_workspace"] = found
        st.session_state["store_problem"] = (
            "There is no workspace at this address (?w=…) on this computer: nothing was stored under "
            "it, or its folder was removed."
        )
        return None
    st.session_state["workspace"] = found
    return found


def _address() -> dict[str, str]:
    """Return study, workspace and the sidebar's settings as parameters of the address.

    Its widgets are not bound to them: streamlit drops from a link what is bound on the page it is on.
    """
    parts = {"study": st.session_state.get("chosen"), "w": st.session_state.get("workspace")}
    return {name: value for name, value in (parts | _settings()).items() if value}


def _settings() -> dict[str, str]:
    """Return the settings of the sidebar that are not the usual ones."""
    found: dict[str, str] = st.session_state.get("settings", {})
    return found


def follow_address() -> None:
    """Take study and settings of an address that is not the one shown: of a link or the Back button."""
    asked = _shown_address()
    moved = asked != st.session_state.get("address")
    if moved and asked["study"]:
        st.session_state["chosen"] = asked["study"]
    for name, options in SETTINGS.items():
        value = st.session_state.get(name, _settings().get(name))
        if moved and (asked[name] or "address" in st.session_state):
            value = asked[name]
        # Set in every run: the browser else draws the widget of a new page with the usual value.
        st.session_state[name] = value if value in options else options[0]
    st.session_state["settings"] = {
        name: st.session_state[name] for name in SETTINGS if st.session_state[name] != SETTINGS[name][0]
    }


def show_in_address() -> None:
    """Put study, workspace and settings into the address at once: each change is a step of Back.

    The bare address stays that of the first sample.
    """
    parts, shown = _address(), st.query_params
    for name in {*SETTINGS} - {*parts}:
        shown.pop(name, None)
    is_bare = "study" not in shown and parts == {"study": next(iter(sample_paths()), "")}
    if not is_bare and any(shown.get(name) != value for name, value in parts.items()):
        shown.update(parts)
    st.session_state["address"] = _shown_address()


def _shown_address() -> dict[str, str | None]:
    return {name: st.query_params.get(name) for name in ("study", *SETTINGS)}


def link_to(
    step: Step, label: str = "", place: DeltaGenerator | None = None, help_: str = "", **other: str
) -> None:
    """Link to a page with this study; streamlit's own link drops it from the address.

    ``other`` replaces parts of the address: ``study``, a key of ``names_by_address``, and settings.
    """
    about: dict[str, Any] = {"label": label or step.name, "help": help_ or None}
    (place or st).page_link(step.path, query_params=_address() | other, **about)


def go_to(step: Step) -> None:
    """Show another page with this study; its widgets set their own parts of the address."""
    st.switch_page(step.path, query_params=_address())


def recent() -> dict[str, Entry]:
    """Return the studies kept in this workspace by the name shown, newest first."""
    place = workspace()
    if place is None:
        return {}
    found: dict[str, Entry] = {}
    taken = {*sample_paths(), *map(label, sample_paths()), *_in_session()}
    entries: tuple[Entry, ...] = ()
    with noting_problems():
        entries = store().entries(place)
    for entry in reversed(entries):
        found[free_name(entry.name, {*taken, *found})] = entry
    return dict(reversed(found.items()))


def names_by_address() -> dict[str, str]:
    """Return the names to choose from by their key in the address (?study=...), kept ones by digest."""
    session = {name: name for name in reversed(_in_session())}
    samples = {name: name for name in sample_paths()}
    return session | {entry.digest: name for name, entry in recent().items()} | samples


def place_for(part: str) -> str | None:
    """Return the folder of a part of this workspace, see ``store``; None without a workspace."""
    place = workspace()
    return None if place is None else part_of(place, part)


def part_entries(part: str) -> dict[str, Entry]:
    """Return the entries of a part of this workspace by digest, the newest last.

    Raises JointIdError when the store cannot be read.
    """
    place = place_for(part)
    return {} if place is None else {entry.digest: entry for entry in reversed(store().entries(place))}


def read_part(part: str, digest: str) -> bytes | None:
    """Return the newest content of this digest in a part of this workspace, see ``part_entries``."""
    entry, place = part_entries(part).get(digest), place_for(part)
    return None if entry is None or place is None else store().read(place, entry.id)


def keep_part(
    part: str, name: str, digest: str, data: bytes, *, beside: Container[str] | None = None
) -> None:
    """Put an entry into a part of this workspace, which is created if needed.

    Of the other entries those with a digest in ``beside`` stay, by default all. Raises JointIdError when
    the store cannot take it.
    """
    place = workspace() or _new_workspace()
    store().put(part_of(place, part), name, digest, data)
    st.session_state["workspace"] = place
    show_in_address()
    if beside is not None:
        others = part_entries(part).items()
        _delete(part, [entry for key, entry in others if key != digest and key not in beside])


def empty_part(part: str) -> None:
    """Delete all entries of a part of this workspace, see ``part_entries``."""
    _delete(part, part_entries(part).values())


def _delete(part: str, entries: Iterable[Entry]) -> None:
    for entry in entries:
        store().delete(place_for(part) or "", entry.id)


def _new_workspace() -> str:
    """Return a new workspace, the same for all runs of this session."""
    place: str = st.session_state.setdefault("workspace_to_be", new_workspace())
    return place


def keep(study: Study, name: str) -> None:
    """Keep a study in this workspace; the next run of the page shows it."""
    digest = study_digest(study)
    place = workspace() or _new_workspace()
    try:
        data = pack_study(study, record_format="parquet")
        store().put(place, name, digest, data)
        st.session_state.update(chosen=digest, workspace=place)
    except JointIdError as error:
        st.session_state["store_problem"] = f"{name} is open in this session only. {error}"
        _keep_in_session(study, name, digest)
    st.session_state.pop("refused", None)


@contextmanager
def noting_problems(prefix: str = "") -> Iterator[None]:
    """Note an error of the store for the sidebar, and go on."""
    try:
        yield
    except JointIdError as error:
        st.session_state["store_problem"] = f"{prefix}{error}"


def change_store(action: Literal["rename", "delete"], *given: str) -> None:
    """Rename an entry of this workspace, or delete it for good."""
    if place := workspace():
        with noting_problems():
            getattr(store(), action)(place, *given)
        if action == "delete" and st.session_state.get("chosen") not in names_by_address():
            st.session_state["chosen"] = next(iter(sample_paths()), None)


def open_study(key: str) -> Opened:
    """Return a study of the list.

    Raises JointIdError when a sample or a kept copy cannot be read.
    """
    if key in _in_session():
        return _in_session()[key]
    place = workspace()
    if place is not None and (entry := recent().get(key)):
        store().touch(place, entry)
        digest, study = _load_kept(str(store().folder), entry.id, entry.checksum, place, entry.digest)
        return Opened(key, digest, study)
    return open_sample(key)


def open_sample(key: str) -> Opened:
    """Return a sample study. Raises JointIdError when it cannot be read."""
    path = sample_paths()[key]
    return _load_sample(key, str(path), *_stamp(path))


@st.cache_resource(max_entries=8, show_spinner=False)
def _load_sample(key: str, path: str, changed_ns: int, size: int) -> Opened:
    study = load_study(path)
    return Opened(key, study_digest(study), study)


@st.cache_resource(max_entries=32, show_spinner="Reading the stored study")
def _load_kept(folder: str, entry: str, checksum: str, _place: str, _digest: str) -> tuple[str, Study]:
    """Read a study from the store, unless a result of it is in memory, and with it the study.

    The entry's id is as random as the workspace's.
    """
    study = _in_use.get(_digest)
    if study is None:
        study = load_study(store().read(_place, entry))
        if study_digest(study) != _digest:
            store().set_aside(_place, entry, "its content has changed")
            raise JointIdError("The stored copy of this study is damaged: open its file again.")
        _in_use[_digest] = study
    return _digest, study


_in_use: WeakValueDictionary[str, Study] = WeakValueDictionary()
"""Studies read from the store that are still in memory, by digest."""


def _in_session() -> dict[str, Opened]:
    """Studies that the store refused, oldest first."""
    opened: dict[str, Opened] = st.session_state.setdefault("opened", {})
    return opened


def _keep_in_session(study: Study, name: str, digest: str) -> None:
    opened = _in_session()
    taken = {*sample_paths(), *(key for key, other in opened.items() if other.digest != digest)}
    key = free_name(name, taken)
    opened.pop(key, None)
    opened[key] = Opened(key, digest, study)
    while len(opened) > _MOST_OPENED:
        del opened[next(iter(opened))]
    st.session_state["chosen"] = key
