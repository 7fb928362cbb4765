"""The HTML report on a phone: tables and wide figures scroll within themselves, the page does not."""

from __future__ import annotations

import pytest
from playwright.sync_api import Browser

from jointid import Study, analyse
from jointid.reporting.report import make_report, to_html

pytestmark = pytest.mark.browser

PHONE = 390
LINES = """cells => cells.map(cell => {
  const range = document.createRange(); range.selectNodeContents(cell);
  return new Set([...range.getClientRects()].map(box => Math.round(box.top))).size;
})"""


@pytest.fixture(scope="module")
def html(studies: dict[int, Study]) -> str:
    return to_html(make_report(analyse(studies[2]), cut=False))


@pytest.mark.parametrize("width", [320, 390, 1440])
def test_nothing_overflows_and_no_number_breaks(browser: Browser, html: str, width: int) -> None:
    page = browser.new_page(viewport={"width": width, "height": 844})
    page.set_content(html)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert set(page.locator("table:not(.names) td").evaluate_all(LINES)) <= {0, 1}
    right = page.locator("p, figcaption, .answer td").evaluate_all(
        "all => Math.max(...all.map(e => e.getBoundingClientRect().right))"
    )
    assert right <= width
    page.close()


def test_the_phone_shows_the_whole_answer_and_keeps_the_names_of_rows(
    browser: Browser, html: str
) -> None:
    page = browser.new_page(viewport={"width": PHONE, "height": 844})
    page.set_content(html)
    answer = page.locator(".answer tbody")
    for cell in answer.locator("td").all():
        box = cell.bounding_box()
        assert box is not None
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= PHONE
    scroller = page.locator(".scroll", has_text="records").last
    name = scroller.locator("tbody th").first
    scroller.evaluate("e => e.scrollTo(e.scrollWidth, 0)")
    box, place = name.bounding_box(), scroller.bounding_box()
    assert box is not None
    assert place is not None
    assert box["x"] == pytest.approx(place["x"], abs=1)
    page.close()
