"""A person drives in a browser."""

import pytest
from playwright.sync_api import Page, expect

pytestmark = pytest.mark.xdist_group("browser")


def test_take_over_drive_with_the_keyboard_and_let_go(page: Page) -> None:
    who = page.get_by_role("group", name="Who drives")
    expect(who).to_contain_text("Nobody drives")
    page.get_by_role("button", name="Take over").click()
    expect(who).to_contain_text("You drive")
    page.get_by_role("radio", name="Manual").click()
    expect(page.get_by_role("radio", name="Manual")).to_be_checked()
    given = page.get_by_role("row", name="given")
    page.keyboard.down("ArrowUp")
    expect(given).to_contain_text("0.25 m/s")
    page.keyboard.up("ArrowUp")
    expect(given).to_contain_text("0.00 m/s")
    page.get_by_role("button", name="Release").click()
    expect(who).to_contain_text("Nobody drives")
