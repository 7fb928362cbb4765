"""Markup in every name, in Chromium: no page sends a request to another machine."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from urllib.parse import urlsplit

import pytest
from browsing import answered, finished, follow, open_file, rested
from hostile import (
    PIECES,
    SHOWN,
    file_name,
    hostile_fleet,
    hostile_logs,
    hostile_study,
    markup,
    refused_study,
)
from playwright.sync_api import Error, Page, Request, expect
from random_cases import tries
from streamlit.proto.ForwardMsg_pb2 import ForwardMsg

from jointid import Study
from jointid.files.study_files import pack_study

pytestmark = pytest.mark.browser
METHOD = tries(
    ["Records"],
    long=["Records", "Elasticity"],
    nightly=["Records", "Phasors", "Transfer matrix", "Elasticity", "Cut", "Plan"],
)
"""What every page is sent is read without a browser, too: ``test_hostile_pages.py``."""
FOLDED = "[data-testid=stExpander] details:not([open]) > summary:not(:has-text('error bars')):visible"
"""The checks of the error bars take longest and show no name."""


class Abroad:
    """Requests of a page to other machines, and texts sent to it that would be read as markup."""

    def __init__(self, page: Page, address: str) -> None:
        self.requests: list[str] = []
        self.markup: list[str] = []
        self._home = urlsplit(address).netloc
        page.on("request", self._request)
        page.on("websocket", lambda connection: connection.on("framereceived", self._received))

    def _request(self, request: Request) -> None:
        parts = urlsplit(request.url)
        if parts.scheme not in ("data", "blob") and parts.netloc != self._home:
            self.requests.append(request.url)

    def _received(self, frame: bytes | str) -> None:
        message = ForwardMsg.FromString(frame) if isinstance(frame, bytes) else ForwardMsg()
        if message.HasField("delta"):  # also what is there for a moment only, such as progress
            self.markup += markup(message)


def unfold(page: Page) -> None:
    for _ in range(12):
        if not page.locator(FOLDED).count():
            break
        page.locator(FOLDED).first.click()
        rested(page)


def look(page: Page) -> None:
    """Open every tab and expander, hover over figures, and find every text shown unchanged."""
    rested(page)
    unfold(page)
    tabs = page.locator("[role=tab]:visible")
    for k in range(1, tabs.count()):
        tabs.nth(k).click()
        rested(page)
        unfold(page)
    for figure in page.locator(".js-plotly-plot:has(.point)").all()[:4]:
        with suppress(Error):  # of a table that scrolls, or behind another point
            figure.locator(".point").first.hover(force=True, timeout=1000)
    for frame in page.frames:
        assert frame.evaluate(SHOWN, list(PIECES)) == []


def drop(page: Page, files: dict[str, bytes]) -> None:
    uploader = page.get_by_test_id("stMain").locator("input[type=file]").first
    with answered(page):
        uploader.set_input_files(
            [{"name": name, "mimeType": "", "buffer": data} for name, data in files.items()]
        )


def test_names_of_studies_make_no_links(
    address: str, open_in: Callable[..., Page], studies: dict[int, Study]
) -> None:
    page = open_in("about:blank")
    abroad = Abroad(page, address)
    page.goto(f"{address}/Import_a_log", wait_until="commit")
    finished(page, "Import a log")
    drop(page, hostile_logs())
    steps = page.locator("[data-testid=stExpander] summary")
    expect(steps.filter(has_text="5 Inertias")).to_be_visible()
    for k in range(5):
        if steps.nth(k).locator("..").get_attribute("open") is None:
            steps.nth(k).click()
    look(page)
    follow(page, "Fleet", "Fleet")
    drop(page, {f"{file_name(1)}.parquet": hostile_fleet(), f"{file_name(2)}.parquet": b"PAR1"})
    look(page)
    open_file(page, f"{file_name(3)}.zip", pack_study(hostile_study(studies[2])))
    page.get_by_test_id("stSidebar").get_by_role("link", name="Study", exact=True).click()
    expect(page.get_by_role("heading", level=1)).to_contain_text(PIECES["qbold"])
    look(page)
    for title in METHOD:
        follow(page, title, title)
        look(page)
    if tries(False, nightly=True):  # what the report holds: test_report.py
        follow(page, "Report and export", "Report and export")
        page.get_by_role("button", name="Make the report").click()
        expect(page.get_by_role("button", name="Report as PDF")).to_be_visible()
        look(page)
    open_file(page, f"{file_name(4)}.zip", refused_study(studies[2]))
    expect(page.get_by_text("was not opened")).to_be_visible()
    look(page)
    assert abroad.requests == []
    assert abroad.markup == []
