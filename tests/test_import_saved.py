"""The saved state of an unfinished import: another session at the address continues it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from app_pages import opened_app, shown
from streamlit.testing.v1 import AppTest
from test_import_page import PAGE, drop, long_log, send, widget

from jointid.files import store as store_module
from jointid.files.store import Store, new_workspace, part_of
from jointid.ui.importing.segments import Row
from jointid.ui.shared import workspace


@pytest.fixture(autouse=True)
def kept(sample_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Store:
    monkeypatch.setattr(workspace, "SAMPLES", sample_folder)
    monkeypatch.setenv("JOINTID_DATA_DIR", str(tmp_path / "data"))
    return Store(tmp_path / "data")


def begun(place: str | None = None) -> AppTest:
    """A session that begins on the import page, at a workspace's address."""
    at = opened_app()
    if place:
        at.query_params["w"] = place
    return shown(at.switch_page(PAGE).run())


def place_of(at: AppTest) -> str:
    place = at.query_params["w"]
    return place if isinstance(place, str) else place[0]


def rows(at: AppTest) -> list[Row]:
    return [row for part in at.session_state["import_segments_last"].values() for row in part]


def corrected(at: AppTest) -> AppTest:
    """Drop the first run, shorten the third and add one, as the table's editor reports it."""
    part = next(iter(at.session_state["import_segments_last"].values()))
    part[0] = Row(
        part[0].log, part[0].start_s, part[0].stop_s, part[0].frequency_hz, False, part[0].found
    )
    part[2] = Row(part[2].log, 7.0, part[2].stop_s, None)
    part.append(Row(part[0].log, 0.6))
    del at.session_state["import_segments_shown"]
    return shown(at.run())


def test_a_log_is_written_once_and_entries_as_json_until_it_is_closed(kept: Store) -> None:
    at = begun()
    assert "w" not in at.query_params
    assert not kept.folder.exists()
    at = drop(at, ("one.csv", long_log()))
    large = max(kept.folder.rglob("*.data"), key=lambda file: file.stat().st_size)
    at.text_input(key="import M2").set_value("0.003")
    at = shown(shown(at.run()).run())
    before = {file: file.stat().st_mtime_ns for file in kept.folder.rglob("*.*")}
    at = shown(at.run())
    assert {file: file.stat().st_mtime_ns for file in kept.folder.rglob("*.*")} == before
    assert large in before
    assert len(list(kept.folder.rglob("*.data"))) == 2
    place = part_of(place_of(at), "import")
    (entry,) = [e for e in kept.entries(place) if e.digest == "entries"]
    values = json.loads(kept.read(place, entry.id))
    assert values["entries"]["import M2"] == "0.003"
    assert [name for name, _ in values["files"]] == ["one.csv"]
    again = begun(place_of(at))
    widget(again, "button", "Start a new import").click()
    again = shown(again.run())
    assert not list(kept.folder.rglob("*.data"))
    assert not again.selectbox(key="study").disabled
    assert not [b for b in begun(place_of(at)).selectbox if b.label.startswith("Position")]


def test_logs_and_entries_are_there_in_another_session(kept: Store) -> None:
    first = drop(begun(), ("one.csv", long_log()))
    at = drop(begun(place_of(first)), ("two.csv", long_log(ratio=2.0)))
    widget(at, "text_input", "Gear ratios").set_value("-93.5")
    widget(at, "selectbox", "Unit of position 1").set_value("deg")
    widget(at, "button_group", "Torque between").set_value("held until the next sample")
    at.text_input(key="import M").set_value("0.001")
    at.text_input(key="import name").set_value("Cell 7")
    at.selectbox(key="import inertia std").set_value("unknown")
    at.selectbox(key="import torque std").set_value("± 2 %")
    at = corrected(shown(at.run()))
    again = begun(place_of(at))
    assert not again.error
    assert any("Still open: one.csv, two.csv" in caption.value for caption in again.caption)
    assert widget(again, "text_input", "Gear ratios").value == "-93.5"
    assert widget(again, "selectbox", "Unit of position 1").value == "deg"
    assert widget(again, "button_group", "Torque between").value == "held until the next sample"
    assert again.text_input(key="import M").value == "0.001"
    assert again.text_input(key="import name").value == "Cell 7"
    assert again.selectbox(key="import inertia std").value == "unknown"
    assert again.selectbox(key="import torque std").value == "± 2 %"
    assert rows(again) == rows(at)
    assert [row.use for row in rows(again)].count(False) == 1
    assert {row.start_s for row in rows(again)} >= {7.0, 0.6}


def test_an_entry_that_is_no_mapping_is_kept_as_well() -> None:
    at = drop(begun(), ("one.csv", long_log()))
    widget(at, "selectbox", "Torque of joint 1").set_value("joint position")
    at = shown(at.run())
    assert "both position of joint 1 and torque" in at.error[0].value
    again = begun(place_of(at))
    assert widget(again, "selectbox", "Torque of joint 1").value == "joint position"


