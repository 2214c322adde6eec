"""The keyboard's focus where what had it goes away."""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path

import pytest
from playwright.sync_api import BrowserContext, Error, Locator, Page, expect

from cohelm.link.bulk_messages import Alarms, WholeAlarm
from cohelm.link.messages import MOST_ALARMS, Alarm, Mode, RequestKind, Severity
from cohelm.station.serve import Server
from tests.few import first
from tests.link.ends import STATUS
from tests.station.bare import Bare
from tests.station.person import SOON, page_of, until, who
from tests.station.servers import served

STANDS = STATUS._replace(mode=Mode.HOLD, why="idle")


def undriven(context: BrowserContext, server: Server) -> Page:
    page = page_of(context, server)
    expect(who(page)).to_contain_text("No driver")
    return page


def enter(button: Locator) -> None:
    button.focus()
    button.page.keyboard.press("Enter")


def opened(opener: Locator, on: str) -> Locator:
    """The dialog that it opens, with the focus in it: on its button of that name, if any.

    Once more where it is gone by then: a list of alarms closes when a busy machine has none.
    """
    page = opener.page
    dialog = page.get_by_role("dialog")
    button = dialog.get_by_role("button", name=on)

    def again() -> None:
        if not dialog.count():
            enter(opener)
        page.keyboard.press("Tab")
        if on:
            with suppress(Error):
                button.focus(timeout=SOON)

    focused = page.locator(":focus")
    wanted = button.and_(focused) if on else dialog.locator(":focus")
    until(lambda: expect(wanted).to_have_count(1, timeout=SOON), again)
    return dialog


@pytest.mark.slow  # nothing moves wrongly by it
def test_what_was_pressed_and_is_gone_leaves_the_focus_to_its_group(
    context: BrowserContext, tmp_path: Path
) -> None:
    with Bare(tmp_path, STANDS) as robot, served(robot.connect) as server:
        page = undriven(context, server)
        until(
            lambda: expect(who(page)).to_be_focused(timeout=SOON),
            lambda: enter(page.get_by_role("button", name="Take over")),
        )
        page.keyboard.press("Enter")  # one too many
        page.keyboard.press("Tab")
        expect(page.get_by_role("button", name="Release")).to_be_focused()
        robot.status = STANDS._replace(stopped="stop by anna (3)", why="")
        enter(page.get_by_role("button", name="Reset"))
        robot.status = STANDS
        expect(page.get_by_role("group", name="Stop")).to_be_focused()
        alarms = [Alarm(n, Severity.WARNING, False, False, f"warning {n}") for n in (1, 2)]
        for left in (1, 0):
            robot.status = STANDS._replace(alarms=tuple(alarms[: left + 1]))
            acknowledge = page.get_by_role("button", name="Acknowledge")
            expect(acknowledge).to_have_count(left + 1)
            enter(acknowledge.last)
            robot.status = STANDS._replace(alarms=tuple(alarms[:left]))
            expect(page.get_by_label("Alarms", exact=True)).to_be_focused()
        assert RequestKind.GIVE not in robot.requests


@pytest.mark.parametrize(
    ("width", "height"), first([(1280, 800), (390, 780), (740, 330), (820, 1180)])
)
def test_stop_is_what_keys_and_ears_reach_first(
    context: BrowserContext, tmp_path: Path, width: int, height: int
) -> None:
    stopped = STANDS._replace(stopped="stop by anna (3)", why="")
    with Bare(tmp_path, stopped) as robot, served(robot.connect) as server:
        page = undriven(context, server)
        page.set_viewport_size({"width": width, "height": height})
        page.keyboard.press("Tab")
        expect(page.get_by_role("button", name="Stop the robot")).to_be_focused()
        controls = page.locator("button, a, input, select, [role=slider]")
        expect(controls.first).to_have_accessible_name(re.compile("^Stop the robot"))


