"""A whole drive: browser, station, link, loop, gate, recorder, replay."""

from pathlib import Path

import pytest
from playwright.sync_api import BrowserContext, Page, expect

from cohelm.drive.playback import Playback
from cohelm.drive.replayed import Replaying
from cohelm.record.messages import messages
from tests.station.person import (
    LEFT,
    SOON,
    STILL,
    choose,
    drive,
    given,
    page_of,
    press,
    release,
    stopped,
    until,
    who,
)
from tests.station.servers import Robot, served

pytestmark = pytest.mark.xdist_group("realtime")
RECORDED = 150_000
"""A recorder that starts slowly on a busy machine also ends slowly [ms]."""


def new_way(page: Page, *points: tuple[str, str]) -> None:
    """Type the waypoints, have them checked, and send them."""
    page.get_by_role("button", name="Edit route").click()
    panel = page.get_by_role("dialog", name="Edit the route")
    panel.get_by_role("button", name="Clear").click()
    for i, point in enumerate(points, 1):
        panel.get_by_role("button", name="Add in the middle").click()
        for axis, value in zip("xy", point, strict=True):
            panel.get_by_label(f"Waypoint {i}, {axis} in metres").fill(value)
            panel.get_by_label(f"Waypoint {i}, {axis} in metres").press("Enter")
    status = panel.get_by_role("status")
    expect(status).to_contain_text("can follow this route")
    until(
        lambda: expect(status).to_contain_text("accepted the new route", timeout=SOON),
        press(page, "Send"),
    )
    panel.get_by_role("button", name="Close").click()


def record_on(page: Page, on: bool) -> None:
    button = page.get_by_role("button", name="Stop recording")
    seen = expect(button)
    until(
        lambda: seen.to_be_visible(timeout=SOON) if on else seen.to_be_hidden(timeout=SOON),
        press(page, "● Record" if on else "Stop recording"),
    )


def test_a_drive_is_recorded_downloaded_and_replayed(
    page: Page, context: BrowserContext, tmp_path: Path
) -> None:
    drive(page, "Hold")
    record_on(page, True)
    new_way(page, ("2", "0.5"), ("3", "-2"))
    choose(page, "Shared")
    expect(given(page)).not_to_contain_text("0.00 m/s")
    page.keyboard.down("ArrowLeft")
    share = page.get_by_role("meter", name="Operator's share of the command")
    expect(share).not_to_have_attribute("aria-valuenow", "0")
    page.keyboard.up("ArrowLeft")
    page.keyboard.press("Space")
    expect(stopped(page)).to_contain_text("stop by")
    record_on(page, False)
    records = page.get_by_role("button", name="Records (1)")
    expect(records).to_be_visible(timeout=RECORDED)
    records.click()
    with page.expect_download() as download:
        page.get_by_role("list", name="Records on the robot").get_by_role("link").click()
    file = tmp_path / "record.mcap"
    download.value.save_as(file)
    release(page)
    shown = Playback(file)
    rows = [m for _, _, m in messages(file, ("/period",))]
    led = min((m for m in rows if m.authority_x < 1.0), key=lambda m: m.authority_x).t
    with served(lambda _: Replaying(shown)) as cinema:
        replay = page_of(context, cinema)
        bar = replay.get_by_role("contentinfo", name="Replay")
        bar.get_by_role("button", name="Pause").click()
        place = bar.get_by_role("slider", name="Position in the record, seconds")
        head = replay.get_by_role("group", name="Replay of a record")
        place.fill(f"{led - shown.start + 0.005:.2f}")
        expect(replay.get_by_role("meter")).not_to_have_attribute("aria-valuenow", "0")
        expect(head).to_contain_text("mode: Shared")
        expect(head).to_contain_text("drives")
        place.fill(f"{shown.duration:.2f}")
        expect(stopped(replay)).to_contain_text("stop by")
        expect(replay.get_by_label("Alarms", exact=True)).to_contain_text("stop by")
        place.fill("0.1")
        expect(stopped(replay)).to_be_hidden()
        expect(replay.get_by_role("button", name="Stop the robot")).to_be_hidden()


@pytest.mark.slow
def test_the_robot_stops_when_its_station_dies_in_the_middle_of_a_drive(
    robot: Robot, context: BrowserContext
) -> None:
    with served(robot.connect) as first:
        page = page_of(context, first)
        drive(page)
        page.keyboard.down("ArrowLeft")
        expect(given(page)).to_contain_text(LEFT)
        port = first.port
    with served(robot.connect, port=port) as second:
        assert second.port == port
        page.goto(second.address)  # another station is another token
        expect(stopped(page)).to_contain_text("is lost:")
        expect(given(page)).to_contain_text(STILL)
        expect(who(page)).to_contain_text("No driver")
