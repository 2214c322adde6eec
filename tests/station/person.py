"""Operates the page in a browser by accessible names, and retries what had no effect.

A request that reached nobody within a second is not done later (docs/link.md), so on a machine that
is busy with other tests one press may not be enough; a person presses again, and so do these.
"""

import re
import time
from collections.abc import Callable
from contextlib import suppress

from playwright.sync_api import BrowserContext, Error, Locator, Page, expect

from cohelm.station.serve import Server

LEFT = re.compile(r"m/s\s*(?!0\.00)\d\.\d\d rad/s")
RIGHT = re.compile(r"m/s\s*−\d\.\d\d rad/s")
STILL = re.compile(r"applied\s*0\.00 m/s\s*0\.00 rad/s")
"""What the wheels are given, as the screen says it."""
SOON = 4_000
"""When a person would press again [ms]."""
AT_ONCE = 1_000
"""When one would press again what the page may have taken for the second half of a double click: of
who drives what comes within 600 ms [ms]."""
PATIENCE = 60.0
"""When even a patient person gives up [s]."""


def page_of(context: BrowserContext, server: Server, script: str = "") -> Page:
    """The station's page in a browser. script: run in it before its own."""
    page = context.new_page()
    if script:
        page.add_init_script(script)
    page.goto(server.address)
    return page


def who(page: Page) -> Locator:
    return page.get_by_role("group", name="Who drives")


def given(page: Page) -> Locator:
    return page.get_by_role("row", name="applied")


def device(page: Page) -> Locator:
    return page.locator(".device")


def stopped(page: Page) -> Locator:
    return page.locator(".stopped")


def alarms(page: Page) -> Locator:
    return page.get_by_label("Alarms", exact=True)


def mode_button(page: Page, name: str, pressed: bool | None = None) -> Locator:
    """pressed: only where it is the robot's mode, or is not; None: either."""
    modes = page.get_by_role("group", name="Mode", exact=True)
    return modes.get_by_role("button", name=name, pressed=pressed)


def press(page: Page, name: str) -> Callable[[], None]:
    """Presses the button of this name, if it is there and can be pressed."""

    def once() -> None:
        button = page.get_by_role("button", name=name)
        if button.is_visible() and button.is_enabled():
            with suppress(Error):  # it went away just now
                button.click(timeout=SOON)

    return once


def until(seen: Callable[[], object], do: Callable[[], object]) -> None:
    """Do it, and again until it is `seen`, which raises AssertionError as long as it is not."""
    end = time.monotonic() + PATIENCE
    while True:
        do()
        try:
            seen()
        except AssertionError:
            if time.monotonic() > end:
                raise
        else:
            return


def take(page: Page) -> None:
    """Become the driver of a robot that nobody drives."""
    who(page).get_by_role("status").wait_for()  # else the first press is of a button yet to come
    until(
        lambda: expect(who(page)).to_contain_text("You drive", timeout=AT_ONCE),
        press(page, "Take over"),
    )


def control_requested(driver: Page) -> Locator:
    """The question, which is answered in ten seconds or not."""
    return driver.get_by_role("alert").filter(has_text="requests control")


def request_control(page: Page, driver: Page) -> Locator:
    """Ask for control. Returns: the driver's question."""
    question = control_requested(driver)
    until(lambda: expect(question).to_be_visible(timeout=SOON), press(page, "Request control"))
    return question


def keep(page: Page, question: Locator) -> None:
    until(lambda: expect(question).to_be_hidden(timeout=SOON), press(page, "Keep"))


def free(page: Page) -> None:
    """Have the robot let go of a stop."""
    until(lambda: expect(stopped(page)).to_be_hidden(timeout=SOON), press(page, "Reset"))


def choose(page: Page, mode: str) -> None:
    """A mode, as the robot tells it back."""
    until(
        lambda: expect(mode_button(page, mode, pressed=True)).to_be_visible(timeout=SOON),
        lambda: mode_button(page, mode).click(),
    )


def drive(page: Page, mode: str = "Manual") -> None:
    """Take the robot and have it listen to the stick."""
    take(page)
    free(page)
    choose(page, mode)


def lead(page: Page, key: str, seen: re.Pattern[str]) -> None:
    """Hold a key in manual mode until the wheels are given what is `seen`.

    Where the machine held up the page for so long that the robot stopped, have it drive again.
    """

    def again() -> None:
        page.keyboard.up(key)
        press(page, "Reset")()
        choose(page, "Manual")
        page.keyboard.down(key)

    until(lambda: expect(given(page)).to_contain_text(seen, timeout=SOON), again)


def release(page: Page) -> None:
    until(
        lambda: expect(who(page)).to_contain_text("No driver", timeout=AT_ONCE),
        press(page, "Release"),
    )
