"""The page's connection: a STOP is never lost, and a connection that hangs is made anew."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import BrowserContext, Page, expect

from cohelm.core.types import CENTRED, Pose
from cohelm.law.verdict import Verdict
from cohelm.link.bulk_messages import (
    Checked,
    DockPlace,
    Docks,
    HealthReport,
    Hello,
    LineKind,
    Polyline,
)
from cohelm.link.messages import (
    Alarm,
    AlarmKind,
    Answer,
    Arming,
    Command,
    Device,
    Discs,
    Localised,
    Mode,
    RequestKind,
    ScanPart,
    Severity,
)  # fmt: skip
from cohelm.link.robot_end import RobotEnd
from cohelm.link.station_end import StationEnd
from cohelm.station import app
from cohelm.station.serve import Server
from tests.few import first
from tests.link.ends import STATUS, until
from tests.station.bare import Bare
from tests.station.conftest import WAIT
from tests.station.person import (
    SOON,
    keep,
    mode_button,
    page_of,
    request_control,
    take,
    until as do_until,
    who,
)
from tests.station.servers import served

PAD = (Path(__file__).parent / "gamepad.js").read_text(encoding="utf-8")
HANGING = """(() => {
  const Real = WebSocket
  let first = true
  window.WebSocket = function (...options) {
    if (!first) return new Real(...options)
    first = false
    return { readyState: Real.CONNECTING, close() {} }
  }
  Object.assign(window.WebSocket, { CONNECTING: Real.CONNECTING, OPEN: Real.OPEN })
})()"""
"""A first connection that is neither made nor refused."""
FULL = """Object.defineProperty(WebSocket.prototype, 'bufferedAmount', { get: () => 1e6 })"""
"""More waits to be sent than a page adds to."""


@pytest.fixture
def station(bare: Bare) -> Iterator[Server]:
    with served(bare.connect) as made:
        yield made


def connected(page: Page) -> None:
    who(page).get_by_role("status").wait_for()


def requested(bare: Bare, what: RequestKind, within: float = WAIT / 1e3) -> bool:
    end = time.monotonic() + within
    while time.monotonic() < end:
        if what in bare.requests:
            return True
        time.sleep(0.02)
    return False


def test_space_stops_wherever_no_text_is_written_and_changes_nothing(
    context: BrowserContext, station: Server, bare: Bare
) -> None:
    page = page_of(context, station)
    connected(page)
    page.get_by_role("button", name="Stick settings").click()
    page.evaluate("document.querySelectorAll('input').forEach((one) => (one.disabled = false))")
    for field in ("Share of the full speed", "dead band", "stop button", "inverted", "device"):
        control = page.get_by_label(field).first
        before = control.evaluate("one => [one.value, one.checked]")
        bare.requests.clear()
        control.focus()
        page.keyboard.press("Space")
        assert requested(bare, RequestKind.STOP), field
        assert control.evaluate("one => [one.value, one.checked]") == before, field
    box, number = page.get_by_label("inverted").first, page.get_by_label("stop button")
    was = box.is_checked()
    box.press("Enter")
    assert box.is_checked() is not was
    before = number.input_value()
    number.press("ArrowUp")  # which means the robot
    assert number.input_value() == before
    assert not number.evaluate("one => one === document.activeElement")


def test_a_stop_passes_a_connection_that_is_full(
    context: BrowserContext, station: Server, bare: Bare
) -> None:
    page = page_of(context, station, FULL)
    connected(page)
    bare.requests.clear()
    page.keyboard.press("Space")
    assert requested(bare, RequestKind.STOP)


def without_a_station(context: BrowserContext, bare: Bare) -> tuple[Page, int]:
    """A page whose station has ended, and the port that it had."""
    with served(bare.connect) as station:
        page = page_of(context, station)
        connected(page)
    expect(page.get_by_role("alert", name="Alarms")).to_contain_text("No connection to the station")
    return page, station.port


def test_a_stop_without_a_connection_is_shown_and_sent_on_the_next(
    context: BrowserContext, bare: Bare
) -> None:
    page, port = without_a_station(context, bare)
    alarms = page.get_by_role("alert", name="Alarms")
    bare.requests.clear()
    page.keyboard.press("Space")
    expect(alarms).to_contain_text("STOP is not sent yet")
    with served(bare.connect, port=port) as again:
        login(page, again)
        assert requested(bare, RequestKind.STOP)
        expect(alarms).not_to_contain_text("STOP is not sent yet")


def login(page: Page, server: Server) -> None:
    """As if in another tab."""
    page.evaluate("""async (token) => {
        const answer = await fetch('./session', { method: 'POST', body: token })
        localStorage.setItem('cohelm.session', await answer.text())
    }""", server.token)  # fmt: skip
    page.evaluate(
        "dispatchEvent(new StorageEvent('storage', { key: 'cohelm.session', newValue: 'new' }))"
    )


@pytest.mark.parametrize("hours", first([0, 2]))
def test_a_stop_that_was_not_sent_survives_a_reload_but_not_for_hours(
    context: BrowserContext, bare: Bare, hours: int
) -> None:
    page, port = without_a_station(context, bare)
    alarms = page.get_by_role("alert", name="Alarms")
    page.keyboard.press("Space")
    expect(alarms).to_contain_text("STOP is not sent yet")
    page.evaluate(f"""sessionStorage.setItem(
        'cohelm.stop', String(Number(sessionStorage.getItem('cohelm.stop')) - 3.6e6 * {hours} - 5e3)
    )""")
    bare.requests.clear()
    with served(bare.connect, port=port) as again:
        page.reload()
        page.get_by_label("Token").wait_for()
        if hours == 0:
            expect(page.get_by_role("alert").last).to_contain_text("STOP is not sent yet")
        page.get_by_label("Token").fill(again.token)
        page.keyboard.press("Enter")
        connected(page)
        if hours:
            expect(alarms).to_contain_text("could not be sent and is now too old: press it again")
            assert RequestKind.STOP not in bare.requests
            page.keyboard.press("Space")
        else:
            expect(alarms).to_contain_text("was sent late")
        assert requested(bare, RequestKind.STOP)
        if hours:
            expect(page.get_by_label("Alarms", exact=True)).not_to_contain_text("too old")


@pytest.mark.slow  # that it is sent is tried above
def test_a_stop_that_is_sent_once_more_after_a_reload_is_not_said_to_have_had_no_connection(
    context: BrowserContext, tmp_path: Path
) -> None:
    with Bare(tmp_path) as robot, served(robot.connect) as server:
        page = page_of(context, server)
        connected(page)
        page.keyboard.press("Space")
        until(lambda: RequestKind.STOP in robot.requests)
        page.wait_for_timeout(2500)
        page.reload()
        alarms = page.get_by_label("Alarms", exact=True)
        expect(alarms).to_contain_text("after: the robot had not answered it before")


@pytest.mark.slow  # a layout of what is tried below
def test_a_stop_that_nobody_answered_is_in_sight_also_where_there_is_room_for_one_alarm(
    browser_phone: BrowserContext, tmp_path: Path
) -> None:
    with Bare(tmp_path) as robot, served(robot.connect) as server:
        page = page_of(browser_phone, server)
        page.set_viewport_size({"width": 740, "height": 330})
        connected(page)
        robot.die()
        alarms = page.get_by_label("Alarms", exact=True)
        expect(alarms).to_contain_text("No link to the robot")
        page.get_by_role("button", name="Stop the robot").tap()
        expect(alarms.locator("> .alarm")).to_contain_text("STOP is sent, but the robot has not")


def test_a_display_without_a_link_to_the_robot_is_pale(
    context: BrowserContext, tmp_path: Path
) -> None:
    with Bare(tmp_path) as robot, served(robot.connect) as server:
        robot.bulk.publish(
            Hello("sally", np.zeros((3, 2), np.float32), 2.0, 1.0, (np.nan,) * 4, False)  # type: ignore[arg-type]
        )
        page = page_of(context, server)
        connected(page)
        expect(page.get_by_role("row", name="robot").first).to_contain_text("sally")
        expect(page.locator(".station.stale")).to_have_count(0)
        robot.die()
        expect(page.get_by_label("Alarms", exact=True)).to_contain_text("No link to the robot")
        expect(page.locator(".station.stale")).to_have_count(1)
        page.keyboard.press("Space")
        alarms = page.get_by_label("Alarms", exact=True)
        expect(alarms).to_contain_text("STOP is sent, but the robot has not answered yet")


@pytest.mark.slow  # nothing moves wrongly by it
def test_before_the_first_status_there_is_no_link_to_be_lost(
    context: BrowserContext, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The robot's description comes by another way than its state, and may be there before."""
    monkeypatch.setattr(RobotEnd, "send_status", lambda *_: None)
    with Bare(tmp_path) as robot, served(robot.connect) as server:
        robot.bulk.publish(
            Hello("sally", np.zeros((3, 2), np.float32), 2.0, 1.0, (np.nan,) * 4, False)  # type: ignore[arg-type]
        )
        page = page_of(context, server)
        expect(page.get_by_role("row", name="robot").first).to_contain_text("sally")
        alarms = page.get_by_label("Alarms", exact=True)
        expect(alarms).to_contain_text("Not connected to a robot yet")
        expect(alarms).not_to_contain_text("stale")
        expect(page.locator(".station.stale")).to_have_count(0)


