"""What the page says can be read: contrast, and the size of letters that the system is set to."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, BrowserContext, Page, expect

from cohelm.link.bulk_messages import Alarms, LineKind, Polyline, WholeAlarm
from cohelm.link.messages import Alarm, Arming, Mode, Severity
from cohelm.station.serve import Server
from tests.few import first
from tests.link.ends import STATUS
from tests.station.bare import Bare
from tests.station.conftest import CHROMIUM, FLAGS
from tests.station.person import (
    alarms,
    page_of,
    request_control,
    stopped,
    take,
    until as do_until,
    who,
)
from tests.station.servers import served
from tests.station.test_alarms import LONG

STANDS = STATUS._replace(mode=Mode.HOLD, why="idle")
REASON = "stop by anna (3)"
TOLD = (Alarm(1, Severity.ALARM, True, False, REASON),)
CUT = """(one) => one.scrollHeight > one.clientHeight + 1 || one.scrollWidth > one.clientWidth + 1
    || one.getBoundingClientRect().right > innerWidth"""
SEEN = """(one, end) => {
  const [first, last] = [...one.getClientRects()].flatMap((box) => [box.top, box.bottom])
  const { left, width } = one.getBoundingClientRect()
  const at = end === 'start' ? first + 6 : last - 6
  return [left + 3, left + width - 3].every((x) => one.contains(document.elementFromPoint(x, at)))
}"""
"""Whether the first, or the last, line of it is in sight, and nothing lies over it."""
WHOLE = """(one) => {
  const { left, right, top, bottom } = one.getBoundingClientRect()
  const corners = [left + 3, right - 3].flatMap((x) => [[x, top + 3], [x, bottom - 3]])
  return corners.every(([x, y]) => one.contains(document.elementFromPoint(x, y)))
}"""
SIZES = ((360, 740), (390, 780), (740, 330), (820, 1180), (1280, 800), (1024, 600))
UNREACHABLE = """() => {
  const out = [...document.querySelectorAll('button, input, .pad')].filter((one) => {
    const { left, top, width, height } = one.getBoundingClientRect()
    if (width === 0) return false
    for (let at = one.parentElement; at !== null; at = at.parentElement) {
      const scrolls = getComputedStyle(at).overflowY === 'auto'
      if (scrolls && at.scrollHeight > at.clientHeight) return false
    }
    return !one.contains(document.elementFromPoint(left + width / 2, top + height / 2))
  }).map((one) => one.ariaLabel ?? one.textContent)
  const { scrollWidth } = document.documentElement
  const wide = scrollWidth > innerWidth || visualViewport.scale < 1
  return wide ? [...out, `${scrollWidth} wide`] : out
}"""
PALE = """() => {
  const light = (c) => {
    const part = (v) => (v / 255 <= 0.04045 ? v / 255 / 12.92 : ((v / 255 + 0.055) / 1.055) ** 2.4)
    return 0.2126 * part(c[0]) + 0.7152 * part(c[1]) + 0.0722 * part(c[2])
  }
  const parsed = (text) => {
    const [r, g, b, a] = text.match(/[\\d.]+/g).map(Number)
    return [r, g, b, a ?? 1]
  }
  const over = (a, b, share = a[3]) => [0, 1, 2].map((i) => a[i] * share + b[i] * (1 - share))
  const out = []
  const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT)
  while (texts.nextNode()) {
    const one = texts.currentNode.parentElement
    const text = texts.currentNode.textContent.trim()
    if (text === '' || !one.checkVisibility() || one.closest(':disabled, noscript')) continue
    let share = 1
    let ground = [255, 255, 255]
    const grounds = []
    for (let at = one; at !== null; at = at.parentElement) {
      const style = getComputedStyle(at)
      grounds.unshift(parsed(style.backgroundColor))
      share *= Number(style.opacity) * Number(style.filter.match(/opacity\\((.*?)\\)/)?.[1] ?? 1)
    }
    for (const each of grounds) ground = over(each, ground)
    const ink = over(parsed(getComputedStyle(one).color), ground, share)
    const [dark, bright] = [light(ink), light(ground)].sort((a, b) => a - b)
    if ((bright + 0.05) / (dark + 0.05) < 4.5) out.push(text)
  }
  return out
}"""
"""Texts with a contrast of less than 4.5, as WCAG 2 asks for small letters; not of what is grey as
it can not be pressed."""


@pytest.mark.slow  # nothing moves wrongly by it
def test_every_text_of_the_page_has_contrast_also_where_it_is_stale(
    context: BrowserContext, tmp_path: Path
) -> None:
    alarm = Alarm(1, Severity.WARNING, False, False, "a warning that is over")
    with Bare(tmp_path, STANDS) as robot, served(robot.connect) as server:
        page = page_of(context, server)
        expect(who(page)).to_contain_text("No driver")
        assert page.evaluate(PALE) == []
        take(page)
        page.get_by_role("button", name="Stick settings").click()
        robot.status = STANDS._replace(stopped="stop by anna (3)", why="", alarms=(alarm,))
        expect(stopped(page)).to_be_visible()
        assert page.evaluate(PALE) == []
        robot.die()
        expect(alarms(page)).to_contain_text("No link to the robot")
        assert page.evaluate(PALE) == []


@contextmanager
def letters_of(browser: Browser, size: int) -> Iterator[Browser]:
    """A browser of a system whose letters are set to this size [px]."""
    large = browser.browser_type.launch(
        executable_path=CHROMIUM, args=[*FLAGS, f"--blink-settings=defaultFontSize={size}"]
    )
    try:
        yield large
    finally:
        large.close()


def driving_phone(large: Browser, server: Server, width: int, height: int) -> Page:
    """The page on a phone of this size, whose person drives."""
    page = large.new_page(
        viewport={"width": width, "height": height}, is_mobile=True, has_touch=True
    )
    page.goto(server.address)
    take(page)
    return page


@pytest.mark.slow  # with large letters all is there: below
def test_letters_grow_with_those_of_the_system(browser: Browser, tmp_path: Path) -> None:
    with (
        letters_of(browser, 24) as large,
        Bare(tmp_path, STANDS) as robot,
        served(robot.connect) as server,
    ):
        page = large.new_page(viewport={"width": 1280, "height": 800})
        page.goto(server.address)
        take(page)
        why = page.locator(".why")
        expect(why).to_contain_text("idle")
        assert why.evaluate("(one) => parseFloat(getComputedStyle(one).fontSize)") > 20
        slider = page.get_by_label("Share of the full speed").bounding_box()
        assert slider is not None
        assert slider["width"] > 40
        assert page.evaluate("document.documentElement.scrollWidth") <= 1280


@pytest.mark.parametrize(
    ("width", "height"), first([(320, 568), (740, 330), (390, 780), (820, 1180)])
)
def test_with_large_letters_on_a_phone_every_alarm_can_be_read_and_stop_pressed(
    browser: Browser, tmp_path: Path, width: int, height: int
) -> None:
    texts = ("the odometry is 120 ms old, and its clock jumped", LONG)  # the shorter is cut, too
    armed = STATUS._replace(mode=Mode.SHARED, arming=Arming.ARMED)
    with (
        letters_of(browser, 24) as large,
        Bare(tmp_path, armed) as robot,
        served(robot.connect) as server,
    ):
        page = driving_phone(large, server, width, height)
        for number, text in enumerate(texts, 10):
            told = Alarm(number, Severity.ALARM, True, False, text)
            robot.bulk.publish(Alarms((WholeAlarm(told, text),)))
            robot.status = armed._replace(alarms=(told,))
            said = alarms(page).locator("> .alarm")
            expect(said).to_contain_text(text)
            expect(alarms(page).locator(".alarm")).to_have_count(1)
            page.wait_for_timeout(600)
            if said.locator("span").nth(1).evaluate(CUT):
                alarms(page).get_by_role("button", name="In full").tap()
                said = page.get_by_role("dialog", name="All alarms").locator(".alarm")
                button = said.get_by_role("button", name="Acknowledge")
                button.scroll_into_view_if_needed()
                expect(button).to_be_in_viewport(ratio=1)
                button.tap(trial=True)
            words = said.locator("span").nth(1)
            assert not words.evaluate(CUT)
            for end in ("start", "end"):
                words.evaluate(f"(one) => one.scrollIntoView({{ block: '{end}' }})")
                assert words.evaluate(SEEN, end), (text, end)
            stop = page.get_by_role("button", name="Stop the robot")
            expect(stop).to_be_in_viewport(ratio=1)
            stop.tap(trial=True)
            page.keyboard.press("Escape")


@pytest.mark.slow  # that all is there to press: below
@pytest.mark.parametrize("letters", first([32, 16, 24]))
def test_on_a_small_phone_large_letters_leave_room_for_the_map(
    browser: Browser, tmp_path: Path, letters: int
) -> None:
    with (
        letters_of(browser, letters) as large,
        Bare(tmp_path, STANDS) as robot,
        served(robot.connect) as server,
    ):
        page = driving_phone(large, server, 320, 568)
        robot.status = STANDS._replace(stopped=REASON, alarms=TOLD)
        expect(page.get_by_role("button", name="Reset")).to_have_count(1)
        page.wait_for_timeout(600)
        box = page.locator("#map").bounding_box()
        assert box is not None
        assert box["height"] >= 60


@pytest.mark.parametrize("letters", first([24, 16, 32]))
@pytest.mark.parametrize("what", first(["stopped", "calm", "asked"]))
def test_whatever_the_letters_all_that_is_pressed_is_on_the_screen_and_free(
    browser: Browser, tmp_path: Path, letters: int, what: str
) -> None:
    with (
        letters_of(browser, letters) as large,
        Bare(tmp_path, STANDS) as robot,
        served(robot.connect) as server,
    ):
        page = driving_phone(large, server, 390, 780)
        calm = STANDS._replace(arming=Arming.ARMED)
        stops = what == "stopped"
        robot.status = calm._replace(stopped=REASON, alarms=TOLD) if stops else calm
        expect(page.get_by_role("button", name="Reset")).to_have_count(int(stops))
        if what == "asked":
            request_control(page_of(large, server), page)
        for width, height in SIZES:
            page.set_viewport_size({"width": width, "height": height})
            page.wait_for_timeout(100)
            assert page.evaluate(UNREACHABLE) == [], (width, height)


@pytest.mark.slow  # nothing moves wrongly by it
@pytest.mark.parametrize(("width", "height"), first([(1024, 600), (740, 330), (390, 780)]))
def test_with_large_letters_what_removes_a_waypoint_is_whole(
    browser: Browser, tmp_path: Path, width: int, height: int
) -> None:
    with (
        letters_of(browser, 32) as large,
        Bare(tmp_path, STANDS) as robot,
        served(robot.connect) as server,
    ):
        page = driving_phone(large, server, width, height)
        robot.bulk.publish(Polyline(LineKind.WAYPOINTS, np.array([[1, 2], [-13, 4]], np.float32)))
        panel = page.get_by_role("dialog", name="Edit the route")

        def open_anew() -> None:  # with the route that has come by then
            if panel.is_visible():
                panel.get_by_role("button", name="Close").tap()
            page.get_by_role("button", name="Edit route").tap()

        removes = panel.get_by_role("button", name="Remove waypoint 1")
        do_until(lambda: expect(removes).to_have_count(1, timeout=1_000), open_anew)
        assert removes.evaluate(WHOLE)
        assert panel.get_by_role("list").evaluate("(one) => one.scrollWidth <= one.clientWidth")


@pytest.mark.parametrize(("width", "height"), first([(700, 800), (700, 450)]))
def test_a_narrow_window_without_touch_keeps_no_room_for_pads_that_it_does_not_show(
    context: BrowserContext, tmp_path: Path, width: int, height: int
) -> None:
    with Bare(tmp_path, STANDS) as robot, served(robot.connect) as server:
        page = page_of(context, server)
        page.set_viewport_size({"width": width, "height": height})
        take(page)
        expect(page.locator(".pad").first).to_be_hidden()
        lowest = "[...document.querySelectorAll('.station > *')].map(lowest)"
        lowest = lowest.replace("lowest", "(one) => one.getBoundingClientRect().bottom")
        assert max(page.evaluate(lowest)) >= height - 15
        side, authority = (page.locator(one).bounding_box() for one in ("aside", ".authority"))
        assert side is not None
        assert authority is not None
        assert side["x"] <= authority["x"]
        assert authority["x"] + authority["width"] <= side["x"] + side["width"]
        assert side["y"] <= authority["y"]


def test_a_number_that_is_out_of_the_normal_is_marked_by_more_than_its_colour(
    context: BrowserContext, tmp_path: Path
) -> None:
    mark = "(one) => getComputedStyle(one, '::before').content.replace(/[^◆]/g, '')"
    with Bare(tmp_path, STANDS) as robot, served(robot.connect) as server:
        page = page_of(context, server)
        clearance = page.locator(".nearest b")
        expect(clearance).to_have_text("0.20 m")
        assert clearance.evaluate(mark) == "◆"
        robot.status = STANDS._replace(clearance_seen=1.0)
        expect(clearance).to_have_text("1.00 m")
        assert clearance.evaluate(mark) == ""
