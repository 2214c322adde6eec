"""Station, browser and WiFi fail and return in every order during a drive.

The robot is `cohelm robot` at the other end of a network of real packets, the station is the
command, the browser is Chromium; each is killed as a power cut would. What the robot did meanwhile
is read from its record. Opt-in: `pytest -m slow tests/station/test_killing.py`.
"""

from __future__ import annotations

import itertools
import os
import re
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

import pytest
from playwright.sync_api import Browser, Page, expect

from cohelm.loop.stick import BACK_WITHIN, ArmingParams
from cohelm.robot.gate.modes import GateMode
from tests.drive.far import PORT, FarRobot
from tests.drive.test_far import BRAKING, PERIOD, Row, rows
from tests.link import net
from tests.station.conftest import CHROMIUM, FLAGS, HALL
from tests.station.person import (
    SOON,
    STILL,
    alarms,
    given,
    lead,
    press,
    stopped,
    until,
    who,
)

WHY_NOT = net.why_not()
pytestmark = [
    pytest.mark.slow,
    pytest.mark.xdist_group("realtime"),
    pytest.mark.skipif(bool(WHY_NOT), reason=f"no network can be made: {WHY_NOT}"),
]
THINGS = ("station", "browser", "WiFi")
APART = 0.1
"""From one to the next [s]: the robot still moves when the third one dies."""
STARTS = 60.0
"""A station, or a page, on a busy machine [s]."""
HELD_UP = 0.25
"""A loop may be held up by the watchdog's 0.1 s, and the clock that is read here by as much [s]."""
FAST = re.compile(r"applied\s*−?0\.[3-9]")
LOST = re.compile(
    r"lost: (no valid stick input|no command for|there is no driver|the newest command)"
)

TIMES = 4
"""So often a case is tried: on a busy machine a robot may stop by its watchdog before it begins."""


class Case(NamedTuple):
    """Things in the order in which they die, and in which they come back."""

    die: tuple[str, ...]
    come: tuple[str, ...]


ORDERS = list(itertools.permutations(THINGS))
CASES = [
    *(Case((thing,), (thing,)) for thing in THINGS),
    *(Case(*both) for both in zip(ORDERS, ORDERS[3:] + ORDERS[:3], strict=True)),
]


class Dark(NamedTuple):
    """From the first death until a person drives again, by the wall clock [s]."""

    case: Case
    since: float
    until: float


class Operator:
    """A station, a browser and a network, each of which can be killed and brought back."""

    def __init__(self, network: net.Network, browser: Browser, folder: Path) -> None:
        self._network, self._launch = network, browser.browser_type.launch
        self._folder = folder
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self._port = free.getsockname()[1]
        self._inside = folder / "chromium-inside"
        side = network.station_side
        self._inside.write_text(
            f"#!/bin/sh\necho $$ > {folder}/browser.pid\n"
            f'exec nsenter --net=/proc/{os.getpid()}/fd/{side} {CHROMIUM} "$@"\n'
        )
        self._inside.chmod(0o755)
        self.page: Page | None = None
        self.back("station")
        self.back("browser")

    def kill(self, thing: str) -> None:
        """At once."""
        if thing == "station":
            self._station.kill()
            self._station.communicate()
        elif thing == "browser":
            pid = int((self._folder / "browser.pid").read_text())
            assert os.getpgid(pid) == pid  # its own group, as it may be a script that starts it
            os.killpg(pid, signal.SIGKILL)
            self.page = None
        else:
            self._network.be(loss=1.0)

    def back(self, thing: str) -> None:
        """As a person would bring it back."""
        if thing == "station":
            command = [sys.executable, "-m", "cohelm", "station", "--port", str(self._port)]
            with self._network.station():
                self._station = subprocess.Popen(
                    [*command, "--robot", f"{net.ROBOT}:{PORT}"],
                    stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
                )  # fmt: skip
            assert self._station.stdout is not None
            self._address = self._station.stdout.readline().strip()
        elif thing == "browser":
            self._browser = self._launch(executable_path=self._inside, args=FLAGS)
            self.page = self._browser.new_page(viewport={"width": 1280, "height": 800})
        else:
            self._network.be()

    def opened(self) -> Page:
        """The page, loaded (again)."""
        page = self.page
        assert page is not None
        page.goto("about:blank")
        page.goto(self._address)
        return page

    def close(self) -> None:
        """End all."""
        self._browser.close()
        self._station.terminate()
        self._station.communicate()