@pytest.mark.slow  # what is said then is tried below, too
def test_without_a_link_nobody_is_said_to_drive(context: BrowserContext, tmp_path: Path) -> None:
    status = STATUS._replace(localised=Localised.POOR)
    with Bare(tmp_path, status) as robot, served(robot.connect) as server:
        page = page_of(context, server)
        take(page)
        alarms = page.get_by_label("Alarms", exact=True)
        expect(alarms).to_contain_text("Localization is uncertain")
        expect(mode_button(page, "Shared", pressed=True)).to_be_visible()
        robot.die()
        expect(who(page)).to_contain_text("No link")
        expect(who(page)).not_to_contain_text("drive")
        expect(who(page).get_by_role("button")).to_have_count(0)
        expect(mode_button(page, "Shared", pressed=True)).to_have_count(0)
        expect(alarms).not_to_contain_text("uncertain")  # by now nobody knows
    with Bare(tmp_path) as robot:
        with served(robot.connect) as server:
            page = page_of(context, server)
            take(page)
        expect(who(page)).to_contain_text("No link")


@pytest.mark.slow  # what a page only tells
def test_a_link_that_breaks_takes_no_question_away_at_once_and_counts_no_seconds(
    context: BrowserContext, tmp_path: Path
) -> None:
    with Bare(tmp_path) as robot, served(robot.connect) as server:
        page, other = page_of(context, server), context.new_page()
        take(page)
        other.goto(server.address)
        question = request_control(other, page)
        expect(question).to_contain_text(re.compile(r"\(\d+ s\)"))
        expect(who(page)).to_contain_text("2 connected, you are operator 1")
        expect(who(other)).to_contain_text("2 connected, you are operator 2")
        robot.die()
        expect(who(page)).to_contain_text("No link")
        expect(question).to_contain_text("operator 2 requests control")
        expect(question).not_to_contain_text(" s)")
        expect(question).to_be_hidden()  # nobody knows any more whether it is asked


