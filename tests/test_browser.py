"""The app in a browser: behaviour that needs one."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from browsing import (
    Server,
    answered,
    choose,
    finished,
    follow,
    heard,
    open_file,
    too_wide,
)
from playwright.sync_api import Page, ViewportSize, expect
from sessions import Session
from test_fleet_page import fleet

from jointid import Study
from jointid.files.digest import study_digest
from jointid.files.study_files import pack_study
from jointid.fleet.row import Row
from jointid.fleet.table import to_parquet

pytestmark = pytest.mark.browser

PAGES = {
    "": "Test cell with 2 joint(s)",
    "Records": "Records",
    "Phasors": "Phasors",
    "Transfer_matrix": "Transfer matrix",
    "Elasticity": "Elasticity",
    "Cut": "Cut",
    "Plan": "Plan",
    "Report": "Report and export",
    "Simulate": "Simulate a robot",
    "Import_a_log": "Import a log",
    "Fleet": "Fleet",
    "Compare": "Compare",
    "Glossary": "Glossary",
}
PHONE: ViewportSize = {"width": 390, "height": 844}
GO = "path => { history.pushState({}, '', '/' + path); dispatchEvent(new PopStateEvent('popstate')); }"
"""Go to a page as the Back button does, without loading it again."""
MEASURED_COLOUR = (
    "document.querySelector('.js-plotly-plot').data.find(t => t.name === 'measured').marker.color"
)


def figures(page: Page, count: int) -> None:
    expect(page.locator(".js-plotly-plot .main-svg").first).to_be_visible()
    expect(page.locator(".js-plotly-plot")).to_have_count(count)


def drawn(page: Page, count: int) -> None:
    """So many figures, none of them folded away."""
    figures(page, count)
    for figure in page.locator(".js-plotly-plot").all():
        expect(figure.locator(".main-svg").first).to_be_visible()


@pytest.mark.long
@pytest.mark.parametrize("path", [path for path in PAGES if path not in ("", "Report")])
def test_a_fresh_server_runs_every_page_first(server: Server, path: str) -> None:
    session = Session(server.address)
    elements = session.run(path)
    session.close()
    titles = [e.heading.body for e in elements if e.HasField("heading") and e.heading.tag == "h1"]
    assert titles == [PAGES[path]]
    assert not any(e.HasField("exception") for e in elements)


def test_a_fresh_server_opens_a_page_by_its_address(
    server: Server, open_in: Callable[..., Page]
) -> None:
    """The page that loads most modules."""
    page = open_in(f"{server.address}/Report")
    finished(page, PAGES["Report"])
    assert not page.get_by_text("Page not found").count()


def test_the_first_screen_shows_answer_and_figures_in_either_theme(
    address: str, open_in: Callable[..., Page]
) -> None:
    page = open_in(address, scheme="light")
    finished(page, PAGES[""])
    expect(page.get_by_test_id("stMetric")).to_have_count(4)
    figures(page, 2)
    assert page.evaluate(MEASURED_COLOUR) == "#000000"
    assert accessible(page) == []
    page.emulate_media(color_scheme="dark")
    page.reload(wait_until="commit")
    finished(page, PAGES[""])
    figures(page, 2)
    assert page.evaluate(MEASURED_COLOUR) == "#FFFFFF"
    assert accessible(page) == []
    tab_reaches_every_control(page)


def test_a_figure_is_saved_as_svg_and_as_its_numbers(address: str, open_in: Callable[..., Page]) -> None:
    page = open_in(f"{address}/Elasticity?study=paper&figure=Frequency+response")
    finished(page, "Elasticity")
    figures(page, 2)
    figure = page.locator(".js-plotly-plot").first
    figure.hover()
    saved = {}
    for kind in ("SVG", "CSV"):
        with page.expect_download() as download:
            figure.get_by_role("button", name=f"Save the figure as {kind}").click()
        assert download.value.suggested_filename.endswith(f".{kind.lower()}")
        saved[kind] = Path(download.value.path()).read_text("utf-8")
    assert ElementTree.fromstring(saved["SVG"]).tag == "{http://www.w3.org/2000/svg}svg"
    assert "Frequency (Hz)" in saved["SVG"]
    rows = list(csv.DictReader(saved["CSV"].splitlines()))
    measured = [row for row in rows if row["curve"].startswith("measured")]
    assert {row["y quantity"] for row in measured} == {"Magnitude (1/(kg·m²))", "Phase (°)"}
    assert [float(row["x"]) for row in measured[:6]] == pytest.approx([3, 7, 11, 17, 23, 29])
    assert all(float(row["standard error"]) > 0 for row in measured)


def test_a_form_is_filled_by_keys_and_a_long_simulation_can_be_stopped(
    address: str, open_in: Callable[..., Page]
) -> None:
    page = open_in(f"{address}/Simulate")
    finished(page, PAGES["Simulate"])
    tab_reaches_every_control(page)
    page.get_by_label("Length of a record (s)").fill("25")
    page.get_by_label("Frequencies", exact=True).fill("50")
    page.get_by_role("button", name="Simulate", exact=True).click()
    expect(page.get_by_text("Simulating 100 records")).to_be_visible()
    page.get_by_test_id("stButton").get_by_role("button", name="Stop", exact=True).click()
    expect(page.get_by_text("Simulating 100 records")).to_have_count(0)
    finished(page, PAGES["Simulate"])
    expect(page.get_by_role("combobox", name="Study")).to_have_value(PAGES[""])


HINT_BELOW = """() => {
  const icon = document.querySelector("[data-testid=stMain] p [data-testid=stTooltipIcon]");
  const text = document.createRange();
  text.selectNodeContents([...icon.closest("p").childNodes].find(n => n.nodeType === Node.TEXT_NODE));
  return icon.getBoundingClientRect().top - [...text.getClientRects()].pop().bottom;
}"""
"""Pixels from the last line of a text to the sign of its hint below it; negative on the same line."""


def test_nothing_is_wider_than_a_phone(address: str, open_in: Callable[..., Page]) -> None:
    page = open_in(address, **PHONE)
    page.emulate_media(reduced_motion="reduce")
    finished(page, PAGES[""])
    assert too_wide(page) <= 0
    for path, title in PAGES.items():
        if path:
            with heard(page):
                page.evaluate(GO, path)
            finished(page, title)
            assert too_wide(page) <= 0, title
            if path not in ("Cut", "Glossary"):
                assert page.evaluate(HINT_BELOW) < 0, title
    with heard(page):
        page.evaluate(GO, "Elasticity?details=Estimators")
    finished(page, "Elasticity")
    expect(page.get_by_role("columnheader", name="explicit")).to_be_visible()
    expect(page.locator("table.stacked")).to_have_count(0)  # it would have 30 lines
    expect(page.locator("table.small")).to_have_count(1)
    name = page.get_by_test_id("stTable").first.locator("td p").first
    name.evaluate("name => { name.textContent = 'a model with many words '.repeat(8); }")
    expect(page.locator("table.stacked")).to_have_count(1)  # no tower of single words
    page.get_by_test_id("stExpandSidebarButton").click()
    side = page.get_by_test_id("stSidebar")
    side.get_by_role("link", name="Records").click()
    finished(page, "Records")
    expect(side).not_to_be_in_viewport()  # it would cover the page
    page.wait_for_function("!Object.keys(localStorage).some((key) => key.includes('SidebarCollapsed'))")
    page.get_by_test_id("stExpandSidebarButton").click()
    expect(side).to_be_in_viewport()
    page.reload()
    finished(page, "Records")
    expect(side).not_to_be_in_viewport()


def fleet_with(study: Study) -> tuple[list[Row], int]:
    """Results of some thirty studies, of which this one stands out, and its place among them."""
    rows = fleet()
    (odd,) = (k for k, row in enumerate(rows) if row.robot == "odd")
    rows[odd] = replace(rows[odd], digest=study_digest(study))
    return rows, odd


def test_the_study_that_stands_out_in_a_fleet_opens_from_its_row(
    address: str, open_in: Callable[..., Page], studies: dict[int, Study]
) -> None:
    rows, odd = fleet_with(studies[1])
    page = open_in(f"{address}/Import_a_log")
    finished(page, "Import a log")
    open_file(page, "odd.zip", pack_study(studies[1]))
    choose(page, "Study", PAGES[""])
    follow(page, "Fleet", "Fleet")
    uploader = page.get_by_test_id("stMain").locator("input[type=file]")
    file = {"name": "results.parquet", "mimeType": "", "buffer": to_parquet(rows)}
    with answered(page):
        uploader.set_input_files(file)
    expect(page.get_by_text(f"{len(rows)} studies")).not_to_have_count(0)
    drawn(page, 4)  # spread and drift, of K and of D
    assert page.locator(".js-plotly-plot .main-svg .scatterlayer .point").count() > 30
    choose(page, "Study to show", f"{odd + 1}: odd/{odd}.zip")
    page.get_by_role("button", name="Open this study").click()
    finished(page, studies[1].name)
    expect(page.get_by_role("combobox", name="Study")).to_have_value("odd.zip")
    follow(page, "Fleet", "Fleet")
    page.set_viewport_size(PHONE)
    page.reload(wait_until="commit")
    finished(page, "Fleet")
    drawn(page, 4)  # the results were kept at the address
    assert too_wide(page) <= 0
    for figure in page.locator(".js-plotly-plot").all():
        box = figure.bounding_box()
        assert box is not None
        assert 250 < box["width"] <= PHONE["width"]


AXE = (files("axe_playwright_python") / "axe.min.js").read_text("utf-8")
VIOLATIONS = """async () => {
  const found = await axe.run(document, {resultTypes: ["violations"]});
  return found.violations.map(v => v.id + ": " + v.nodes.map(n => n.html.slice(0, 160)).join(" | "));
}"""


def accessible(page: Page) -> list[str]:
    """Accessibility faults of the page and its open tabs, by the axe engine."""
    page.mouse.move(700, 2)  # off what explains itself under the mouse
    expect(page.locator("section[role=presentation][aria-label]")).to_have_count(0)
    expect(page.get_by_role("tooltip")).to_have_count(0)
    page.evaluate("() => document.fonts.ready")
    page.wait_for_timeout(300)  # then the regions that scroll are known
    page.evaluate(AXE)
    return list(page.evaluate(VIOLATIONS))


def failed(study: Study) -> Study:
    """The study with the torque of its last joint counted backwards."""
    backwards = np.array([1.0] * (study.inertia.n - 1) + [-1.0])
    return replace(study, records=[replace(r, tau_Nm=r.tau_Nm * backwards) for r in study.records])


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("path", [path for path in PAGES if path])
@pytest.mark.long
def test_axe_finds_nothing_on_any_page(
    address: str, open_in: Callable[..., Page], path: str, scheme: str
) -> None:
    """The first screen is checked once its figures are drawn."""
    page = open_in(f"{address}/{path}", scheme=scheme)
    finished(page, PAGES[path])
    assert accessible(page) == []


@pytest.mark.parametrize("path", ["", pytest.param("Elasticity", marks=pytest.mark.long)])
def test_axe_finds_nothing_on_a_study_that_is_not_usable(
    address: str, open_in: Callable[..., Page], studies: dict[int, Study], path: str
) -> None:
    page = open_in(f"{address}/Glossary", scheme="dark")
    finished(page, "Glossary")
    open_file(page, "failed.zip", pack_study(failed(studies[2])))
    follow(page, "Elasticity" if path else "Study", PAGES[path])
    expect(page.get_by_test_id("stMain").get_by_text("Not usable: The sign")).to_be_visible()
    assert accessible(page) == []


# What Tab should reach: in a group of which one is chosen, the others are reached by arrow keys.
TABBABLE = """() => {
  const all = document.querySelectorAll('a[href], button, input, textarea, summary');
  window.wanted = [...all].filter(e => e.checkVisibility({visibilityProperty: true}) && !e.disabled
    && e.tabIndex >= 0 && e.getClientRects().length && !e.closest('[data-testid=stElementToolbar]')
    && !e.closest('details:not([open]) > :not(summary)')
    && !(e.closest('[role=radiogroup]') && e.getAttribute('aria-checked') === 'false'));
  window.unmarked = [];
  return window.wanted.length;
}"""
FOCUSED = """() => {
  const e = document.activeElement, style = getComputedStyle(e);
  const framed = s => s.outlineStyle !== 'none' && parseFloat(s.outlineWidth) > 0;
  if (window.wanted.includes(e) && !framed(style)) window.unmarked.push(e.outerHTML.slice(0, 200));
  // What React has replaced meanwhile is no control any more.
  window.wanted = window.wanted.filter(other => other !== e && other.isConnected);
  return window.wanted.length;
}"""


def tab_reaches_every_control(page: Page) -> None:
    """Each shows where it is once it has the focus."""
    page.bring_to_front()
    for _ in range(4 * page.evaluate(TABBABLE)):
        page.keyboard.press("Tab")
        if page.evaluate(FOCUSED) == 0:
            break
    missed = "window.wanted.filter(e => e.isConnected).map(e => e.outerHTML.slice(0, 200))"
    assert page.evaluate(missed) == []
    assert page.evaluate("window.unmarked") == []


@pytest.mark.long
def test_tab_reaches_every_control_of_the_report(address: str, open_in: Callable[..., Page]) -> None:
    page = open_in(f"{address}/Report")
    finished(page, PAGES["Report"])
    tab_reaches_every_control(page)
