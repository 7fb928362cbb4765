"""Pages of the app without a browser."""

from __future__ import annotations

from pathlib import Path

from streamlit.testing.v1 import AppTest

from jointid import Study
from jointid.files.study_files import pack_study

APP = Path(__file__).parents[1] / "app.py"
KEYS = {1: "one joint", 2: "paper", 3: "three joints"}
"""The tests' studies, as the app names them, by their number of joints."""
ELASTICITY = "pages/4_Elasticity.py"


def opened_app() -> AppTest:
    """The app, before its first run."""
    return AppTest.from_file(str(APP), default_timeout=60)


def shown(at: AppTest) -> AppTest:
    """The page, after making sure that nothing was raised."""
    assert not at.exception, at.exception[0].stack_trace
    return at


def opened(app: AppTest, page: str, joints: int = 2, **parameters: str) -> AppTest:
    """A page about one of the tests' studies."""
    for name, value in {"study": KEYS[joints], **parameters}.items():
        app.query_params[name] = value
    at = app.switch_page(page).run()
    if page == ELASTICITY:
        at.run()  # slow parts appear in the next run, which a browser requests by itself
    assert not shown(at).error
    return at


def upload(at: AppTest, study: Study | bytes, name: str = "mine.zip") -> AppTest:
    """The page after a study was given to the side bar."""
    data = study if isinstance(study, bytes) else pack_study(study)
    at.file_uploader(key="uploaded").set_value((name, data, "application/zip"))
    return shown(at.run())


def figures(at: AppTest) -> int:
    """Number of figures on the page."""
    return len(at.get("plotly_chart"))