@pytest.mark.slow  # nothing moves wrongly by it
def test_who_can_not_reset_a_stop_is_told_who_can(context: BrowserContext, tmp_path: Path) -> None:
    status = STATUS._replace(mode=Mode.HOLD, stopped="the odometry is 92 ms old", why="")
    with Bare(tmp_path, status) as robot, served(robot.connect) as server:
        page, other = page_of(context, server), context.new_page()
        reset = page.get_by_role("button", name="Reset")
        expect(reset).to_be_disabled()
        expect(reset).to_have_accessible_description("Take over first")
        expect(page.locator(".why")).to_have_text("stopped: press Take over, then Reset")
        other.goto(server.address)
        take(other)
        expect(reset).to_have_accessible_description("by the driver")
        expect(page.locator(".why")).to_have_text("stopped: its driver can reset it")
        expect(other.get_by_role("button", name="Reset")).to_have_accessible_description("")
        expect(other.locator(".why")).to_have_text("stopped: press Reset, then choose a mode")
        page.set_viewport_size({"width": 740, "height": 330})  # a phone held sideways
        alarm = Alarm(1, Severity.ALARM, True, False, "the odometry is 92 ms old")
        robot.status = status._replace(alarms=(alarm,))
        expect(page.get_by_role("button", name="Acknowledge")).to_be_visible()
        why = page.locator(".why").bounding_box()
        assert why is not None
        assert why["y"] + why["height"] <= 330 - 6
        page.set_viewport_size({"width": 1280, "height": 800})
        robot.die()
        expect(page.locator(".why")).to_have_text("stopped")  # nobody knows what to do next
        expect(reset).to_have_accessible_description("")
        other.set_viewport_size({"width": 740, "height": 330})  # a phone held sideways
        assert other.locator(".stopped span").evaluate(
            "(e) => e.scrollWidth <= e.clientWidth && e.scrollHeight <= e.clientHeight"
        )


CHANGES = """() => {
  window.changes = { eyes: 0, ears: 0 }
  const eyes = document.querySelector('.why')
  const ears = document.querySelector('.facts [role=status]')
  const watch = (node, who) => new MutationObserver(() => (changes[who] += 1))
    .observe(node, { childList: true, characterData: true, subtree: true })
  watch(eyes, 'eyes')
  watch(ears, 'ears')
}"""


@pytest.mark.slow  # it is shown for 4 s
def test_the_line_that_says_why_can_be_read_and_heard_where_it_goes_to_and_fro(
    context: BrowserContext, tmp_path: Path
) -> None:
    """As a drive along a wall does: 56 changes in 15 s were counted in one."""
    shaped = STATUS._replace(why="")
    verdicts = (Verdict.SHAPED, Verdict.BRAKING, Verdict.UNTOUCHED)
    with Bare(tmp_path, shaped) as robot, served(robot.connect) as server:
        page = page_of(context, server)
        line = page.locator(".why")
        expect(line).to_have_text("limited: obstacle near")
        page.evaluate(CHANGES)
        began = time.monotonic()
        for turn in range(40):
            applied = shaped.nominal if turn % 3 == 2 else shaped.applied
            robot.status = shaped._replace(verdict=verdicts[turn % 3], applied=applied)
            page.wait_for_timeout(100)
        seen = page.evaluate("window.changes")
        longer = max((time.monotonic() - began) / 5.0, 1.0)  # on a busy machine
        assert seen["eyes"] <= 3 * longer, seen
        assert seen["ears"] <= 1 * longer, seen

        def weightier() -> None:
            robot.status = shaped
            expect(line).to_have_text("limited: obstacle near")
            robot.status = shaped._replace(why="the scan is 320 ms old")  # which is not kept back

        do_until(
            lambda: expect(line).to_have_text("the scan is 320 ms old", timeout=1_000), weightier
        )
        robot.status = shaped
        expect(line).to_have_text("limited: obstacle near")


@pytest.mark.slow  # nothing moves wrongly by it
def test_a_battery_that_is_low_is_said_on_every_screen(
    context: BrowserContext, tmp_path: Path
) -> None:
    with Bare(tmp_path) as robot, served(robot.connect) as server:
        page = page_of(context, server)
        page.set_viewport_size({"width": 390, "height": 780})
        for charge, said in ((0.12, "The battery is at 12 %"), (0.05, "The battery is at 5.0 %")):
            robot.bulk.publish(HealthReport(charge, ()))
            expect(page.get_by_label("Alarms", exact=True)).to_contain_text(said)
        robot.bulk.publish(HealthReport(0.8, ()))
        expect(page.get_by_label("Alarms", exact=True)).not_to_contain_text("battery")


@pytest.mark.slow  # a layout
def test_on_a_phone_held_sideways_no_setting_ends_under_the_pads(
    browser_phone: BrowserContext, tmp_path: Path
) -> None:
    with Bare(tmp_path) as robot, served(robot.connect) as server:
        page = browser_phone.new_page()
        page.set_viewport_size({"width": 740, "height": 330})
        page.goto(server.address)
        take(page)
        page.get_by_role("button", name="Link").tap()
        page.get_by_role("button", name="Stick settings").tap()
        pad = page.get_by_role("slider", name="Forward and back").bounding_box()
        last = page.get_by_role("row", name="control loop late by")
        last.evaluate("(one) => one.closest('aside').scrollTo(0, 1e6)")
        box = last.bounding_box()
        assert pad is not None
        assert box is not None
        assert box["y"] + box["height"] <= pad["y"]


def test_a_button_of_a_gamepad_that_is_held_as_the_page_loads_stops_and_does_nothing_else(
    context: BrowserContext, tmp_path: Path
) -> None:
    """Nobody knows for how long the resume button has been held; a STOP too many harms nobody."""
    stop, resume = 1, 0
    status = STATUS._replace(mode=Mode.HOLD, stopped="the odometry is 92 ms old")
    lies = PAD + "\nwindow.layOther([0, 0, 0, 0], [%d])"
    with Bare(tmp_path, status) as robot, served(robot.connect) as server:
        page = page_of(context, server, lies % resume)
        take(page)
        page.wait_for_timeout(1500)
        page.evaluate("window.layOther([0, 0, 0, 0])")
        page.wait_for_timeout(300)
        assert not {RequestKind.RESET, RequestKind.MODE, RequestKind.STOP} & set(robot.requests)
        page_of(context, server, lies % stop)
        assert requested(robot, RequestKind.STOP)


