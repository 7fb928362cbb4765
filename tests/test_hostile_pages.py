"""Markup in every name of studies, logs and fleets is shown unchanged on every page."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from hostile import (
    JOINER,
    PIECES,
    file_name,
    hostile_fleet,
    hostile_logs,
    hostile_study,
    hostile_toml,
    markup,
    refused_study,
)
from random_cases import tries
from streamlit.testing.v1 import AppTest

from jointid import Study
from jointid.files.study_files import pack_study
from jointid.fleet import read_fleet
from jointid.ui.fleet import files as fleet_files

ROOT = Path(__file__).parents[1]
PAGES = ["app.py", *sorted(f"pages/{file.name}" for file in (ROOT / "pages").glob("*.py"))]


@pytest.fixture
def app(app: AppTest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> AppTest:
    monkeypatch.setattr(fleet_files, "read_untrusted", read_fleet)
    monkeypatch.setenv("JOINTID_DATA_DIR", str(tmp_path / "data"))
    return app


def elements(block: object) -> Iterator[object]:
    for child in getattr(block, "children", {}).values():
        yield child
        yield from elements(child)


def shown(at: AppTest) -> AppTest:
    assert not at.exception, at.exception[0].stack_trace
    for element in elements(at._tree):
        if (proto := getattr(element, "proto", None)) is not None:
            assert markup(proto) == []
    return at


def opened(at: AppTest, name: str, data: bytes) -> AppTest:
    at.file_uploader(key="uploaded").set_value((name, data, "application/zip"))
    return shown(at.run())


def test_every_page_about_a_hostile_study_sets_its_address(
    app: AppTest, studies: dict[int, Study]
) -> None:
    at = opened(shown(app.run()), "a.zip", pack_study(hostile_study(studies[2])))
    address = {name: at.query_params[name] for name in ("w", "study")}
    for page in tries(PAGES[1::3], long=PAGES):
        at.query_params.clear()
        at = shown(at.switch_page(page).run())
        assert {name: at.query_params[name] for name in address} == address, page
    for tab, said in (("Model check", "Largest: "), ("Inertias", "Motor side")):
        at.session_state["details"] = tab
        at = shown(at.switch_page("pages/4_Elasticity.py").run())
        assert any(said in caption.value for caption in at.caption), tab


def test_every_page_beside_a_refused_file(app: AppTest, studies: dict[int, Study]) -> None:
    at = opened(shown(app.run()), f"{file_name(1)}.zip", refused_study(studies[2]))
    assert "was not opened" in at.error[0].value
    for page in tries(PAGES[1:3], long=PAGES):
        at = shown(at.switch_page(page).run())


def test_hostile_logs_from_the_upload_to_the_study(app: AppTest) -> None:
    at = shown(app.switch_page("pages/9_Import_a_log.py").run())
    logs = [(name, data, "application/octet-stream") for name, data in hostile_logs().items()]
    at = shown(at.file_uploader(key="log_file").set_value(logs).run())
    assert any("logged simultaneously" in info.value for info in at.info)
    uploader = at.file_uploader(key="import_mapping_file 0")
    at = shown(uploader.set_value((f"{file_name(1)}.json", b"{}", "")).run())
    assert "was not used" in at.error[0].value
    at = shown(at.switch_page("app.py").run())
    at = shown(at.switch_page("pages/9_Import_a_log.py").run())
    assert any("Still open" in caption.value for caption in at.caption)
    at = shown(at.button_group(key="import inertia source").set_value("TOML").run())
    at = shown(at.text_area(key="import toml").set_value(hostile_toml()).run())
    assert any("M2 of 2 poses" in caption.value for caption in at.caption)
    at = shown(next(b for b in at.button if b.label == "Open as study").click().run())
    assert PIECES["qpic"] in at.title[0].value.replace(JOINER, "").replace("\\", "")


def test_a_hostile_fleet(app: AppTest) -> None:
    at = shown(app.switch_page("pages/10_Fleet.py").run())
    files = [(f"{file_name(1)}.parquet", hostile_fleet(), ""), (f"{file_name(2)}.parquet", b"PAR1", "")]
    at = shown(at.file_uploader(key="fleet_uploader").set_value(files).run())
    assert any("cannot be read" in error.value for error in at.error)
    for number in (1, 12):
        at = shown(at.selectbox(key="fleet_study").set_value(number).run())
    for robot in at.selectbox(key="fleet_robot").options:
        at = shown(at.selectbox(key="fleet_robot").set_value(robot).run())
