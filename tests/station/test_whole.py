"""The whole of it: browser, station, link, loop, gate, robot, each a process of its own."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from mcap.reader import make_reader
from playwright.sync_api import BrowserContext, Page, expect

from cohelm.drive.beside import Beside
from cohelm.drive.served import Door
from cohelm.link import keys
from cohelm.link.keys import Keys
from cohelm.station.linked import Linked
from cohelm.station.serve import Server
from tests.station.conftest import STALE
from tests.station.servers import served
from tests.station.test_driving import drive, given, release, who

pytestmark = pytest.mark.xdist_group("browser")
PATIENT = 20_000
"""A robot that shares its computer with tests is late now and then [ms]."""


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Beside, Keys]]:
    of_robot, of_station = keys.pair_here()
    door = Door(of_robot, "127.0.0.1", 0, tmp_path_factory.mktemp("records"))
    with Beside("lab-avoid", False, door, watchdog=5.0) as made:
        yield made, of_station


@pytest.fixture(scope="module")
def server(robot: tuple[Beside, Keys]) -> Iterator[Server]:
    made, own = robot
    with served(stale=STALE, connect=lambda _: Linked(own, made.host, made.port)) as server:
        yield server


def test_a_person_takes_over_drives_and_lets_go(page: Page) -> None:
    expect(page.get_by_role("row", name="link", exact=False).first).to_be_visible()
    drive(page)
    page.keyboard.down("ArrowLeft")
    expect(given(page)).not_to_contain_text("0.00 rad/s", timeout=PATIENT)
    page.keyboard.up("ArrowLeft")
    expect(given(page)).to_contain_text("0.00 rad/s", timeout=PATIENT)
    page.keyboard.press("Space")
    expect(page.locator(".stopped")).to_contain_text("stop")
    release(page)


def test_a_drive_on_a_way_of_ones_own_is_recorded_and_fetched(page: Page, tmp_path: Path) -> None:
    drive(page, "Hold")
    page.get_by_role("button", name="● Record").click()
    expect(page.get_by_role("button", name="Stop recording")).to_be_visible(timeout=PATIENT)
    page.get_by_role("button", name="Edit way").click()
    panel = page.get_by_role("dialog", name="Edit the way")
    panel.get_by_role("button", name="Clear").click()
    panel.get_by_role("button", name="Add in the middle").click()
    for axis, value in (("x", "3"), ("y", "3")):  # in the wall
        panel.get_by_label(f"Way-point 1, {axis} in metres").fill(value)
        panel.get_by_label(f"Way-point 1, {axis} in metres").press("Enter")
    expect(panel.get_by_role("status")).to_contain_text("Refused", timeout=PATIENT)
    for axis, value in (("x", "4"), ("y", "-2")):
        panel.get_by_label(f"Way-point 1, {axis} in metres").fill(value)
        panel.get_by_label(f"Way-point 1, {axis} in metres").press("Enter")
    expect(panel.get_by_role("status")).to_contain_text("can go this way", timeout=PATIENT)
    panel.get_by_role("button", name="Send").click()
    expect(panel.get_by_role("status")).to_contain_text("took the new way", timeout=PATIENT)
    panel.get_by_role("button", name="Close").click()
    page.get_by_role("radio", name="Auto").click()
    expect(given(page)).not_to_contain_text("0.00 m/s", timeout=PATIENT)
    page.get_by_role("radio", name="Hold").click()
    page.get_by_role("button", name="Stop recording").click()
    records = page.get_by_role("button", name="Records (1)")
    expect(records).to_be_visible(timeout=6 * PATIENT)
    records.click()
    with page.expect_download() as download:
        page.get_by_role("list", name="Records on the robot").get_by_role("link").click()
    file = tmp_path / "record.mcap"
    download.value.save_as(file)
    with file.open("rb") as stream:
        topics = {channel.topic for _, channel, _ in make_reader(stream).iter_messages()}
    assert {"/odom", "/scan", "/period"} <= topics
    release(page)


def test_the_robot_stops_when_its_station_dies_in_the_middle_of_a_drive(
    robot: tuple[Beside, Keys], context: BrowserContext
) -> None:
    made, own = robot
    with served(stale=STALE, connect=lambda _: Linked(own, made.host, made.port)) as first:
        page = context.new_page()
        page.goto(first.address)
        drive(page)
        page.keyboard.down("ArrowLeft")
        expect(given(page)).not_to_contain_text("0.00 rad/s", timeout=PATIENT)
        port = first.port
    with served(
        stale=STALE, connect=lambda _: Linked(own, made.host, made.port), port=port
    ) as second:
        assert second.port == port
        expect(page.locator(".stopped")).to_be_visible(timeout=PATIENT)
        expect(page.locator(".stopped")).to_contain_text("stick is lost")
        expect(given(page)).to_contain_text("0.00 rad/s", timeout=PATIENT)
        expect(who(page)).to_contain_text("Nobody drives", timeout=PATIENT)