@pytest.mark.slow  # nothing moves wrongly by it
def test_a_button_pressed_without_a_connection_says_so(context: BrowserContext, bare: Bare) -> None:
    with served(bare.connect) as station:
        page = page_of(context, station)
        connected(page)
    expect(page.get_by_role("alert", name="Alarms")).to_contain_text("No connection")
    page.get_by_role("button", name="Take over").click()
    expect(page.locator(".refused")).to_contain_text("not sent, as there is no connection")


MORTAL = """(() => {
  const made = []
  window.WebSocket = class extends WebSocket {
    constructor(...options) {
      super(...options)
      made.push(this)
      this.addEventListener('message', (event) => this.dead && event.stopImmediatePropagation())
    }
    send(data) {
      if (!this.dead) super.send(data)
    }
  }
  window.die = () => made.forEach((one) => (one.dead = true))
})()"""
"""`die` cuts the connections made so far, which stay open: nothing passes, either way."""


@pytest.mark.slow  # nothing moves wrongly by it
def test_a_press_into_a_connection_that_is_dead_already_says_so(
    context: BrowserContext, bare: Bare
) -> None:
    """As where a tablet leaves the WiFi: it is taken, and nobody ever hears of it."""
    bare.requests.clear()
    with served(bare.connect, stale=0.25) as station:
        page = page_of(context, station, MORTAL)

        def press() -> None:
            take(page)  # at once after its death: nothing on its way comes in between
            mode_button(page, "Manual").evaluate("(one) => { die(); one.click() }")

        broke = "Manual: the connection broke: if it is not done, press it"
        refused = page.locator(".refused")
        do_until(lambda: expect(refused).to_contain_text(broke, timeout=SOON), press)
        connected(page)
        assert RequestKind.MODE not in bare.requests


@pytest.mark.slow  # a STOP passes one that is full: above
def test_the_display_goes_on_after_the_uplink_was_full(
    context: BrowserContext, station: Server
) -> None:
    """What says that the page has shown a state must not be dropped: no more would come."""
    page = page_of(context, station)
    connected(page)
    age = page.get_by_role("row", name="display age")
    expect(age).not_to_contain_text("–")
    page.evaluate(
        "Object.defineProperty(WebSocket.prototype, 'bufferedAmount',"
        " { get: () => 1e6, configurable: true })"
    )
    page.wait_for_timeout(1000)
    page.evaluate("delete WebSocket.prototype.bufferedAmount")

    def young() -> None:
        text = age.inner_text()
        assert int("".join(c for c in text if c.isdigit())) < 800, text

    do_until(young, lambda: page.wait_for_timeout(1000))


@pytest.mark.slow  # nothing moves wrongly by it
def test_the_speed_survives_a_reload(context: BrowserContext, station: Server) -> None:
    page = page_of(context, station)
    connected(page)
    page.evaluate("document.querySelectorAll('input').forEach((one) => (one.disabled = false))")
    slider = page.get_by_label("Share of the full speed")
    slider.fill("0.3")
    page.reload()
    connected(page)
    expect(slider).to_have_value("0.3")


PADS = """window.pads = [0, 1].map((index) => ({
    id: 'Pad', index, connected: true, mapping: 'standard', timestamp: 0, axes: [0, 0, 0, 0],
    buttons: Array.from({ length: 17 }, () => ({ pressed: false, touched: false, value: 0 })),
}))
navigator.getGamepads = () => window.pads"""


def test_the_stop_button_of_any_gamepad_stops(
    context: BrowserContext, station: Server, bare: Bare
) -> None:
    """The first may be no gamepad at all, as some headsets and keyboards are."""
    page = page_of(context, station, PADS)
    connected(page)
    for pad in (1, 0):
        bare.requests.clear()
        page.evaluate(f"window.pads[{pad}].buttons[1].pressed = true")
        assert requested(bare, RequestKind.STOP)
        page.evaluate(f"window.pads[{pad}].buttons[1].pressed = false")
        page.wait_for_timeout(100)
    assert bare.requests.count(RequestKind.STOP) == 1


@pytest.mark.slow  # nothing moves wrongly by it
def test_every_dock_has_a_route(context: BrowserContext, station: Server, bare: Bare) -> None:
    names = [f"dock {n}" for n in range(6)]
    bare.bulk.publish(Docks(tuple(DockPlace(n, Pose(1.0, 2.0, 0.0), 1.0) for n in names)))
    try:
        page = page_of(context, station)
        connected(page)
        options = page.get_by_label("Route to a dock").get_by_role("option")
        expect(options).to_have_text(["Route to …", *names])
    finally:
        bare.bulk.publish(Docks(()))


@pytest.mark.slow  # waits for 5 s
def test_a_scan_is_not_shown_on_when_its_lidar_is_silent(
    context: BrowserContext, station: Server, bare: Bare
) -> None:
    page = page_of(context, station)
    connected(page)
    dots = """() => {
        const map = document.querySelector('#map')
        const { data } = map.getContext('2d').getImageData(0, 60, map.width, map.height - 120)
        let dark = 0
        for (let i = 0; i < data.length; i += 4) {
            if (data[i] < 0x80) dark += 1
        }
        return dark
    }"""
    before = page.evaluate(dots)
    ranges = np.full(360, 2000, dtype=np.uint16)
    around = ScanPart(1, 0, bare.end.clock(), Pose(1.0, 2.0, 0.0), 360, 0, 0.0, 0.0175, ranges)
    end = time.monotonic() + 10.0
    while page.evaluate(dots) < before + 300:
        assert time.monotonic() < end
        around = around._replace(number=around.number + 1)
        bare.end.show(around)
        page.wait_for_timeout(100)
    page.wait_for_timeout(5000)
    assert page.evaluate(dots) < before + 100


