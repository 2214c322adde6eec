"""Alarms on the page: all of them, whole, and none over what drives the robot."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, BrowserContext, Page, expect

from cohelm.core.types import Pose
from cohelm.link.bulk_messages import Alarms, DockPlace, Docks, WholeAlarm
from cohelm.link.messages import Alarm, AlarmKind, Mode, Severity
from tests.few import first
from tests.link.ends import STATUS
from tests.station.bare import Bare
from tests.station.person import (
    alarms,
    control_requested,
    keep,
    mode_button,
    page_of,
    press,
    request_control,
    take,
    until,
)
from tests.station.servers import served

LONG = (
    "the odometry comes 5.0 s from the future: a clock jumped; if it stays so, set both clocks "
    "(chrony, ntp) and start again"
)
ALL = tuple(
    Alarm(number, Severity.ALARM, True, False, f"{number}. {LONG}") for number in range(7, 0, -1)
)


def troubled(folder: Path, count: int) -> Bare:
    told = ALL[:count]
    robot = Bare(folder, STATUS._replace(mode=Mode.SHARED, alarms=told))
    robot.bulk.publish(Alarms(tuple(WholeAlarm(one, one.text) for one in told)))
    return robot


@pytest.fixture
def phones(browser: Browser) -> Iterator[BrowserContext]:
    made = browser.new_context(is_mobile=True, has_touch=True)
    yield made
    made.close()


OVERLAPS = """([ones, others]) => {
  const box = (name) => document.querySelector(name).getBoundingClientRect()
  return ones.flatMap((one) => others.filter((other) => {
    const [a, b] = [box(one), box(other)]
    return !(a.right <= b.left || b.right <= a.left || a.bottom <= b.top || b.bottom <= a.top)
  }).map((other) => `${one} and ${other}`))
}"""


def overlaps(page: Page, ones: tuple[str, ...], others: tuple[str, ...]) -> list[str]:
    """Which of these lie over which of those, at one moment."""
    return page.evaluate(OVERLAPS, [ones, others])


POSE = Pose(0.0, 0.0, 0.0)
PADS = (".pad.x", ".pad.psi")
MODES = (".segments", ".modes input", ".station nav")


def test_on_small_phones_long_alarms_do_not_push_the_modes_under_the_pads(
    tmp_path: Path, phones: BrowserContext
) -> None:
    with troubled(tmp_path, 2) as robot, served(robot.connect) as server:
        page = phones.new_page()
        page.set_viewport_size({"width": 320, "height": 568})
        page.goto(server.address)
        take(page)
        for width, height in ((320, 568), (740, 330), (667, 330), (390, 780)):
            page.set_viewport_size({"width": width, "height": height})
            expect(alarms(page).get_by_role("button", name="more")).to_be_visible()
            assert overlaps(page, PADS, (*MODES, ".stop-button", ".alarms")) == [], (width, height)
            room = page.locator("#map").bounding_box()
            assert room is not None
            assert room["height"] > 80, (width, height)
            alarms(page).get_by_role("button", name="more").tap()
            every = page.get_by_role("dialog", name="All alarms")
            expect(every).to_contain_text(f"7. {LONG}")
            expect(every).to_contain_text(f"6. {LONG}")
            free = (*PADS, ".stop-button")
            assert overlaps(page, (".all-alarms",), free) == [], (width, height)
            every.get_by_role("button", name="Close").tap()
            expect(every).to_be_hidden()


@pytest.mark.slow  # with long alarms alone: above
@pytest.mark.parametrize(
    ("width", "height"), first([(320, 568), (740, 330), (667, 330), (390, 780)])
)
def test_on_small_phones_nothing_that_is_said_pushes_the_modes_under_the_pads(
    tmp_path: Path, phones: BrowserContext, context: BrowserContext, width: int, height: int
) -> None:
    """A stop, refusals, somebody who asks, and docks, all at once."""
    status = STATUS._replace(mode=Mode.SHARED, alarms=ALL[:2], stopped=LONG, why=LONG)
    with Bare(tmp_path, status) as robot, served(robot.connect) as server:
        robot.bulk.publish(Docks(tuple(DockPlace(f"dock {i}", POSE, 1.0) for i in range(3))))
        page, other = phones.new_page(), context.new_page()
        other.goto(server.address)
        other.get_by_role("button", name="Take over").wait_for()
        page.set_viewport_size({"width": 320, "height": 568})
        page.goto(server.address)
        take(page)
        page.get_by_label("Route to a dock").wait_for()
        question = control_requested(page)
        refused = page.get_by_text("Manual: the robot did not answer")

        def all_at_once() -> None:  # a request is there for ten seconds, what was refused for six
            if question.is_visible():
                keep(page, question)
            press(other, "Release")()
            take(page)
            request_control(other, page)
            for mode in ("Hold", "Auto", "Manual"):
                mode_button(page, mode).tap()
            refused.wait_for()

        def measured() -> None:
            page.wait_for_timeout(100)
            over[:] = overlaps(page, PADS, (*MODES, ".docks", ".alarms", ".head"))
            assert question.is_visible()  # still: a busy machine takes its time

        over: list[str] = []
        page.set_viewport_size({"width": width, "height": height})
        until(measured, all_at_once)
        assert over == []
        expect(page.get_by_role("button", name="Stop the robot")).to_be_in_viewport(ratio=1)


def test_more_alarms_than_there_is_room_for_are_counted_and_can_be_seen_and_acknowledged(
    tmp_path: Path, context: BrowserContext
) -> None:
    with troubled(tmp_path, 7) as robot, served(robot.connect) as server:
        page = page_of(context, server)
        expect(alarms(page)).to_contain_text(f"7. {LONG}")
        expect(alarms(page)).not_to_contain_text("3. ")
        alarms(page).get_by_role("button", name="3 more").click()
        every = page.get_by_role("dialog", name="All alarms")
        for alarm in ALL:
            expect(every).to_contain_text(alarm.text)
        all_of_them = every.get_by_role("button", name="Acknowledge all")

        def acknowledged() -> None:
            assert robot.acknowledged == {alarm.number for alarm in ALL}

        until(acknowledged, lambda: (all_of_them.click(), page.wait_for_timeout(1000)))
        page.keyboard.press("Escape")
        expect(every).to_be_hidden()


@pytest.mark.slow  # nothing moves wrongly by it
def test_the_list_of_all_alarms_does_not_open_by_itself(
    tmp_path: Path, context: BrowserContext
) -> None:
    with troubled(tmp_path, 7) as robot, served(robot.connect) as server:
        page = page_of(context, server)
        more = alarms(page).get_by_role("button", name="3 more")
        every = page.get_by_role("dialog", name="All alarms")
        more.dblclick()
        expect(every).to_be_visible()
        told = robot.status
        robot.status = told._replace(alarms=())
        expect(every).to_be_hidden()
        robot.status = told
        expect(more).to_be_visible()
        expect(every).to_be_hidden()


ADDED = """() => {
  window.added = []
  new MutationObserver((all) => all.forEach((one) => one.addedNodes.forEach((node) => {
    if (node.nodeType === Node.ELEMENT_NODE) added.push(node.textContent)
  }))).observe(document.querySelector('.alarms'), { childList: true, subtree: true })
}"""


@pytest.mark.slow  # nothing moves wrongly by it
def test_a_screen_reader_is_told_what_is_new_and_not_all_of_it_at_each_second(
    context: BrowserContext, tmp_path: Path
) -> None:
    first = Alarm(1, Severity.NOTICE, True, False, "the battery is not known")
    counts = "the odometry is 3 s old"
    status = STATUS._replace(mode=Mode.HOLD, why="", alarms=(first,))
    with Bare(tmp_path, status) as robot, served(robot.connect) as server:
        page = page_of(context, server)
        region = alarms(page)
        expect(region).to_contain_text("the battery is not known")
        expect(region).to_have_attribute("aria-live", "polite")
        page.evaluate(ADDED)
        for second in range(3, 8):
            second_alarm = Alarm(2, Severity.ALARM, True, False, counts.replace("3", str(second)))
            robot.status = status._replace(alarms=(second_alarm, first))
            expect(region).to_contain_text(f"is {second} s old")
        expect(region).to_have_attribute("aria-live", "assertive")
        expect(region).to_have_attribute("aria-atomic", "false")
        expect(region).to_have_attribute("aria-relevant", "additions")
        robot.status = status._replace(alarms=(first,))
        expect(region).not_to_contain_text("odometry")
        added = page.evaluate("added")
        assert len(added) == 1, added
        assert counts in added[0].lower()


def test_a_stop_is_read_out_from_a_region_that_was_there_before(
    context: BrowserContext, tmp_path: Path
) -> None:
    with Bare(tmp_path, STATUS) as robot, served(robot.connect) as server:
        page = page_of(context, server)
        region = page.get_by_role("group", name="Stop").locator("[role=status]")
        expect(region).to_have_count(1)
        before = region.element_handle()
        robot.status = STATUS._replace(mode=Mode.HOLD, stopped="the odometry is 92 ms old")
        expect(region).to_contain_text("Stopped: the odometry is 92 ms old")
        assert before.evaluate("(one) => one.isConnected")


@pytest.mark.slow  # nothing moves wrongly by it
def test_only_the_alarm_of_a_lost_localization_is_said_to_be_one(
    tmp_path: Path, context: BrowserContext
) -> None:
    told = (
        Alarm(1, Severity.ALARM, True, False, "lost: nothing on the map fits", AlarmKind.LOST),
        Alarm(2, Severity.ALARM, True, False, "lost: a parcel"),
    )
    status = STATUS._replace(mode=Mode.SHARED, alarms=told)
    with Bare(tmp_path, status) as robot, served(robot.connect) as server:
        page = page_of(context, server)
        take(page)
        said = alarms(page)
        expect(said).to_contain_text("Localization is lost: nothing on the map fits. In Shared")
        assert "Localization is lost: a parcel" not in said.inner_text()
        assert said.inner_text().count("drive by hand") == 1
