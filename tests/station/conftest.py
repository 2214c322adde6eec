"""Shared robot, browser and server; tests are skipped where one of them is missing."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, BrowserContext, Page, expect, sync_playwright

from cohelm.station.serve import Server
from tests.station.bare import Bare
from tests.station.servers import Robot, served

SHELL, WHOLE = Path("/usr/bin/chromium-headless-shell"), Path("/usr/bin/chromium")
CHROMIUM = WHOLE if WHOLE.exists() and not SHELL.exists() else SHELL
"""Without windows, of which nothing is seen here, it takes a third less of the processor."""
FLAGS = [
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
]  # fmt: skip
HALL = Path(__file__).parent / "hall.yaml"
TWIN = os.environ.get("COHELM_TEST_ROBOT") == "twin"
"""Drive the physics twin, which is slower to make and to drive, and not the kinematic robot."""
WAIT = 30_000
"""Tests share their machine: what comes late is still right [ms]."""
expect.set_options(timeout=WAIT)


@pytest.fixture(scope="package")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    made = Robot(str(HALL), TWIN, tmp_path_factory.mktemp("records"))
    yield made
    made.close()


@pytest.fixture(autouse=True)
def _tidy(request: pytest.FixtureRequest) -> None:
    """Every test that drives finds the robot as if none had driven it before."""
    if "robot" in request.fixturenames:
        request.getfixturevalue("robot").tidy()


@pytest.fixture(scope="module")
def server(robot: Robot) -> Iterator[Server]:
    with served(robot.connect) as made:
        yield made


@pytest.fixture(scope="module")
def bare(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bare]:
    """A robot's ends of the link alone, for who tries the station and not the robot."""
    with Bare(tmp_path_factory.mktemp("records")) as made:
        yield made


@pytest.fixture(scope="package")
def browser() -> Iterator[Browser]:
    if not CHROMIUM.exists():
        pytest.skip(f"no browser at {CHROMIUM}; Debian: apt-get install {CHROMIUM.name}")
    with sync_playwright() as playwright:
        made = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield made
        made.close()


@pytest.fixture
def context(browser: Browser) -> Iterator[BrowserContext]:
    made = browser.new_context(viewport={"width": 1280, "height": 800})
    made.set_default_timeout(WAIT)
    yield made
    made.close()


@pytest.fixture
def page(context: BrowserContext, server: Server) -> Iterator[Page]:
    """A page of the station, in which nothing goes wrong."""
    made = context.new_page()
    wrong: list[str] = []
    made.on("pageerror", lambda error: wrong.append(str(error)))
    made.on("console", lambda said: wrong.append(said.text) if said.type == "error" else None)
    made.goto(server.address)
    made.get_by_role("group", name="Who drives").get_by_role("status").wait_for()
    yield made
    assert wrong == []


@pytest.fixture
def browser_phone(browser: Browser) -> Iterator[BrowserContext]:
    """A phone held upright."""
    made = browser.new_context(
        viewport={"width": 390, "height": 780}, device_scale_factor=2, is_mobile=True,
        has_touch=True,
    )  # fmt: skip
    made.set_default_timeout(WAIT)
    yield made
    made.close()
