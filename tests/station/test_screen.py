"""The page apart from driving: requests, dialogs, waypoints, replay."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, BrowserContext, Page, Route, expect

from cohelm.drive.playback import Playback
from cohelm.drive.replayed import Replaying
from cohelm.scenario import build, load
from cohelm.station import app
from cohelm.station.robot_link import StartingLink
from cohelm.station.serve import Server
from cohelm.study import single
from tests.station.person import (
    LEFT,
    RIGHT,
    SOON,
    STILL,
    alarms,
    drive,
    given,
    keep,
    lead,
    mode_button,
    page_of,
    press,
    release,
    request_control,
    stopped,
    until,
    who,
)  # fmt: skip
from tests.station.servers import served

pytestmark = pytest.mark.xdist_group("realtime")


def open_page(context: BrowserContext, server: Server) -> Page:
    page = page_of(context, server)
    page.get_by_role("group", name="Who drives").get_by_role("status").wait_for()
    return page


def test_while_the_robot_starts_the_page_reports_that_and_shows_no_unknown_values(
    context: BrowserContext,
) -> None:
    starting = "starting the robot in lab-guard (5 s)"
    with served(lambda _: StartingLink(lambda: None, lambda: starting)) as server:
        page = page_of(context, server)
        expect(alarms(page)).to_contain_text(f"Not connected to a robot yet: {starting}.")
        expect(page.get_by_label("Camera")).to_have_text("No picture yet.")
        rows = page.get_by_label("Link to the robot").locator("th").all_text_contents()
        assert rows[:3] == [
            "robot",
            "localization",
            "speed limit",
        ]  # a low screen has no room for all


@pytest.mark.slow
def test_a_second_browser_requests_control_and_the_driver_refuses_then_hands_over(
    page: Page, browser: Browser, server: Server
) -> None:
    drive(page)
    context = browser.new_context()
    other = open_page(context, server)
    expect(who(other)).to_contain_text("operator")
    expect(who(other)).to_contain_text("drives")
    keep(page, request_control(other, page))
    expect(other.get_by_role("button", name="Request control")).to_be_visible()
    request_control(other, page)
    until(
        lambda: expect(who(other)).to_contain_text("You drive", timeout=SOON),
        press(page, "Hand over"),
    )
    expect(page.get_by_role("button", name="Request control")).to_be_visible()
    # who watches may stop, but not choose a mode
    expect(mode_button(page, "Manual")).to_be_disabled()
    page.keyboard.press("Space")
    expect(stopped(other)).to_be_visible()
    release(other)
    context.close()


@pytest.mark.slow  # two pages and two reloads; whose lease it is, is tried without a browser too
def test_two_tabs_are_two_operators_and_a_reload_is_the_same_one(
    page: Page, context: BrowserContext, server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(app, "GRACE", 60.0)
    drive(page)
    second = open_page(context, server)
    expect(second.get_by_role("button", name="Request control")).to_be_visible()
    lead(page, "ArrowLeft", LEFT)
    page.goto("about:blank")  # a reload that takes its time
    expect(stopped(second)).to_contain_text("the stick is lost: no valid stick input")
    page.goto(server.address)
    expect(who(page)).to_contain_text("You drive")
    expect(given(page)).to_contain_text(STILL)
    expect(stopped(page)).to_contain_text("the stick is lost: no valid stick input")
    lead(page, "ArrowRight", RIGHT)  # the driver is back, and goes on
    page.reload()  # the browser's button, in the middle of a drive
    expect(who(page)).to_contain_text("You drive")
    expect(given(page)).to_contain_text(STILL)
    # as quick as that it is a dropout, and latches nothing (docs/loop.md); what was held is let go
    page.wait_for_timeout(600)
    expect(given(second)).to_contain_text(STILL)
    page.keyboard.up("ArrowRight")
    release(page)
    second.close()


@pytest.mark.slow
def test_waypoints_are_added_dragged_checked_and_sent(page: Page) -> None:
    drive(page, "Hold")
    page.get_by_role("button", name="Show all").click()
    page.get_by_role("button", name="Edit route").click()
    panel = page.get_by_role("dialog", name="Edit the route")
    panel.get_by_role("button", name="Clear").click()
    canvas = page.locator("#map")
    box = canvas.bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.click(x, y)
    page.mouse.click(x + 60, y)
    items = panel.get_by_role("listitem")
    expect(items).to_have_count(2)
    before = panel.get_by_label("Waypoint 2, y in metres").input_value()
    page.mouse.move(x + 60, y)
    page.mouse.down()
    page.mouse.move(x + 60, y + 30, steps=4)
    page.mouse.up()
    expect(panel.get_by_label("Waypoint 2, y in metres")).not_to_have_value(before)
    # into the wall between room and corridor
    panel.get_by_label("Waypoint 2, x in metres").fill("6.5")
    panel.get_by_label("Waypoint 2, y in metres").fill("3")
    panel.get_by_label("Waypoint 2, y in metres").press("Enter")
    expect(panel.get_by_role("status")).to_contain_text("Refused")
    expect(panel.locator("li.bad")).to_have_count(1)
    for name, value in (("1, x", "0"), ("1, y", "-0.75"), ("2, x", "3"), ("2, y", "-2")):
        panel.get_by_label(f"Waypoint {name} in metres").fill(value)
        panel.get_by_label(f"Waypoint {name} in metres").press("Enter")
    expect(panel.get_by_role("status")).to_contain_text("can follow this route")
    panel.get_by_role("button", name="Send").click()
    expect(panel.get_by_role("status")).to_contain_text("accepted the new route")
    panel.get_by_role("button", name="Close").click()
    release(page)


@pytest.mark.slow  # nothing moves wrongly by it
def test_escape_closes_a_dialog_that_has_just_opened(
    context: BrowserContext, server: Server
) -> None:
    page = open_page(context, server)
    page.evaluate(
        """() => new Promise(done => {
            new MutationObserver((_, watching) => {
                if (!document.querySelector('[role=dialog]')) return
                watching.disconnect()
                dispatchEvent(new KeyboardEvent('keydown', { key: 'Escape' }))
                done()
            }).observe(document.body, { childList: true, subtree: true })
            const named = b => (b.ariaLabel || b.textContent).includes('Stick settings')
            ;[...document.querySelectorAll('button')].find(named).click()
        })"""
    )
    expect(page.get_by_role("dialog")).to_have_count(0)


def test_everything_has_an_accessible_name_and_nothing_is_loaded_from_another_origin(
    context: BrowserContext, server: Server
) -> None:
    asked: list[str] = []
    context.route("**/*", lambda route: _noted(route, asked))
    page = open_page(context, server)
    drive(page)
    page.get_by_role("button", name="Edit route").click()
    page.get_by_role("button", name="Stick settings").click()
    nameless = page.evaluate(
        """() => [...document.querySelectorAll('button, input, select, canvas, [role=slider]')]
        .filter(e => !e.parentElement.closest('[role=img]'))
        .filter(e => !(e.ariaLabel || e.textContent.trim() || e.closest('label')?.textContent))
        .map(e => e.outerHTML)"""
    )
    assert nameless == []
    for left in (1, 0):
        page.keyboard.press("Escape")
        expect(page.get_by_role("dialog")).to_have_count(left)
    release(page)
    assert asked
    assert all(url.startswith(f"{server.origin}/") for url in asked), asked


def _noted(route: Route, asked: list[str]) -> None:
    asked.append(route.request.url)
    route.continue_()


@pytest.mark.slow
def test_everything_is_reachable_with_the_keyboard(page: Page) -> None:
    expect(who(page)).to_contain_text("No driver")
    for _ in range(60):
        page.keyboard.press("Tab")
        if page.evaluate("document.activeElement.textContent") == "Take over":
            break
    until(
        lambda: expect(who(page)).to_contain_text("You drive", timeout=4_000),
        lambda: page.keyboard.press("Enter"),
    )
    reached = set()
    for _ in range(60):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.textContent.trim()"))
    assert {"Manual", "Release", "Edit route", "Stick settings", "● Record"} <= reached
    assert any(name.startswith("STOP") for name in reached)
    release(page)


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    single.recorded(build.setup(load.scenario("lab-shared")), folder, lambda what, share: None)
    return folder / single.RECORD


@pytest.fixture
def cinema(record: Path) -> Iterator[Server]:
    played = Playback(record)
    with served(lambda _: Replaying(played)) as server:
        yield server


@pytest.mark.slow  # test_whole shows a record too
def test_a_record_is_shown_with_a_timeline_at_any_speed(
    context: BrowserContext, cinema: Server
) -> None:
    page = page_of(context, cinema)
    bar = page.get_by_role("contentinfo", name="Replay")
    place = bar.get_by_role("slider", name="Position in the record, seconds")
    expect(place).to_be_visible()
    expect(page.get_by_role("button", name="Stop the robot")).to_be_hidden()
    bar.get_by_role("button", name="Pause").click()
    place.fill("44")
    expect(bar).to_contain_text("0:44")
    # the person leads there (Fig. 11)
    share = page.get_by_role("meter", name="Operator's share of the command")
    expect(share).not_to_have_attribute("aria-valuenow", "0")
    place.fill("20")
    expect(share).to_have_attribute("aria-valuenow", "0")
    bar.get_by_label("speed").select_option("16")
    bar.get_by_role("button", name="Play").click()
    expect(bar).to_contain_text("0:58")
    expect(bar.get_by_role("button", name="Play")).to_be_visible()  # at the end it stops


def test_the_size_of_the_pages_is_bounded() -> None:
    import gzip

    from cohelm.station.app import pages

    size = sum(
        len(gzip.compress(file.read_bytes()))
        for file in pages().rglob("*")
        if file.is_file() and not file.name.startswith(".")
    )
    assert size < 150_000, f"{size} bytes gzipped"


@pytest.mark.slow  # tests/cli/test_station.py starts it too
def test_the_station_as_a_command_prints_its_address_and_ends_quietly(record: Path) -> None:
    command = [sys.executable, "-m", "cohelm", "station", "--replay", str(record), "--port", "0"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline().startswith("http://127.0.0.1:")
        process.terminate()
        _, said = process.communicate(timeout=60)
    assert "Traceback" not in said
