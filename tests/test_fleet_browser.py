"""A fleet in real Chromium: its figures are drawn, and the study that stands out opens from its row."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
from browsing import answered, choose, finished, follow, open_file, too_wide
from playwright.sync_api import Page, expect
from test_fleet_page import fleet

from jointid import Study
from jointid.digest import study_digest
from jointid.fleet.row import Row
from jointid.fleet.table import to_parquet
from jointid.study_files import pack_study

pytestmark = pytest.mark.browser

PHONE = {"width": 390, "height": 844}


def drawn(page: Page, count: int) -> None:
    figures = page.locator(".js-plotly-plot")
    expect(figures).to_have_count(count)
    for figure in figures.all():
        expect(figure.locator(".main-svg").first).to_be_visible()


def fleet_with(study: Study) -> tuple[list[Row], int]:
    """Results of some thirty studies, of which this one stands out, and its place among them."""
    rows = fleet()
    (odd,) = (k for k, row in enumerate(rows) if row.robot == "odd")
    rows[odd] = replace(rows[odd], digest=study_digest(study))
    return rows, odd


def test_the_study_that_stands_out_opens_from_its_row(
    address: str, open_in: Callable[..., Page], studies: dict[int, Study]
) -> None:
    rows, odd = fleet_with(studies[1])
    page = open_in(f"{address}/Import_a_log")
    finished(page, "Import a log")
    open_file(page, "odd.zip", pack_study(studies[1]))
    choose(page, "Study", "paper")
    follow(page, "Fleet", "Fleet")
    uploader = page.get_by_test_id("stMain").locator("input[type=file]")
    file = {"name": "results.parquet", "mimeType": "", "buffer": to_parquet(rows)}
    with answered(page):
        uploader.set_input_files(file)
    expect(page.get_by_text(f"{len(rows)} studies")).not_to_have_count(0)
    drawn(page, 4)  # spread and drift, of K and of D
    assert page.locator(".js-plotly-plot .main-svg .scatterlayer .point").count() > 30
    choose(page, "Study to look at", f"{odd + 1}: odd/{odd}.zip")
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
