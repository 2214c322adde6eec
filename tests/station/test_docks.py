"""Docks on the page: drawn, docking and undocking."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import BrowserContext, expect

from tests.station.person import choose, mode_button, page_of, release, take
from tests.station.servers import Robot, served

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("realtime")]


@pytest.fixture
def at_dock(tmp_path: Path) -> Iterator[Robot]:
    made = Robot("dock", False, tmp_path)
    yield made
    made.close()


def test_an_operator_docks_and_undocks_and_sees_the_route_back(
    at_dock: Robot, context: BrowserContext
) -> None:
    with served(at_dock.connect) as server:
        page = page_of(context, server)
        docks = page.get_by_role("group", name="Dock")
        dock = docks.get_by_role("button", name="Dock at charger")
        undock = docks.get_by_role("button", name="Undock")
        expect(dock).to_be_disabled()
        take(page)
        dock.click()
        expect(docks).to_contain_text("docking at charger")
        expect(docks).to_contain_text("docked at charger")
        undock.click()
        expect(docks).to_contain_text("undocking from charger")
        page.wait_for_timeout(3000)  # half the way
        choose(page, "Hold")
        expect(dock).to_be_enabled()
        expect(undock).to_be_enabled()
        undock.click()
        expect(undock).to_have_count(0)
        expect(dock).to_be_enabled()
        choose(page, "Auto")
        way = docks.get_by_role("button", name="Route to charger")
        way.click()
        expect(mode_button(page, "Auto", pressed=True)).to_be_visible()
        expect(dock).to_be_enabled()
        choose(page, "Hold")
        release(page)
