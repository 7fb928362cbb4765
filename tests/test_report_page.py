"""The page Report: its downloads equal the library's files, for any number of joints."""

from __future__ import annotations

import tomllib
from dataclasses import replace

import numpy as np
import pytest
from app_pages import KEYS, opened, upload
from streamlit.testing.v1 import AppTest

from jointid import MotionRecord, Study, analyse
from jointid.files.digest import study_digest
from jointid.ui.shared.results import result_cache


def offered(at: AppTest) -> list[str]:
    return [button.proto.label for button in at.get("download_button")]


@pytest.mark.parametrize("joints", KEYS)
def test_every_file_is_offered(app: AppTest, joints: int) -> None:
    at = opened(app, "pages/7_Report.py", joints)
    assert at.title[0].value == "Report and export"
    labels = offered(at)
    assert {"JSON", "TOML", "MATLAB (.mat)", "Phasors (.csv)", "Transfer matrix H (.csv)"} <= set(labels)
    assert not any(label.startswith(("Report", "MuJoCo", "URDF", "SDF")) for label in labels)


@pytest.mark.parametrize("joints", KEYS)
def test_the_report_is_made_on_demand_and_kept(
    app: AppTest, studies: dict[int, Study], joints: int
) -> None:
    result_cache.clear()
    at = opened(app, "pages/7_Report.py", joints)
    at = at.button(key="make_report").click().run()
    assert not at.exception
    assert not at.error
    assert {"Report as PDF", "Report as HTML"} <= set(offered(at))
    digest = study_digest(studies[joints])
    made = result_cache().get(
        ("report", digest, at.selectbox(key="estimator").value, at.selectbox(key="unit").value)
    )
    assert made is not None
    html, pdf = made
    assert pdf.startswith(b"%PDF-")
    assert digest in html
    again = at.run()
    assert "Report as PDF" in offered(again)
    assert not [button for button in again.button if button.key == "make_report"]


def test_the_report_of_a_new_import_is_made_automatically(app: AppTest) -> None:
    result_cache.clear()
    app.session_state["report_at_once"] = KEYS[1]
    at = opened(app, "pages/7_Report.py", 2)
    assert "Report as PDF" not in offered(at)
    at.session_state["chosen"] = KEYS[1]
    assert "Report as PDF" in offered(at.run())


def test_stiffness_is_converted_by_the_squared_gear_ratio(app: AppTest) -> None:
    at = opened(app, "pages/7_Report.py", 2)
    at = at.text_input(key="gears").set_value("100, -80").run()
    assert not at.exception
    assert not at.error
    assert {"MuJoCo (.xml)", "URDF (.urdf)", "SDF (.sdf)"} <= set(offered(at))
    K = tomllib.loads(next(code.value for code in at.code if code.language == "toml"))["K"]
    snippets = [code.value for code in at.code if code.language == "xml"]
    assert len(snippets) == 3
    for code in snippets:
        assert repr(float(100.0**2 * K[0])) in code
        assert repr(float(80.0**2 * K[1])) in code


@pytest.mark.parametrize(
    ("entered", "said"), [("100, 80, 60", "3 values"), ("0, 80", "is 0"), ("hundred", "not a number")]
)
def test_an_invalid_gear_ratio_is_an_error(app: AppTest, entered: str, said: str) -> None:
    at = opened(app, "pages/7_Report.py", 2)
    at = at.text_input(key="gears").set_value(entered).run()
    assert not at.exception
    assert said in at.error[0].value
    assert not any(label.startswith("MuJoCo") for label in offered(at))
    assert any(label.startswith("Study") for label in offered(at))


def test_negative_gear_ratios_of_the_study_make_snippets(studies: dict[int, Study]) -> None:
    def panel(analysis: object) -> None:  # its source runs without this file's names
        from jointid import Analysis
        from jointid.ui.study.downloads import show_simulator_files

        assert isinstance(analysis, Analysis)
        show_simulator_files(analysis, "cell")

    study = replace(studies[2], gear_ratio=np.array([101, -93.5]))
    at = AppTest.from_function(panel, kwargs={"analysis": analyse(study)}).run()
    assert not at.exception
    assert not at.error
    assert len(offered(at)) > 1
    assert "101, −93.5" in at.caption[0].value


def test_a_study_without_an_answer_can_still_be_saved(app: AppTest, studies: dict[int, Study]) -> None:
    time, rng = 1e-3 * np.arange(200), np.random.default_rng(0)
    still = MotionRecord(time, 1e-3 * rng.standard_normal((200, 2)), rng.standard_normal((200, 2)))
    at = upload(app.run(), replace(studies[2], records=[still]))
    at = at.switch_page("pages/7_Report.py").run()
    assert "not excited" in at.error[0].value
    assert any("records as CSV" in button.label for button in at.get("download_button"))
