"""Pages of the app without a browser."""

from __future__ import annotations

from pathlib import Path

from streamlit.testing.v1 import AppTest

APP = Path(__file__).parents[1] / "app.py"


def opened_app() -> AppTest:
    """The app, before its first run."""
    return AppTest.from_file(str(APP), default_timeout=60)


def shown(at: AppTest) -> AppTest:
    """The page, after making sure that nothing was raised."""
    assert not at.exception, at.exception[0].stack_trace
    return at
