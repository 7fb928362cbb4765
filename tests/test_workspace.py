"""Studies stored at an address, as the pages of the app use them, without a browser."""

from __future__ import annotations

import shutil
from pathlib import Path
from urllib.parse import parse_qs

import pytest
from app_pages import opened_app, shown, upload
from streamlit.testing.v1 import AppTest

from jointid import Study
from jointid.files.digest import study_digest
from jointid.files.store import Store
from jointid.ui.shared import workspace


@pytest.fixture(autouse=True)
def folder(sample_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(workspace, "SAMPLES", sample_folder)
    monkeypatch.setenv("JOINTID_DATA_DIR", str(tmp_path / "data"))
    return tmp_path / "data"


def begun(**address: str) -> AppTest:
    """A session that begins at an address."""
    at = opened_app()
    for name, value in address.items():
        at.query_params[name] = value
    return shown(at.run())


def address_of(at: AppTest) -> dict[str, str]:
    values = {name: at.query_params[name] for name in ("w", "study")}
    address = {name: v if isinstance(v, str) else v[0] for name, v in values.items()}
    assert [len(value) for value in address.values()] == [32, 32]
    return address


def test_the_samples_are_listed_once_until_the_folder_changes(
    tmp_path: Path, sample_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A page asks for them some forty times."""
    here = shutil.copytree(sample_folder, tmp_path / "samples")
    listed = []
    real = workspace.sample_studies
    monkeypatch.setattr(workspace, "sample_studies", lambda of: listed.append(of) or real(of))
    monkeypatch.setattr(workspace, "SAMPLES", here)
    begun()
    assert listed == [here]
    assert "one more" not in workspace.sample_paths()
    shutil.copy(here / "paper.zip", here / "one_more.zip")
    assert "one more" in workspace.sample_paths()


def test_a_sample_needs_no_workspace(folder: Path) -> None:
    at = begun()
    assert "w" not in at.query_params
    assert not folder.exists()


def test_the_address_chooses_the_study_whenever_it_changes() -> None:
    at = begun()
    assert "study" not in at.query_params
    for name in ("one joint", "three joints", "one joint"):  # a link, a choice, the Back button
        if name == "three joints":
            at.selectbox(key="study").set_value(name)
        else:
            at.query_params["study"] = name
        at = shown(at.run())
        assert at.selectbox(key="study").value == name
        assert at.query_params["study"] in (name, [name])


def test_the_address_and_its_links_hold_the_settings() -> None:
    at = begun()
    unit = at.selectbox(key="unit")
    usual, other = unit.options[0], unit.options[-1]
    at = shown(unit.set_value(other).run())
    assert at.query_params["unit"] in (other, [other])
    links = [parse_qs(link.proto.query_string) for link in at.get("page_link")]
    assert all(link["unit"] == [other] for link in links)
    del at.query_params["unit"]  # the Back button
    at = shown(at.run())
    assert at.selectbox(key="unit").value == usual
    assert shown(at.selectbox(key="unit").set_value(other).run()).query_params["unit"]
    assert "unit" not in at.selectbox(key="unit").set_value(usual).run().query_params


@pytest.mark.parametrize("joints", [1, 2, 3])
def test_another_session_at_the_address_continues(studies: dict[int, Study], joints: int) -> None:
    at = upload(begun(), studies[joints])
    again = begun(**address_of(at))
    assert again.selectbox(key="study").value == "mine.zip"
    assert again.title[0].value == studies[joints].name
    assert [m.value for m in again.metric] == [m.value for m in at.metric]


def test_a_study_in_use_is_read_once(studies: dict[int, Study], monkeypatch: pytest.MonkeyPatch) -> None:
    """Its results hold it, also when more studies are in use than the cache of studies keeps."""
    at = upload(begun(), studies[1])
    address = address_of(at)
    in_use = workspace._in_use[address["study"]]
    workspace._load_kept.clear()
    monkeypatch.setattr(Store, "read", None)
    again = begun(**address)
    assert again.selectbox(key="study").value == at.selectbox(key="study").value
    assert workspace._in_use[address["study"]] is in_use


def test_without_the_address_no_study_is_visible(studies: dict[int, Study]) -> None:
    """The data sent to the browser do not name the study either."""
    mine, theirs = upload(begun(), studies[1]), upload(begun(), studies[3], "theirs.zip")
    address, other = address_of(mine), address_of(theirs)
    assert address["w"] != other["w"]
    assert "mine.zip" in str(mine._tree)
    assert "mine.zip" not in str(theirs._tree)
    assert "theirs.zip" not in str(mine.run()._tree)
    for place in ({}, {"w": other["w"]}, {"w": "../../etc/passwd"}):
        stranger = begun(study=address["study"], **place)
        assert any("is not, or no longer, in this workspace" in info.value for info in stranger.info)
        assert "mine.zip" not in str(stranger._tree)
    assert any("long gone.zip" in info.value for info in begun(study="long gone.zip").info)


def test_a_simulated_study_is_kept() -> None:
    at = shown(begun().switch_page("pages/8_Simulate.py").run())
    at.number_input(key="sim_count").set_value(4)
    at.number_input(key="sim_seconds").set_value(1.0)
    at = (
        shown(at.button[0].click().run()) if at.button[0].label == "Simulate" else pytest.fail("no form")
    )
    again = begun(**address_of(at))
    assert again.title[0].value == at.title[0].value
    assert again.title[0].value.startswith("Simulated robot")


def test_an_address_is_valid_after_renaming(studies: dict[int, Study], folder: Path) -> None:
    at = upload(begun(), studies[1])
    address = address_of(at)
    (entry,) = Store(folder).entries(address["w"])
    at = shown(at.text_input(key=f"name_{entry.id}").set_value("worn gear").run())
    assert at.selectbox(key="study").value == "worn gear"
    assert begun(**address).selectbox(key="study").value == "worn gear"


def test_a_sample_is_found_by_the_name_of_its_file() -> None:
    at = begun(study="one_joint")
    assert at.selectbox(key="study").value == "one joint"
    assert not any("in this workspace" in info.value for info in at.info)


def test_a_deleted_study_is_removed_from_every_session(studies: dict[int, Study]) -> None:
    at = upload(begun(), studies[1])
    other = begun(**address_of(at))
    (delete,) = [button for button in at.button if button.label == "Delete"]
    at = shown(delete.click().run())
    assert at.selectbox(key="study").value == "paper"
    other = shown(other.run())
    assert other.selectbox(key="study").value == "paper"
    assert any("no longer, in this workspace" in info.value for info in other.info)


@pytest.mark.parametrize("place", ["x", "../../etc", "A" * 32, "\0", "", "é" * 32])
def test_an_unknown_workspace_address_is_reported_and_not_used(
    place: str, studies: dict[int, Study]
) -> None:
    at = begun(w=place)
    assert at.title[0].value == studies[2].name
    at = upload(at, studies[1])
    assert address_of(at)["w"] != place


def test_a_study_too_large_for_the_store_stays_in_the_session(
    studies: dict[int, Study], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("not a folder")
    monkeypatch.setenv("JOINTID_DATA_DIR", str(tmp_path / "file"))
    at = upload(begun(), studies[1])
    assert at.title[0].value == studies[1].name
    assert any("open in this session only" in warning.value for warning in at.warning)
    at = shown(at.switch_page("pages/1_Records.py").run())
    assert at.selectbox(key="study").value == "mine.zip"


def test_a_note_of_the_store_is_shown_until_it_is_read(studies: dict[int, Study], folder: Path) -> None:
    at = upload(begun(), studies[1])
    address = address_of(at)
    (file,) = folder.rglob("*.data")
    file.write_bytes(b"damaged")
    again = begun(**address)
    assert again.title[0].value == studies[2].name
    assert any("mine.zip was damaged" in warning.value for warning in again.warning)
    (dismiss,) = [button for button in again.button if button.label == "Dismiss"]
    again = shown(dismiss.click().run())
    assert not any("mine.zip" in warning.value for warning in again.warning)


def test_an_existing_study_is_opened_again(studies: dict[int, Study]) -> None:
    at = upload(begun(), studies[1])
    first = address_of(at)
    assert first["study"] == study_digest(studies[1])  # the digest that reports and files state
    upload(begun(w=first["w"]), studies[1], "again.zip")
    at = shown(at.run())
    assert address_of(at) == first
    assert at.selectbox(key="study").value == "again.zip"