def take(page: Page) -> None:
    """Of nobody, or of an operator who is not there any more."""

    def ask() -> None:
        press(page, "Take over")()
        press(page, "Request control")()

    until(lambda: expect(who(page)).to_contain_text("You drive", timeout=SOON), ask)


def test_the_robot_is_safe_when_station_browser_and_wifi_fail_in_any_order(
    browser: Browser, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    left: list[Case] = [*CASES]
    for number in range(TIMES):
        folder = tmp_path / str(number)
        folder.mkdir()
        monkeypatch.setenv("COHELM_KEYS", str(folder / "keys"))
        left = tried(left, browser, folder)
        if not left:
            return
    raise AssertionError(f"the robot stopped by itself before these could begin: {left}")


def tried(cases: list[Case], browser: Browser, folder: Path) -> list[Case]:
    """Which of them did not count, because the robot did not drive any more when they began."""
    darks: list[Dark] = []
    with net.Network() as network:
        robot = FarRobot(network, str(HALL), folder)
        try:
            operator = Operator(network, browser, folder)
            try:
                page = operator.opened()
                for number, case in enumerate(cases):
                    logged = len(robot.log.read_text())
                    take(page)
                    lead(page, "ArrowUp" if number % 2 == 0 else "ArrowDown", FAST)
                    begun = time.time()
                    page = dies_and_returns(robot, operator, case, logged)
                    darks.append(Dark(case, begun, time.time()))
            finally:
                operator.close()
        finally:
            robot.end()
    all_ = rows(robot.record)
    return [d.case for d in darks if not judged([r for r in all_ if d.since < r.at < d.until], d)]


def dies_and_returns(robot: FarRobot, operator: Operator, case: Case, logged: int) -> Page:
    """Kill things while the robot drives, bring them back; the page that says what happened."""
    for i, thing in enumerate(case.die):
        time.sleep(APART if i else 0.0)
        operator.kill(thing)
    robot.logged(r"(?s)-> (STOPPED|FAULTED): (?!.*-> ).*stands, \d", logged)
    if operator.page is not None:
        expect(alarms(operator.page)).to_contain_text(
            "No connection to the station" if "station" in case.die else "No link to the robot"
        )
    for thing in case.come:
        operator.back(thing)
    page = operator.opened()
    expect(stopped(page)).to_be_visible()
    expect(alarms(page)).to_contain_text(LOST)
    expect(given(page)).to_contain_text(STILL)
    return page


def judged(all_: list[Row], dark: Dark) -> bool:
    """Stopped in time, and standing until somebody let it drive; False: it had stopped before."""
    name = f"dying: {', '.join(dark.case.die)}; coming back: {', '.join(dark.case.come)}"
    if all_[0].mode != GateMode.SHARED or abs(all_[0].v) < 0.2:
        print(f"{name}: it had stopped before")
        return False
    latched = next(row.at for row in all_ if row.mode in (GateMode.STOPPED, GateMode.FAULTED))
    # it brakes at once, and latches when nobody has come back within a second
    standing = next(row.at for row in all_ if row.at > dark.since and abs(row.v) < 0.02)
    print(
        f"{name}: stood {1e3 * (standing - dark.since):.0f} ms after the first, "
        f"latched after {1e3 * (latched - dark.since):.0f} ms"
    )
    noticed = ArmingParams().stale + PERIOD + HELD_UP
    assert standing - dark.since < noticed + BRAKING + PERIOD + 0.1, name
    assert latched - dark.since < BACK_WITHIN + noticed, name
    assert all(row.given == 0.0 for row in all_ if row.at > standing + 0.3), name
    return True