@pytest.mark.slow  # nothing moves wrongly by it
def test_a_slider_set_with_the_mouse_leaves_the_arrow_keys_to_the_stick(
    context: BrowserContext, station: Server
) -> None:
    page = page_of(context, station)
    connected(page)
    page.evaluate("document.querySelectorAll('input').forEach((one) => (one.disabled = false))")
    slider = page.get_by_label("Share of the full speed")
    box = slider.bounding_box()
    assert box is not None
    page.mouse.click(box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"])
    before = slider.input_value()
    assert before != "1"
    alarms = page.get_by_label("Alarms", exact=True)
    for key in ("ArrowUp", "w"):
        page.keyboard.down(key)
        expect(alarms).to_contain_text("does not steer")  # it would, if this page drove
        page.keyboard.up(key)
        expect(alarms).not_to_contain_text("does not steer")
    assert slider.input_value() == before
    slider.focus()  # with the keyboard it is set by the keyboard
    page.keyboard.press("ArrowUp")
    assert slider.input_value() != before


def test_a_connection_that_hangs_is_made_anew(context: BrowserContext, station: Server) -> None:
    page = page_of(context, station, HANGING)
    alarms = page.get_by_label("Alarms", exact=True)
    assert alarms.inner_text() != "No alarms"  # which nobody knows yet
    connected(page)
    expect(alarms).to_contain_text("No alarms")


@pytest.mark.slow  # a connection that hangs: above
def test_a_request_that_hangs_does_not_hold_up_the_connection(
    context: BrowserContext, station: Server
) -> None:
    page = context.new_page()
    page.route("**/session", lambda route: route.continue_() if route.request.post_data else None)
    page.goto(station.address)
    connected(page)


def test_a_page_too_many_is_told_so(
    context: BrowserContext, station: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(app, "MOST_OPERATORS", 0)
    page = page_of(context, station)
    expect(page.locator(".refused")).to_contain_text("too many operators")


@pytest.mark.slow  # nothing moves wrongly by it
def test_without_a_link_to_the_robot_no_record_is_waited_for(
    context: BrowserContext, tmp_path: Path
) -> None:
    (tmp_path / "run.mcap").write_bytes(b"record")
    with Bare(tmp_path) as robot, served(robot.connect) as server:
        page = page_of(context, server)
        page.get_by_role("button", name="Records (1)").click()
        robot.die()
        expect(page.get_by_role("status", name="Alarms")).to_be_hidden()  # there are some
        files = page.get_by_role("list", name="Records on the robot")
        files.get_by_role("link").click()
        expect(files).to_contain_text("no link to the robot", timeout=3_000)
        expect(files).not_to_contain_text("computes")


@pytest.mark.slow  # nothing moves wrongly by it
def test_the_windows_title_has_the_robot_and_what_is_up_with_it(
    context: BrowserContext, tmp_path: Path
) -> None:
    """Who has two robots in two tabs must not take one for the other."""
    with Bare(tmp_path) as robot, served(robot.connect) as server:
        page = page_of(context, server)
        lens = (np.nan,) * 4
        robot.bulk.publish(Hello("sally", np.zeros((3, 2), np.float32), 2.0, 1.0, lens, False))  # type: ignore[arg-type]
        expect(page).to_have_title("sally")
        take(page)
        expect(page).to_have_title("You drive · sally")
        robot.die()
        expect(page).to_have_title("No link · sally")


@pytest.mark.slow  # nothing moves wrongly by it
def test_what_a_page_says_is_true_for_who_reads_it(context: BrowserContext, tmp_path: Path) -> None:
    """Somebody who looks on steers nothing, has no share of the command and can not drive on."""
    told = (Alarm(1, Severity.ALARM, True, False, "lost: nothing on the map fits", AlarmKind.LOST),)
    status = STATUS._replace(localised=Localised.LOST, arming=Arming.ARMED, alarms=told)
    with Bare(tmp_path, status) as robot, served(robot.connect) as server:
        page, other = page_of(context, server), context.new_page()
        other.goto(server.address)
        take(page)
        page.bring_to_front()
        for who_reads, device, share, lost in (
            (page, "keyboard: ready", "you", "lost: nothing on the map fits. In Shared or Manual"),
            (other, "keyboard: steers once you drive", "driver", "Localization is lost: nothing"),
        ):
            who_reads.bring_to_front()
            expect(who_reads.locator(".device")).to_have_text(device)
            expect(who_reads.locator(".share")).to_contain_text(share)
            said = who_reads.get_by_label("Alarms", exact=True)
            expect(said).to_contain_text(lost)
            who_reads.keyboard.down("ArrowUp")
            if who_reads is other:
                expect(said).to_contain_text("does not steer: press Request control first")
                question = request_control(other, page)
                expect(said).to_contain_text("does not steer: you have requested control")
                keep(page, question)
            who_reads.keyboard.up("ArrowUp")
            expect(said).not_to_contain_text("does not steer")
            assert ("drive by hand" in said.inner_text()) == (who_reads is page)
            expect(said.locator(".alarm")).to_have_count(1)
        page.bring_to_front()
        robot.status = status._replace(mode=Mode.AUTOMATIC)
        expect(page.locator(".device")).to_have_text("keyboard: not used in Auto")
        robot.die()
        for who_reads in (page, other):
            expect(who_reads.get_by_label("Alarms", exact=True)).to_contain_text("No link to")
            expect(who_reads.locator(".device")).to_have_text("keyboard: no link to the robot")
            expect(mode_button(who_reads, "Manual")).to_be_disabled()
            for row in ("round trip", "packet loss", "clock offset"):
                expect(who_reads.get_by_role("row", name=row).first).to_contain_text("–")
        assert "must stop by" not in other.get_by_label("Alarms", exact=True).inner_text()


SAID = """{
    window.said = []
    new MutationObserver(() => {
        const now = document.querySelector('header')?.innerText ?? ''
        if (now !== said.at(-1)) said.push(now)
    }).observe(document, { childList: true, subtree: true, characterData: true })
}"""


@pytest.mark.slow  # nothing moves wrongly by it
def test_a_page_that_opens_says_at_no_moment_that_it_lost_the_link_or_that_it_has_one(
    context: BrowserContext, tmp_path: Path
) -> None:
    with Bare(tmp_path, STATUS) as robot, served(robot.connect) as server:
        page = page_of(context, server, SAID)
        take(page)
        assert "No link to the robot" not in "".join(page.evaluate("said"))
        robot.die()
        expect(who(page)).to_contain_text("No link")
        page.reload()
        expect(who(page)).to_contain_text("No link")
        page.wait_for_timeout(500)
        assert "You drive" not in "".join(page.evaluate("said"))


ONCE = (RequestKind.ACKNOWLEDGE, RequestKind.RESET, RequestKind.RECORD)


@pytest.mark.slow  # Take over is tried: test_driving
def test_a_double_click_is_one_click_and_different_buttons_are_all_heard(
    context: BrowserContext, tmp_path: Path
) -> None:
    told = tuple(Alarm(n, Severity.ALARM, True, False, f"alarm {n}") for n in (1, 2))
    status = STATUS._replace(mode=Mode.HOLD, stopped="stop by anna (3)", alarms=told)
    with Bare(tmp_path, status) as robot, served(robot.connect) as server:
        page, sent = context.new_page(), list[str]()
        page.on("websocket", lambda socket: socket.on("framesent", lambda data: note(data)))

        def note(data: str | bytes) -> None:
            message = json.loads(data)
            if message["type"] == "do":
                sent.append(message["what"])

        page.goto(server.address)
        take(page)
        sent.clear()
        for button, what in (
            (page.get_by_role("button", name="Acknowledge").first, "acknowledge"),
            (page.get_by_role("button", name="Reset"), "reset"),
            (page.get_by_role("button", name="● Record"), "record"),
            (mode_button(page, "Manual"), "manual"),
        ):
            button.dblclick()
            page.wait_for_timeout(300)
            assert sent[-1] == what
        for mode in ("Shared", "Manual", "Shared"):
            mode_button(page, mode).click()
        page.wait_for_timeout(300)
        # of what the page says at once, a robot that is reached too late hears nothing
        assert sent == ["acknowledge", "reset", "record", "manual", "shared", "manual", "shared"]
        assert all(robot.requests.count(what) <= 1 for what in ONCE)
        assert robot.requests.count(RequestKind.MODE) <= 4


@pytest.mark.slow  # nothing moves wrongly by it
def test_a_refusal_goes_with_the_next_press(context: BrowserContext, tmp_path: Path) -> None:
    with Bare(tmp_path, STATUS) as robot, served(robot.connect) as server:
        page = page_of(context, server)
        take(page)
        mode_button(page, "Manual").click()
        refused = page.locator(".refused")
        expect(refused).to_contain_text("Manual: the robot did not answer")
        mode_button(page, "Shared").click()
        expect(refused).not_to_contain_text("Manual", timeout=2_000)  # else it stays for 6 s


@pytest.mark.slow  # a layout
@pytest.mark.parametrize(("width", "height"), first([(320, 568), (390, 780), (740, 330)]))
def test_on_a_phone_a_long_route_leaves_the_buttons_that_send_close_and_discard_it_in_sight(
    browser_phone: BrowserContext, tmp_path: Path, width: int, height: int
) -> None:
    with Bare(tmp_path, STATUS) as robot, served(robot.connect) as server:
        page = page_of(browser_phone, server)
        page.set_viewport_size({"width": width, "height": height})
        take(page)
        route = np.array([[k, 0.5 * k] for k in range(12)], np.float32)
        robot.bulk.publish(Polyline(LineKind.WAYPOINTS, route))
        panel = page.get_by_role("dialog", name="Edit the route")
        points = panel.get_by_role("listitem")

        def open_anew() -> None:  # with the route that has come by then
            if panel.is_visible():
                panel.get_by_role("button", name="Close").tap()
            page.get_by_role("button", name="Edit route").tap()

        do_until(lambda: expect(points).to_have_count(12, timeout=1_000), open_anew)
        panel.get_by_role("button", name="Add").tap()
        said = panel.get_by_role("status")

        def refused() -> None:
            for one in robot.bulk.proposed():
                answer = Answer(one.what.number, False, "3 cm from a wall")
                robot.bulk.reply(one.client, Checked(answer, 11))

        do_until(lambda: expect(said).to_contain_text("3 cm from", timeout=500), refused)
        for name in ("Send", "Close", "Discard"):
            button = panel.get_by_role("button", name=name)
            expect(button).to_be_in_viewport(ratio=1)
            assert button.evaluate(UPPERMOST)
        for one in (points.first.get_by_role("button"), said):
            assert one.evaluate(UPPERMOST)  # and a point of the route, and what the robot answers


@pytest.mark.slow  # nothing moves wrongly by it
def test_an_edited_route_outlives_its_panel_until_the_robot_has_it_or_it_is_discarded(
    context: BrowserContext, tmp_path: Path
) -> None:
    with Bare(tmp_path, STATUS) as robot, served(robot.connect) as server:
        page = page_of(context, server)
        take(page)
        robot.bulk.publish(Polyline(LineKind.WAYPOINTS, np.array([[1, 2], [3, 4]], np.float32)))
        page.wait_for_timeout(500)
        opener = page.get_by_role("button", name="Edit route")
        panel = page.get_by_role("dialog", name="Edit the route")
        items, discard = panel.get_by_role("listitem"), panel.get_by_role("button", name="Discard")
        opener.click()
        expect(items).to_have_count(2)
        expect(discard).to_have_count(0)
        panel.get_by_role("button", name="Add in the middle").click()
        expect(items).to_have_count(3)
        for close in ("Close", "Escape"):
            if close == "Close":
                panel.get_by_role("button", name=close).click()
            else:
                page.keyboard.press(close)
            expect(panel).to_have_count(0)
            opener.click()
            expect(items).to_have_count(3)
        discard.click()
        expect(items).to_have_count(2)
        expect(discard).to_have_count(0)
        panel.get_by_role("button", name="Add in the middle").click()
        panel.get_by_role("button", name="Send").click()
        expect(panel.get_by_role("status")).to_contain_text("has not answered yet")
        for one in robot.bulk.proposed():
            robot.bulk.reply(one.client, Checked(Answer(one.what.number, True, ""), 65535))
        expect(panel.get_by_role("status")).to_contain_text("accepted the new route")
        expect(discard).to_have_count(0)
        panel.get_by_role("button", name="Close").click()
        opener.click()
        expect(items).to_have_count(2)  # what the robot says it follows


@pytest.mark.slow  # nothing moves wrongly by it
def test_an_answer_to_a_route_that_was_discarded_is_not_shown(
    context: BrowserContext, tmp_path: Path
) -> None:
    with Bare(tmp_path, STATUS) as robot, served(robot.connect) as server:
        page = page_of(context, server)
        robot.bulk.publish(Polyline(LineKind.WAYPOINTS, np.array([[1, 2], [3, 4]], np.float32)))
        page.wait_for_timeout(500)
        page.get_by_role("button", name="Edit route").click()
        panel = page.get_by_role("dialog", name="Edit the route")
        add, said = panel.get_by_role("button", name="Add"), panel.get_by_role("status")

        def answered() -> None:
            for one in robot.bulk.proposed():
                reason = f"asked {one.what.number} times"
                robot.bulk.reply(one.client, Checked(Answer(one.what.number, False, reason), 0))

        add.click()
        do_until(lambda: expect(said).to_contain_text("asked 1 times", timeout=500), answered)
        page.wait_for_timeout(300)  # so that the next is checked at once
        add.click()
        page.wait_for_timeout(300)
        panel.get_by_role("button", name="Discard").click()
        answered()
        page.wait_for_timeout(700)
        expect(said).not_to_contain_text("Refused")
        expect(panel.locator("li.bad")).to_have_count(0)
        add.click()
        do_until(lambda: expect(said).to_contain_text("asked 3 times", timeout=500), answered)


UPPERMOST = """(one) => {
    const { left, top, width, height } = one.getBoundingClientRect()
    return [0.1, 0.9].every((part) =>
        one.contains(document.elementFromPoint(left + width / 2, top + part * height)))
}"""


REST = Command(CENTRED, False, False, Device.NONE)
ALONE = "must stop by its own time-out: look at it"


@pytest.mark.parametrize(
    ("carry_on", "mode", "does"),
    first(
        [
            (False, Mode.SHARED, "stale. The robot should stop by itself: look at it."),
            (True, Mode.SHARED, "stale. The robot drives on alone (--carry-on)."),
            (True, Mode.AUTOMATIC, "stale. The robot drives on alone (--carry-on)."),
            (True, Mode.MANUAL, "stale. The robot should stop by itself: look at it."),
        ],
        2,
    ),
)
def test_without_a_link_the_driver_is_told_what_the_robot_does_now(
    context: BrowserContext, tmp_path: Path, carry_on: bool, mode: Mode, does: str
) -> None:
    with Bare(tmp_path, STATUS._replace(mode=mode)) as robot, served(robot.connect) as server:
        page = page_of(context, server)
        outline = np.zeros((3, 2), np.float32)
        robot.bulk.publish(Hello("sally", outline, 2.0, 1.0, (np.nan,) * 4, carry_on))  # type: ignore[arg-type]
        expect(page).to_have_title("sally")
        take(page)
        robot.die()
        alarms = page.get_by_label("Alarms", exact=True)
        expect(alarms).to_contain_text(f"No link to the robot: the display is {does}")
        expect(alarms.locator(".alarm")).to_have_count(1)


def test_the_page_of_a_station_that_was_started_again_takes_over_from_the_one_that_died(
    context: BrowserContext, tmp_path: Path
) -> None:
    """It read that its own earlier self drives, and could only request control of that."""
    with (
        Bare(tmp_path, STATUS) as robot,
        served(robot.connect) as server,
        StationEnd(robot.keys, "127.0.0.1", robot.port, speaks_for=0.5) as dead,
    ):
        until(lambda: dead.status(), turn=lambda: dead.steer(REST))
        dead.ask(RequestKind.TAKE)
        until(lambda: robot.end.driver, turn=lambda: dead.steer(REST))
        page = page_of(context, server)  # and the other one says nothing from now on
        expect(who(page)).to_contain_text("drove; connection lost")
        expect(who(page).get_by_role("button", name="Request control")).to_have_count(0)
        take(page)


def test_of_a_robot_whose_process_has_ended_no_page_says_that_it_stops_or_drives_on(
    context: BrowserContext, tmp_path: Path
) -> None:
    """With its gate killed, only the motor controller's own time-out stops it."""
    ended = f"the robot's process has ended: the gate process has ended; the robot {ALONE}"
    status = STATUS._replace(mode=Mode.AUTOMATIC)
    with Bare(tmp_path, status) as robot, served(robot.connect) as server:
        page = page_of(context, server)
        outline = np.zeros((3, 2), np.float32)
        robot.bulk.publish(Hello("sally", outline, 2.0, 1.0, (np.nan,) * 4, True))  # type: ignore[arg-type]
        expect(page).to_have_title("sally")
        take(page)
        robot.over = ended
        alarms = page.get_by_label("Alarms", exact=True)
        expect(alarms).to_contain_text(
            "the display is stale. Start it again on the robot: this page connects by itself. "
            f"Reason: {ended}."
        )


DARK_AT = """([x, y]) => {
    const map = document.querySelector('#map')
    const [px, py] = [map.width / 2 + x, map.height / 2 + y]
    const { data } = map.getContext('2d').getImageData(px - 12, py - 12, 24, 24)
    let dark = 0
    for (let i = 0; i < data.length; i += 4) {
        if (data[i] < 0x80) dark += 1
    }
    return dark
}"""


def draws(page: Page, at: list[int], least: int, most: int) -> None:
    """Until so many pixels there, from the middle, are dark; those of no picture all are."""
    end = time.monotonic() + WAIT / 1e3
    while not least <= (dark := page.evaluate(DARK_AT, at)) <= most:
        assert time.monotonic() < end, dark
        page.wait_for_timeout(100)


@pytest.mark.slow  # nothing moves wrongly by it
def test_the_page_shows_where_the_robot_goes_who_leads_and_what_stops_it(
    context: BrowserContext, tmp_path: Path
) -> None:
    with Bare(tmp_path, STATUS._replace(authority=0.2)) as robot, served(robot.connect) as server:
        page = page_of(context, server, PAD)
        stop = page.get_by_role("button", name="Stop the robot")
        expect(stop).to_contain_text("Space")
        place = stop.bounding_box()
        page.evaluate("testPad.plug()")
        expect(stop).to_contain_text("B or ○")
        assert stop.bounding_box() == place
        page.evaluate("testPad.unplug()")
        expect(stop).to_contain_text("Space")
        expect(page.locator(".share .leads")).to_have_text("driver")
        robot.status = STATUS._replace(authority=0.9)
        expect(page.locator(".share .leads")).to_have_text("auto")
        robot.status = STATUS._replace(mode=Mode.HOLD, why="idle")
        expect(page.locator(".share .leads")).to_have_count(0)
        goal = [2 * 45, 3 * -45]  # of the robot, which is in the middle: pixels
        draws(page, goal, 0, 0)
        route = np.array([[1.0, 2.0], [3.0, 2.0], [3.0, 5.0]], np.float32)
        robot.bulk.publish(Polyline(LineKind.REFERENCE, route))
        draws(page, goal, 100, 576)
        square = np.array([[0.3, 0.3], [-0.3, 0.3], [-0.3, -0.3], [0.3, -0.3]], np.float32)
        robot.bulk.publish(Hello("sally", square, 2.0, 1.0, (np.nan,) * 4, False))  # type: ignore[arg-type]
        robot.bulk.publish(Polyline(LineKind.REFERENCE, np.zeros((0, 2), np.float32)))
        for _ in range(12):
            page.get_by_role("button", name="Zoom out").click()
        draws(page, [0, 0], 80, 500)


@pytest.mark.slow  # nothing moves wrongly by it
def test_a_fault_in_one_picture_of_the_map_is_said_and_is_not_the_last_picture(
    context: BrowserContext, tmp_path: Path
) -> None:
    """The map stood still for ever while all else went on, which nobody could see."""
    with Bare(tmp_path) as robot, served(robot.connect) as server:
        page = page_of(context, server)
        connected(page)
        alarms = page.get_by_label("Alarms", exact=True)
        wrong = np.array([[1.0, 2.5, 0.0, 0.0, -1.0, -0.5]], np.float32)
        robot.end.show(Discs(1, wrong))  # no radius is negative
        page.wait_for_timeout(500)
        expect(alarms).not_to_contain_text("failed")
        page.evaluate("""() => {
            const ofCanvas = CanvasRenderingContext2D.prototype
            const real = ofCanvas.fillRect
            ofCanvas.fillRect = function (...box) {
                if (this.canvas.id !== 'map') return real.apply(this, box)
                ofCanvas.fillRect = real
                delete this.canvas.dataset.fps
                throw new Error('once')
            }
        }""")
        expect(alarms).to_contain_text("This page has failed at something")
        expect(page.locator("#map")).to_have_attribute("data-fps", re.compile(r"\d"))


@pytest.mark.slow  # what is said instead is tried above
def test_without_a_link_nothing_is_said_to_help(context: BrowserContext, tmp_path: Path) -> None:
    status = STATUS._replace(mode=Mode.HOLD, stopped="stop by anna (3)", arming=Arming.ARMED)
    with Bare(tmp_path, status) as robot, served(robot.connect) as server:
        page = page_of(context, server, PAD)
        take(page)
        page.evaluate("testPad.plug()")
        alarms = page.get_by_label("Alarms", exact=True)
        expect(alarms).to_contain_text("To continue: hold A or ✕ of the gamepad")
        page.evaluate("testPad.deflect(0, 1)")
        expect(alarms).to_contain_text("Your stick does not steer: press Reset first")
        robot.die()
        expect(alarms).to_contain_text("No link to the robot")
        page.evaluate("testPad.deflect(0, 0)")
        page.wait_for_timeout(500)
        expect(alarms.locator(".alarm")).to_have_count(1)
        page.evaluate("testPad.deflect(0, 1)")
        page.wait_for_timeout(500)
        expect(alarms.locator(".alarm")).to_have_count(1)


def test_in_auto_a_centred_stick_that_the_robot_has_not_received_is_no_alarm(
    context: BrowserContext, tmp_path: Path
) -> None:
    """On a busy machine it flickered, of a stick that is not used."""
    status = STATUS._replace(mode=Mode.AUTOMATIC)  # and its stick is absent
    with Bare(tmp_path, status) as robot, served(robot.connect) as server:
        page = page_of(context, server)
        take(page)
        expect(page.locator(".device")).to_have_text("keyboard: not used in Auto")
        assert "does not steer" not in page.get_by_label("Alarms", exact=True).inner_text()
        page.keyboard.down("ArrowUp")
        expect(page.get_by_label("Alarms", exact=True)).to_contain_text("mode is Auto")
        page.keyboard.up("ArrowUp")
        robot.status = STATUS._replace(mode=Mode.SHARED)
        expect(page.get_by_label("Alarms", exact=True)).to_contain_text("not received by the")