def test_opening_takes_it_out_of_the_store_and_the_mapping_is_known_from_then_on(kept: Store) -> None:
    at = drop(begun(), ("one.csv", long_log()))
    widget(at, "text_input", "Gear ratios").set_value("4")
    at = send(shown(at.run()), "0.001", "0.003")
    place = place_of(at)
    assert at.title[0].value == "one"
    assert kept.entries(part_of(place, "import")) == ()
    assert len(kept.entries(place)) == 1
    later = drop(begun(place), ("new.csv", long_log(ratio=3.0)))
    assert widget(later, "text_input", "Gear ratios").value == "4"
    assert any("earlier entries for these columns" in info.value for info in later.info)
    widget(later, "button", "Guess again").click()
    later = shown(later.run())
    assert widget(later, "text_input", "Gear ratios").value == ""
    assert not later.info
    stranger = drop(begun(), ("new.csv", long_log(ratio=3.0)))
    assert widget(stranger, "text_input", "Gear ratios").value == ""


def test_logs_reported_as_stored_are_stored(kept: Store) -> None:
    def said(at: AppTest) -> list[bool]:
        place = part_of(place_of(at), "import")
        texts = [caption.value for caption in at.caption]
        assert bool(kept.entries(place)) == any(
            "stored under this page's address" in text for text in texts
        )
        return ["stay open in this session only" in text for text in texts]

    at = drop(begun(), ("one.csv", long_log()))
    assert not any(said(at))
    at = send(at, "0.001", "0.003")
    at = shown(at.switch_page(PAGE).run())
    assert any(said(at))
    widget(at, "text_input", "Gear ratios").set_value("7")
    at = shown(at.run())
    at = shown(at.run())
    assert not any(said(at))
    widget(at, "button", "Start a new import").click()
    assert not any(said(shown(at.run())))


def test_a_log_after_a_finished_import_is_named_and_to_be_checked(kept: Store) -> None:
    at = send(drop(begun(), ("one.csv", long_log())), "0.001", "0.003")
    at = shown(at.switch_page(PAGE).run())
    at = drop(at, ("two.csv", long_log(ratio=2.0)))
    assert any("drive data and inertias: two.csv." in w.value for w in at.warning)
    widget(at, "button", "Start a new import").click()
    at = shown(at.run())
    assert not [b for b in at.selectbox if b.label.startswith("Position")]
    at = drop(at, ("two.csv", long_log(ratio=2.0)))
    assert not at.warning
    assert at.text_input(key="import M").value == ""


def test_two_sessions_at_one_address_keep_separate_entries(kept: Store) -> None:
    one = drop(begun(), ("one.csv", long_log()))
    two = begun(place_of(one))
    widget(two, "button", "Start a new import").click()
    two = drop(shown(two.run()), ("two.csv", long_log(ratio=2.0)))
    widget(one, "text_input", "Gear ratios").set_value("7")
    one = shown(one.run())
    assert widget(one, "text_input", "Gear ratios").value == "7"
    assert not one.error
    two = shown(two.run())
    assert not two.error
    last = begun(place_of(one))
    assert any("Still open: one.csv." in caption.value for caption in last.caption)
    assert widget(last, "text_input", "Gear ratios").value == "7"


@pytest.mark.parametrize("what", ["log", "entries", "both"])
def test_damaged_logs_are_named_and_the_others_are_open(kept: Store, what: str) -> None:
    at = drop(begun(), ("one.csv", long_log()), ("two.csv", long_log(ratio=2.0)))
    widget(at, "text_input", "Gear ratios").set_value("7")
    place = place_of(shown(at.run()))
    part = part_of(place, "import")
    for entry in kept.entries(part):
        if (entry.digest == "entries" and what != "log") or (
            entry.name == "one.csv" and what != "entries"
        ):
            (file,) = kept.folder.rglob(f"{entry.id}.data")
            file.write_bytes(file.read_bytes()[:-1] + b"#")
    again = begun(place)
    said = " ".join(element.value for element in (*again.error, *again.warning))
    assert ("one.csv" in said) == (what != "entries")
    if what == "log":
        assert widget(again, "text_input", "Gear ratios").value == "7"
    if what == "both":
        assert any("two.csv." in caption.value for caption in again.caption)
    assert list((kept.folder / "damaged").iterdir())
    shown(again.run())


@pytest.mark.parametrize("text", ["[]", "{}", '{"format": 1, "files": 3}', "x", '{"format": 2}', "null"])
def test_entries_of_another_kind_are_set_aside(kept: Store, text: str) -> None:
    at = drop(begun(), ("one.csv", long_log()))
    kept.put(part_of(place_of(at), "import"), "entries", "entries", text.encode())
    again = begun(place_of(at))
    assert any("Still open: one.csv" in caption.value for caption in again.caption)
    assert list((kept.folder / "damaged").iterdir())


def test_logs_beyond_their_share_of_the_store_stay_in_the_session(
    kept: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(workspace, "store", lambda: Store(kept.folder, 200_000))
    at = shown(drop(begun(), ("one.csv", long_log())).run())
    assert any("open in this session only" in warning.value for warning in at.warning)
    assert not list(kept.folder.rglob("*.data"))
    assert send(at, "0.001", "0.003").title[0].value == "one"


def test_an_unwritable_store_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("not a folder")
    monkeypatch.setenv("JOINTID_DATA_DIR", str(tmp_path / "file"))
    at = shown(drop(begun(), ("one.csv", long_log())).run())
    assert any("open in this session only" in warning.value for warning in at.warning)
    assert widget(at, "text_input", "Gear ratios").value == ""


def test_parts_of_a_workspace_have_separate_folders() -> None:
    place = new_workspace()
    parts = [part_of(place, part) for part in store_module.PARTS]
    assert len({place, *parts}) == 1 + len(parts)
    assert all(len(part) == 32 for part in parts)
    assert parts == [part_of(place, part) for part in store_module.PARTS]
