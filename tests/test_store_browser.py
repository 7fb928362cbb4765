"""Stored studies survive a refresh, a closed tab and kill -9, and open by their links.

Who lacks the address sees nothing: ``test_workspace.py``, ``test_sessions_browser.py``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from urllib.parse import parse_qs, urlsplit

import pytest
from browsing import (
    Server,
    choose,
    drop_study,
    finished,
    follow,
    heard,
    new_page,
    open_file,
)
from playwright.sync_api import BrowserContext, Page, expect

from jointid import Study
from jointid.files.study_files import pack_study

pytestmark = pytest.mark.browser

Visit = Callable[[str, str], Page]


@pytest.fixture(scope="module")
def server(new_server: Callable[[], Server]) -> Iterator[Server]:
    """A server for the tests of this file: each has a workspace of its own."""
    server = new_server()
    yield server
    server.kill()


@pytest.fixture
def visit(context: BrowserContext) -> Iterator[Visit]:
    """Open an address in a tab of its own, and wait for the title; nothing is known but the address."""
    pages = []

    def open_address(address: str, title: str) -> Page:
        page = new_page(context)
        pages.append(page)
        page.goto(address, wait_until="commit")
        finished(page, title)
        return page

    yield open_address
    for page in pages:
        page.close()


def chosen(page: Page, name: str) -> None:
    expect(page.get_by_role("combobox", name="Study")).to_have_value(name)


def estimator(page: Page, name: str) -> None:
    expect(page.get_by_role("combobox", name="Estimator")).to_have_value(name)


def workspace_of(page: Page) -> str:
    expect(page).to_have_url(re.compile(r"[?&]w=[\w-]{32}(&|$)"))
    return parse_qs(urlsplit(page.url).query)["w"][0]


def reload(page: Page, title: str) -> None:
    page.reload(wait_until="commit")
    finished(page, title)


def test_a_study_survives_refresh_links_kill_and_a_closed_tab(
    server: Server, studies: dict[int, Study], visit: Visit, context: BrowserContext
) -> None:
    page = visit(f"{server.address}/Records", "Records")
    assert "w=" not in page.url
    open_file(page, "bad.zip", b"no archive")
    expect(page.get_by_text("bad.zip was not opened")).to_be_visible()
    chosen(page, studies[2].name)
    open_file(page, "mine.zip", pack_study(studies[1]))
    place = workspace_of(page)
    reload(page, "Records")
    chosen(page, "mine.zip")
    expect(page.locator(".js-plotly-plot")).to_have_count(1)
    for name, title in (("Study", studies[1].name), ("Simulate a robot", "Simulate a robot")):
        follow(page, name, title)
        chosen(page, "mine.zip")
        assert workspace_of(page) == place
    for title in (studies[1].name, "Records"):
        page.go_back()  # one step for each page
        finished(page, title)
        chosen(page, "mine.zip")
    follow(page, "Simulate a robot", "Simulate a robot")
    damping = page.get_by_role("textbox", name="Damping D (N·m·s/rad)")
    damping.fill("0.2, 0.03")
    damping.press("Enter")
    expect(page).to_have_url(re.compile("sim_D="))
    follow(page, "Records", "Records")
    page.go_back()
    expect(damping).to_have_value("0.2, 0.03")
    choose(page, "Estimator", "least-squares")
    for name in ("Records", "Simulate a robot"):  # a link keeps it in the address
        follow(page, name, name)
        expect(page).to_have_url(re.compile("estimator=least-squares"))
        reload(page, name)
        estimator(page, "least-squares")
    address = page.url.replace("/Simulate", "/Elasticity")
    server.kill()
    page.evaluate("localStorage.clear(), sessionStorage.clear()")  # elsewhere nothing is known
    page.close()
    context.clear_cookies()
    server.start()
    again = visit(address, "Elasticity")
    chosen(again, "mine.zip")
    expect(again.get_by_test_id("stMetric")).to_have_count(2)
    expect(again.locator(".js-plotly-plot .main-svg").first).to_be_visible()
    estimator(again, "least-squares")
    expect(again.get_by_text("Estimator: least-squares")).to_be_visible()


def test_a_study_that_was_being_read_when_somebody_went_elsewhere_is_there(
    server: Server, studies: dict[int, Study], visit: Visit
) -> None:
    page = visit(f"{server.address}/Import_a_log", "Import a log")
    record = studies[1].records[0]
    many = [replace(record, label=str(k)) for k in range(100)]  # reading them takes a while
    with heard(page):
        drop_study(page, "long.zip", pack_study(replace(studies[1], records=many)))
    follow(page, "Simulate a robot", "Simulate a robot")
    chosen(page, "long.zip")


def test_the_bare_address_offers_the_last_workspace(
    server: Server, studies: dict[int, Study], visit: Visit
) -> None:
    quick = f"{server.address}/Import_a_log"
    first = visit(quick, "Import a log")
    open_file(first, "mine.zip", pack_study(studies[1]))
    place = workspace_of(first)
    again = visit(quick, "Import a log")
    way_back = again.get_by_role("link", name="Continue where you left off")
    expect(way_back).to_have_count(1)
    again.set_viewport_size({"width": 390, "height": 844})  # with its sidebar folded away
    expect(again.get_by_test_id("stMain").get_by_text("Continue where you left off")).to_be_visible()
    again.set_viewport_size({"width": 1280, "height": 800})
    way_back.click()
    finished(again, "Import a log")
    chosen(again, "mine.zip")
    assert workspace_of(again) == place
    expect(again.get_by_role("link", name="Continue where you left off")).to_be_hidden()
