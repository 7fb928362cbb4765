"""Nothing is lost: refresh, closed tab, kill -9, links; and nothing is seen by who lacks the address."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from urllib.parse import parse_qs, urlsplit

import pytest
from browsing import PATIENCE_MS, Server, finished, once_more, rested
from clicks import choose
from playwright.sync_api import Browser, Page, expect

from jointid import Study
from jointid.study_files import pack_study

pytestmark = pytest.mark.browser

Visit = Callable[[str, str], Page]


@pytest.fixture(scope="module")
def server(new_server: Callable[[], Server]) -> Iterator[Server]:
    """A server for the tests of this file: each has a workspace of its own."""
    server = new_server()
    yield server
    server.kill()


@pytest.fixture
def visit(browser: Browser) -> Iterator[Visit]:
    """Open an address as somebody who was never here, and wait for the title."""
    contexts = []

    def open_address(address: str, title: str) -> Page:
        contexts.append(browser.new_context())
        page = contexts[-1].new_page()
        page.set_default_timeout(PATIENCE_MS)
        page.goto(address, wait_until="commit")
        finished(page, title)
        return page

    yield open_address
    for context in contexts:
        context.close()


def upload(page: Page, study: Study, name: str, *, title: str = "") -> None:
    page.get_by_role("button", name="Open a study (.zip)").click()
    file = {"name": name, "mimeType": "application/zip", "buffer": pack_study(study)}
    page.get_by_test_id("stPopoverBody").locator("input[type=file]").set_input_files(file)
    if title:
        workspace_of(page)  # the address has one as soon as the file has arrived
    finished(page, title or study.name)
    page.keyboard.press("Escape")


def chosen(page: Page, name: str) -> None:
    expect(page.get_by_role("combobox", name="Study")).to_have_value(name, timeout=PATIENCE_MS)


def workspace_of(page: Page) -> str:
    expect(page).to_have_url(re.compile(r"[?&]w=[\w-]{32}(&|$)"), timeout=PATIENCE_MS)
    return parse_qs(urlsplit(page.url).query)["w"][0]


@once_more
def test_a_study_survives_refresh_links_kill_and_a_closed_tab(
    server: Server, studies: dict[int, Study], visit: Visit
) -> None:
    page = visit(server.address, studies[2].name)
    assert "w=" not in page.url
    upload(page, studies[1], "mine.zip")
    place = workspace_of(page)
    page.reload(wait_until="commit")
    finished(page, studies[1].name)
    chosen(page, "mine.zip")
    for name in ("Records", "Simulate a robot", "Elasticity"):
        page.get_by_test_id("stSidebar").get_by_role("link", name=name, exact=True).click()
        finished(page, name)
        chosen(page, "mine.zip")
        assert workspace_of(page) == place
    expect(page.get_by_test_id("stMetric")).to_have_count(2)
    expect(page.locator(".js-plotly-plot .main-svg").first).to_be_visible()
    choose(page, "Estimator", "least-squares")
    expect(page).to_have_url(re.compile("estimator=least-squares"), timeout=PATIENCE_MS)
    address = page.url
    server.kill()
    server.start()
    page.reload(wait_until="commit")
    finished(page, "Elasticity")
    chosen(page, "mine.zip")
    page.context.close()
    again = visit(address, "Elasticity")
    chosen(again, "mine.zip")
    expect(again.get_by_test_id("stMetric")).to_have_count(2)
    expect(again.get_by_role("combobox", name="Estimator")).to_have_value("least-squares")


@once_more
def test_who_lacks_the_address_sees_nothing(
    server: Server, studies: dict[int, Study], visit: Visit
) -> None:
    quick = f"{server.address}/Import_a_log"  # the sidebar of a page without pictures
    mine, theirs = visit(quick, "Import a log"), visit(quick, "Import a log")
    upload(mine, studies[1], "mine.zip", title="Import a log")
    expect(theirs.get_by_text("Recent studies")).to_have_count(0)
    upload(theirs, studies[3], "theirs.zip", title="Import a log")
    assert workspace_of(mine) != workspace_of(theirs)
    mine.reload(wait_until="commit")
    for page, seen, hidden in ((mine, "mine.zip", "theirs.zip"), (theirs, "theirs.zip", "mine.zip")):
        chosen(page, seen)
        rested(page)
        page.get_by_role("combobox", name="Study").click()
        expect(page.get_by_role("option", name=seen)).to_be_visible()
        expect(page.get_by_role("option", name=hidden)).to_have_count(0)
        page.keyboard.press("Escape")
    entry = parse_qs(urlsplit(mine.url).query)["study"][0]
    stranger = visit(quick, "Import a log")
    for query in (
        f"study={entry}",
        f"study={entry}&w={workspace_of(theirs)}",
        f"study={entry}&w=../../etc/passwd",
    ):
        stranger.goto(f"{quick}?{query}", wait_until="commit")
        expect(stranger.get_by_text("is not in this workspace")).to_be_visible(timeout=PATIENCE_MS)
        chosen(stranger, "paper")
        rested(stranger)
        expect(stranger.get_by_text("mine.zip")).to_have_count(0)
    stranger.goto(mine.url.replace("/Import_a_log", "/"), wait_until="commit")
    finished(stranger, studies[1].name)
    chosen(stranger, "mine.zip")


@once_more
def test_recent_studies_are_renamed_and_deleted(
    server: Server, studies: dict[int, Study], visit: Visit
) -> None:
    page = visit(server.address, studies[2].name)
    upload(page, studies[1], "one.zip")
    upload(page, studies[3], "three.zip")
    page.get_by_text("Recent studies (2)").click()
    page.get_by_role("button", name="one.zip", exact=True).click()
    finished(page, studies[1].name)
    chosen(page, "one.zip")
    page.get_by_role("button", name="Edit").last.click()
    page.get_by_role("textbox", name="Name").fill("axis 1, worn *gear*")
    page.keyboard.press("Enter")
    chosen(page, "axis 1, worn *gear*")
    page.reload(wait_until="commit")
    finished(page, studies[1].name)
    chosen(page, "axis 1, worn *gear*")
    page.get_by_text("Recent studies (2)").click()
    page.get_by_role("button", name="Edit").last.click()
    page.get_by_role("button", name="Delete").click()
    finished(page, studies[2].name)
    chosen(page, "paper")
    expect(page.get_by_text("Recent studies (1)")).to_be_visible()
    page.reload(wait_until="commit")
    finished(page, studies[2].name)
    expect(page.get_by_text("Recent studies (1)")).to_be_visible()


@once_more
def test_a_damaged_study_is_told_and_the_app_goes_on(
    server: Server, studies: dict[int, Study], visit: Visit
) -> None:
    before = set(server.data.rglob("*.data"))
    page = visit(server.address, studies[2].name)
    upload(page, studies[1], "mine.zip")
    server.kill()
    (file,) = set(server.data.rglob("*.data")) - before
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 1
    file.write_bytes(data)
    server.start()
    page.reload(wait_until="commit")
    expect(page.get_by_text('kept copy of "mine.zip" is damaged')).to_be_visible(timeout=PATIENCE_MS)
    page.reload(wait_until="commit")
    finished(page, studies[2].name)
    expect(page.get_by_text("mine.zip was damaged")).to_be_visible()
    page.get_by_role("button", name="Noted").click()
    expect(page.get_by_text("mine.zip was damaged")).to_have_count(0)
    assert (server.data / "damaged" / file.name).read_bytes() == data
