"""Clicks that a page which is just being drawn again may swallow."""

from __future__ import annotations

from playwright.sync_api import Page, TimeoutError, expect

TRIES = 8


def choose(page: Page, box: str, option: str) -> None:
    """Pick an option of a select box; a rerun of the page closes its list, so try again."""
    select = page.get_by_role("combobox", name=box)
    for _ in range(TRIES):
        select.click()
        try:
            page.get_by_role("option", name=option).click(timeout=4000)
        except TimeoutError:
            page.keyboard.press("Escape")
            continue
        break
    expect(select).to_have_value(option, timeout=20_000)