@pytest.mark.slow  # nothing moves wrongly by it
def test_a_dialog_that_is_closed_leaves_the_focus_to_what_opened_it(
    context: BrowserContext, tmp_path: Path
) -> None:
    with Bare(tmp_path, STANDS) as robot, served(robot.connect) as server:
        page = undriven(context, server)
        told = tuple(Alarm(n, Severity.WARNING, True, False, f"warning {n}") for n in range(1, 7))
        robot.status = STANDS._replace(alarms=told[:MOST_ALARMS])
        robot.bulk.publish(Alarms(tuple(WholeAlarm(one, one.text) for one in told)))
        for name in ("Edit route", "Stick settings", "2 more"):
            opener = page.get_by_role("button", name=name)
            for key in ("Escape", "Enter"):
                dialog = opened(opener, on="Close" if key == "Enter" else "")
                page.keyboard.press(key)
                expect(dialog).to_have_count(0)
                expect(opener).to_be_focused()


@pytest.mark.slow  # nothing moves wrongly by it
def test_escape_closes_one_dialog_at_a_time_the_last_that_was_opened_first(
    context: BrowserContext, tmp_path: Path
) -> None:
    (tmp_path / "run.mcap").write_bytes(b"record")
    with Bare(tmp_path, STANDS) as robot, served(robot.connect) as server:
        page = undriven(context, server)
        told = tuple(Alarm(n, Severity.WARNING, True, False, f"warning {n}") for n in range(1, 7))
        robot.status = STANDS._replace(alarms=told[:MOST_ALARMS])
        robot.bulk.publish(Alarms(tuple(WholeAlarm(one, one.text) for one in told)))
        names = ("Edit route", "2 more", "Stick settings", "Records (1)")
        openers = [page.get_by_role("button", name=name) for name in names]
        dialogs = page.get_by_role("dialog")
        for count, opener in enumerate(openers, 1):
            enter(opener)
            expect(dialogs).to_have_count(count)
        page.get_by_role("list", name="Records on the robot").get_by_role("link").focus()
        for left, opener in zip((3, 2, 1, 0), reversed(openers), strict=True):
            page.keyboard.down("Escape")
            for _ in range(3):  # held down, it is pressed once
                page.keyboard.down("Escape")
            page.keyboard.up("Escape")
            expect(opener).to_be_focused()
            expect(dialogs).to_have_count(left)
            expect(opener).to_have_attribute("aria-expanded", "false")


@pytest.mark.slow  # nothing moves wrongly by it
@pytest.mark.parametrize("name", first(["Edit route", "Stick settings", "Records (0)"]))
def test_a_double_click_opens_a_dialog_and_another_closes_it(
    context: BrowserContext, tmp_path: Path, name: str
) -> None:
    with Bare(tmp_path, STANDS) as robot, served(robot.connect) as server:
        opener = undriven(context, server).get_by_role("button", name=name)
        for count in (1, 0):
            opener.dblclick()
            opener.page.wait_for_timeout(200)
            expect(opener.page.get_by_role("dialog")).to_have_count(count)
            opener.page.wait_for_timeout(600)  # else it is a fourfold click


@pytest.mark.slow  # nothing moves wrongly by it
def test_a_waypoint_removed_with_the_keyboard_leaves_the_focus_in_the_list(
    context: BrowserContext, tmp_path: Path
) -> None:
    with Bare(tmp_path, STANDS) as robot, served(robot.connect) as server:
        page = undriven(context, server)
        enter(page.get_by_role("button", name="Edit route"))
        enter(page.get_by_role("button", name="Add in the middle"))
        enter(page.get_by_role("button", name="Remove waypoint 1"))
        expect(page.get_by_role("dialog", name="Edit the route")).to_be_focused()
        page.keyboard.press("Escape")
        expect(page.get_by_role("button", name="Edit route")).to_be_focused()


def test_a_button_that_enter_is_held_on_is_pressed_once(
    context: BrowserContext, tmp_path: Path
) -> None:
    with Bare(tmp_path, STANDS) as robot, served(robot.connect) as server:
        page = undriven(context, server)
        page.get_by_role("button", name="Zoom in").focus()
        page.evaluate(
            "window.clicks = 0; addEventListener('click', () => (window.clicks += 1), true)"
        )
        for _ in range(5):
            page.keyboard.down("Enter")
        page.keyboard.up("Enter")
        assert page.evaluate("window.clicks") == 1
