#!/usr/bin/env python3
"""Take the pictures of docs/station.md: real station, real link, the physics twin in the lab.

    .venv/bin/python tools/screenshots.py [--only NAME,...] [--out docs/pictures]

Needs chromium, as the tests do. One picture for every state an operator may meet.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import re
import signal
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
from PIL import Image
from playwright.sync_api import Browser, BrowserContext, Page, expect, sync_playwright

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from cohelm.drive.factory import Simulated, simulated  # noqa: E402
from cohelm.drive.playback import Playback  # noqa: E402
from cohelm.drive.replayed import Replaying  # noqa: E402
from cohelm.drive.session import SessionConfig  # noqa: E402
from cohelm.drive.teleop_server import TeleopConfig, serve  # noqa: E402
from cohelm.link import keys  # noqa: E402
from cohelm.link.keys import Keys  # noqa: E402
from cohelm.perceive.localize.map_from_geometry import map_from_geometry  # noqa: E402
from cohelm.robot.port import Readings  # noqa: E402
from cohelm.station.robot_link import Linked  # noqa: E402
from tests.station.conftest import CHROMIUM, FLAGS  # noqa: E402
from tests.station.person import (  # noqa: E402
    alarms,
    choose,
    device,
    drive,
    free,
    given,
    press,
    release,
    stopped,
    take,
    until,
)  # fmt: skip
from tests.station.servers import PATIENCE, Robot, served  # noqa: E402

PAD = (ROOT / "tests" / "station" / "gamepad.js").read_text(encoding="utf-8")
ROOM = [[-2.5, 17.2, 4.5, 20.0], [4.5, 20.0, -2.5, 22.8], [-2.5, 22.8, -2.5, 17.2]]
ELSEWHERE = 21.0
"""A room whose walls are at angles that none on the map are, and how far away it is [m]."""
SCREEN = {"width": 1280, "height": 800}
COLOURS = 128
_shots: dict[str, Callable[[Robot, Browser, Callable[[Page], None]], None]] = {}


def shot(of: Callable[[Robot, Browser, Callable[[Page], None]], None]) -> object:
    """Called with the robot standing and free, a browser, and what takes the picture."""
    _shots[of.__name__.replace("_", "-")] = of
    return of


@contextmanager
def opened(
    robot: Robot, browser: Browser, pad: bool = False, **options: object
) -> Iterator[tuple[Page, BrowserContext, str]]:
    """A page of a station of its own."""
    with served(robot.connect) as server:
        context = browser.new_context(**{"viewport": SCREEN, **options})  # type: ignore[arg-type]
        page = context.new_page()
        if pad:
            page.add_init_script(PAD)
        page.goto(server.address)
        expect(page.locator("#camera, .camera.none")).to_be_attached()  # on a phone behind a tab
        page.wait_for_timeout(1000)
        yield page, context, server.address
        context.close()


@shot
def station_auto(robot: Robot, browser: Browser, take_it: Callable[[Page], None]) -> None:
    with opened(robot, browser) as (page, _, _):
        drive(page, "Auto")
        page.wait_for_timeout(9000)
        take_it(page)
        release(page)


@shot
def station_drive(robot: Robot, browser: Browser, take_it: Callable[[Page], None]) -> None:
    with opened(robot, browser) as (page, _, _):
        drive(page, "Shared")
        page.wait_for_timeout(3000)
        page.keyboard.down("ArrowUp")
        page.keyboard.down("ArrowLeft")
        page.wait_for_timeout(1200)
        take_it(page)
        page.keyboard.up("ArrowLeft")
        page.keyboard.up("ArrowUp")
        release(page)


@shot
def station_guard(robot: Robot, browser: Browser, take_it: Callable[[Page], None]) -> None:
    with opened(robot, browser) as (page, _, _):
        drive(page)
        page.keyboard.down("ArrowUp")
        held = re.compile("limited|braking|standing: no")
        still = re.compile(r"applied\s*0\.0\d m/s")
        expect(page.locator(".why.abnormal")).to_have_text(held, timeout=90_000)
        expect(given(page)).to_contain_text(still, timeout=60_000)
        expect(page.locator(".why.abnormal")).to_have_text(held, timeout=90_000)
        take_it(page)
        page.keyboard.up("ArrowUp")
        release(page)


@shot
def station_stop(robot: Robot, browser: Browser, take_it: Callable[[Page], None]) -> None:
    with opened(robot, browser) as (page, _, _):
        drive(page, "Auto")
        page.wait_for_timeout(2500)
        page.keyboard.press("Space")
        expect(stopped(page)).to_be_visible()
        page.wait_for_timeout(1500)
        take_it(page)
        free(page)
        release(page)


@shot
def station_alarm(robot: Robot, browser: Browser, take_it: Callable[[Page], None]) -> None:
    with opened(robot, browser, pad=True) as (page, _, _):
        page.evaluate("testPad.plug()")
        drive(page)
        expect(device(page)).to_contain_text("gamepad: ready")
        page.evaluate("testPad.deflect(0, -1)")
        page.wait_for_timeout(800)
        page.evaluate("testPad.unplug()")
        expect(alarms(page)).to_contain_text("the stick is lost")
        page.wait_for_timeout(1500)
        take_it(page)


@shot
def station_asked(robot: Robot, browser: Browser, take_it: Callable[[Page], None]) -> None:
    with opened(robot, browser) as (page, _, address):
        drive(page, "Hold")
        other = browser.new_context()
        second = other.new_page()
        second.goto(address)
        asks = page.get_by_role("alert").filter(has_text="requests control")
        until(lambda: expect(asks).to_be_visible(timeout=4000), press(second, "Request control"))
        take_it(page)
        other.close()


@shot
def station_route(robot: Robot, browser: Browser, take_it: Callable[[Page], None]) -> None:
    with opened(robot, browser) as (page, _, _):
        drive(page, "Hold")
        page.get_by_role("button", name="Edit route").click()
        panel = page.get_by_role("dialog", name="Edit the route")
        panel.get_by_role("button", name="Clear").click()
        for i, point in enumerate((("2", "-1.5"), ("4", "0"), ("6", "3"), ("9", "0")), 1):
            panel.get_by_role("button", name="Add in the middle").click()
            for axis, value in zip("xy", point, strict=True):
                panel.get_by_label(f"Waypoint {i}, {axis} in metres").fill(value)
        page.get_by_role("button", name="Show all").click()
        expect(panel.get_by_role("status")).to_contain_text("Refused")
        expect(panel.locator("li.bad")).to_have_count(1)
        page.wait_for_timeout(600)
        take_it(page)
        panel.get_by_role("button", name="Close").click()
        release(page)


@shot
def station_replay(robot: Robot, browser: Browser, take_it: Callable[[Page], None]) -> None:
    with opened(robot, browser) as (page, _, _):
        drive(page, "Hold")
        on = page.get_by_role("button", name="Stop recording")
        until(lambda: expect(on).to_be_visible(timeout=4000), press(page, "● Record"))
        choose(page, "Shared")
        page.wait_for_timeout(4000)
        page.keyboard.down("ArrowRight")
        page.wait_for_timeout(1500)
        page.keyboard.up("ArrowRight")
        page.wait_for_timeout(1500)
        until(lambda: expect(on).to_be_hidden(timeout=4000), press(page, "Stop recording"))
        records = page.get_by_role("button", name=re.compile(r"Records \([1-9]"))
        expect(records).to_be_visible(timeout=120_000)
        release(page)
    shown = Playback(next(robot.records.glob("*.mcap")))
    with served(lambda _: Replaying(shown)) as cinema:
        page = browser.new_context(viewport=SCREEN).new_page()  # type: ignore[arg-type]
        page.goto(cinema.address)
        place = page.get_by_role("slider", name="Position in the record, seconds")
        expect(place).to_be_visible()
        place.fill(f"{shown.duration - 7.0:.2f}")
        page.wait_for_timeout(4500)
        press(page, "Pause")()
        page.wait_for_timeout(500)
        take_it(page)
        page.context.close()


@shot
def station_login(robot: Robot, browser: Browser, take_it: Callable[[Page], None]) -> None:
    with served(robot.connect) as server:
        context = browser.new_context(viewport={"width": 640, "height": 420})
        page = context.new_page()
        page.goto(f"{server.origin}/")
        page.get_by_label("Token").fill("guess")
        page.get_by_role("button", name="Log in").click()
        expect(page.get_by_role("alert")).to_contain_text("Wrong token")
        take_it(page)
        context.close()


def _touched(
    robot: Robot, browser: Browser, width: int, height: int, take_it: Callable[[Page], None]
) -> None:
    size = {"width": width, "height": height}
    with opened(robot, browser, viewport=size, is_mobile=True, has_touch=True,
                device_scale_factor=1.5 if width < 500 else 1) as (page, _, _):  # fmt: skip
        take(page)
        free(page)
        choose(page, "Shared")
        page.wait_for_timeout(3000)
        box = page.get_by_role("slider", name="Left and right").bounding_box()
        assert box is not None
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        touch = page.context.new_cdp_session(page)
        for kind, at in (("touchStart", x), ("touchMove", x + 35)):
            points = [{"x": at, "y": y, "id": 1}]
            touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
        page.wait_for_timeout(1200)
        take_it(page)
        touch.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
        release(page)


@shot
def station_phone(robot: Robot, browser: Browser, take_it: Callable[[Page], None]) -> None:
    _touched(robot, browser, 390, 780, take_it)


@shot
def station_sideways(robot: Robot, browser: Browser, take_it: Callable[[Page], None]) -> None:
    _touched(robot, browser, 844, 390, take_it)


@shot
def station_tablet(robot: Robot, browser: Browser, take_it: Callable[[Page], None]) -> None:
    _touched(robot, browser, 1024, 768, take_it)


@shot
def station_link(robot: Robot, browser: Browser, take_it: Callable[[Page], None]) -> None:
    with opened(robot, browser) as (page, _, _):
        drive(page, "Auto")
        page.wait_for_timeout(3000)
        os.kill(robot.pid, signal.SIGSTOP)
        try:
            expect(alarms(page)).to_contain_text("No link to the robot", timeout=30_000)
            page.wait_for_timeout(1000)
            take_it(page)
        finally:
            os.kill(robot.pid, signal.SIGCONT)


@dataclass(frozen=True)
class Lifted(Simulated):
    """Somebody lifts it into a room that is not on its map, once there is the file `when`."""

    when: str = ""

    def maker(self) -> Callable[[], object]:  # noqa: D102 - as there
        return partial(_liftable, super().maker(), Path(self.when))


def _liftable(make: Callable[[], object], when: Path) -> object:
    return _Liftable(make(), when)


class _Liftable:
    def __init__(self, robot: object, when: Path) -> None:
        self._robot, self._when = robot, when

    def __getattr__(self, name: str) -> object:
        return getattr(self._robot, name)

    def read(self) -> Readings:
        if self._when.exists():
            self._when.unlink()
            self._robot.push(0.0, ELSEWHERE, 0.0)
        return self._robot.read()


def _driven(line: Connection, own: Keys, when: str) -> None:
    """The process of a robot that can be lifted."""
    made = simulated("lab-guard", "twin")
    walls = made.scenario.walls_m
    scenario = made.scenario.model_copy(update={"walls_m": [*walls, *ROOM]})
    robot = Lifted(scenario, made.kind, made.real_time, made.seed, when)
    known = map_from_geometry(np.array(walls), made.start)
    serve(
        SessionConfig(robot, known=known, patience=PATIENCE), TeleopConfig(own, "127.0.0.1"),
        line.send,
        lambda: "enough" if line.poll() else "",
    )  # fmt: skip


@shot
def station_lost(robot: Robot, browser: Browser, take_it: Callable[[Page], None]) -> None:
    of_robot, own = keys.pair_here()
    context = multiprocessing.get_context("spawn")
    line, theirs = context.Pipe()
    with tempfile.TemporaryDirectory() as folder:
        when = Path(folder) / "lift"
        process = context.Process(target=_driven, args=(theirs, of_robot, str(when)))
        process.start()
        try:
            host, port = line.recv()[:2]
            with served(lambda _: Linked(own, host, port)) as server:
                page = browser.new_context(viewport=SCREEN).new_page()  # type: ignore[arg-type]
                page.goto(server.address)
                drive(page, "Shared")
                page.wait_for_timeout(1500)
                when.touch()
                lost = "Localization is lost"
                expect(alarms(page)).to_contain_text(lost, timeout=60_000)
                page.wait_for_timeout(1500)
                take_it(page)
                page.context.close()
        finally:
            line.send("enough")
            process.join(60.0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default=",".join(_shots), help="which, with commas between")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "pictures")
    asked = parser.parse_args()
    if unknown := set(asked.only.split(",")) - set(_shots):
        parser.error(f"there is no {', '.join(sorted(unknown))}; there are {', '.join(_shots)}")
    with (
        tempfile.TemporaryDirectory() as records,
        sync_playwright() as playwright,
    ):
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        robot = Robot("lab-guard", True, Path(records))
        try:
            for name in asked.only.split(","):
                path = asked.out / f"{name}.png"

                def take_it(page: Page, path: Path = path) -> None:
                    page.screenshot(path=path)
                    with Image.open(path) as picture:
                        picture.convert("RGB").quantize(COLOURS).save(path, optimize=True)
                    print(f"{path}  {path.stat().st_size / 1000:.0f} kB", flush=True)

                robot.tidy()
                try:
                    _shots[name](robot, browser, take_it)
                except AssertionError as error:  # a busy machine; take it again with --only
                    print(f"{name}: {str(error).splitlines()[0]}", file=sys.stderr, flush=True)
        finally:
            robot.close()
            browser.close()


if __name__ == "__main__":
    main()
