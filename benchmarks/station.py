"""The station's page in headless Chromium: frames of the map, camera to pixel, stick to server.

    python -m benchmarks.station [--seconds 20]

What Chromium draws without a GPU is the least that any operator gets. A test pattern stands in for
the robot: a map of 1000 x 1000 cells, a scan of 720 beams at 30 Hz, a camera of 640 x 480 at 15 Hz,
status at 50 Hz; what is measured is server, WebSocket, page and pixels.
"""

from __future__ import annotations

import argparse
import io
import math
import statistics
import threading
import time
import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image
from playwright.sync_api import Page, sync_playwright

from cohelm.core.types import Pose, Twist
from cohelm.link import bulk_messages as b, messages as m
from cohelm.link.codec import Reader, layout
from cohelm.link.station_end import LinkState
from cohelm.station.robot_link import News
from cohelm.station.serve import Server

CHROMIUM = "/usr/bin/chromium"
FLAGS = [
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
]  # fmt: skip
PAD = Path(__file__).parents[1] / "tests" / "station" / "gamepad.js"
BEAMS, CELLS, CAMERA_HZ, SCAN_HZ, STATUS_HZ = 720, 1000, 15.0, 30.0, 50.0
NAN = math.nan


class Pattern:
    """The messages of a robot that drives round in circles."""

    def __init__(self) -> None:
        self.pictures: dict[int, float] = {}
        self.sticks: list[tuple[float, float]] = []
        self._begun = time.monotonic()
        self._counts = {"status": 0, "scan": 0, "picture": 0}
        self._first = True
        rng = np.random.default_rng(1)
        self._jpegs = [_jpeg(rng) for _ in range(8)]

    def news(self) -> list[News]:
        """All messages that are due."""
        t = time.monotonic() - self._begun
        out: list[News] = []
        if self._first:
            self._first = False
            out += [News(message, 0.0, 0.0) for message in _still()]
        pose = Pose(3.0 * math.cos(0.2 * t), 3.0 * math.sin(0.2 * t), 0.2 * t + math.pi / 2)
        if self._due("status", t * STATUS_HZ):
            out.append(News(_status(pose), t, 0.0))
        if self._due("scan", t * SCAN_HZ):
            step = math.radians(270.0) / (BEAMS - 1)
            wave = 4000.0 + 500.0 * np.sin(0.05 * np.arange(BEAMS) + 3.0 * t)
            scan = m.ScanPart(
                self._counts["scan"], 0, t, pose, BEAMS, 0, -0.75 * math.pi, step,
                wave.astype(np.uint16),
            )  # fmt: skip
            out.append(News(scan, t, 0.0))
        if self._due("picture", t * CAMERA_HZ):
            n = self._counts["picture"]
            self.pictures[n] = time.time()
            out.append(News(b.Picture(n, t, pose, self._jpegs[n % len(self._jpegs)]), t, 0.0))
        return out

    def _due(self, what: str, count: float) -> bool:
        if count < self._counts[what]:
            return False
        self._counts[what] = int(count) + 1
        return True

    def steer(self, command: m.Command) -> None:
        """Record the arrival time of each deflection."""
        self.sticks.append((time.time(), command.stick.psi))

    def ask(self, what: m.RequestKind, value: int = 0) -> int:
        """Granted."""
        return 1

    def answer(self, number: int) -> m.Answer | None:
        """Granted."""
        return m.Answer(number, True, "")

    def propose(self, points: Sequence[tuple[float, float]], only_check: bool) -> int:
        """Not here."""
        return 1

    def fetch(self, name: str, offset: int = 0, size: int = 0) -> None:
        """Not here."""

    def state(self) -> LinkState:
        """Perfect."""
        return LinkState(True, "a test pattern", "", 0.0, 0.0, 0.0)

    def close(self) -> None:
        """Nothing to do."""


def _jpeg(rng: np.random.Generator) -> bytes:
    """A picture of 640 x 480 with the detail of a room."""
    small = rng.integers(0, 255, (60, 80, 3), dtype=np.uint8)
    file = io.BytesIO()
    Image.fromarray(small).resize((640, 480)).save(file, "JPEG", quality=75)
    return file.getvalue()


def _still() -> list[b.FromRobot]:
    cells = (np.random.default_rng(0).random((CELLS, CELLS)) > 0.9).astype(np.uint8) * 100
    outline = np.array([(-0.36, -0.29), (0.36, -0.29), (0.36, 0.29), (-0.36, 0.29)], np.float32)
    angle = np.linspace(0.0, 2.0 * math.pi, 400)
    circle = 3.0 * np.column_stack((np.cos(angle), np.sin(angle)))
    return [
        b.Hello("pattern", outline, 0.8, 1.5, (1.05, 0.3, 0.5, 0.1), False),
        b.Map(1, Pose(-25.0, -25.0, 0.0), 0.05, CELLS, CELLS, 0, 0, CELLS, CELLS,
              zlib.compress(cells.tobytes())),
        b.Polyline(b.LineKind.REFERENCE, circle.astype(np.float32)),
    ]  # fmt: skip


_NOTHING: m.Status = layout(m.Status).read(Reader(bytes(1000)))


def _status(pose: Pose) -> m.Status:
    twist = Twist(0.6, 0.2)
    c, s = math.cos(pose.psi), math.sin(pose.psi)
    ahead = tuple((pose.x + 0.1 * k * c, pose.y + 0.1 * k * s) for k in range(12))
    return _NOTHING._replace(
        lease=m.Lease(1, 1, "bench", 0, "", NAN), mode=m.Mode.SHARED, arming=m.Arming.ARMED,
        authority=1.0, pose=pose, measured=twist, nominal=twist, applied=twist, clearance_seen=1.0,
        limiting=(NAN, NAN), h=1.0, e_p=0.1, reference=pose, speed_cap=math.inf,
        localised=m.Localised.GOOD, sigma=0.01, ahead=ahead, ahead_step=0.15,
    )  # fmt: skip


def quantiles(values: list[float]) -> str:
    """Median, 95 % and 99 %."""
    values = sorted(values)
    at = [values[min(int(q * len(values)), len(values) - 1)] for q in (0.5, 0.95, 0.99)]
    return "{:.1f} / {:.1f} / {:.1f} ms (median / 95 % / 99 %, n = {})".format(*at, len(values))


def main() -> None:
    """Measure, and print; half of the time around the robot, half with the whole map."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0)
    seconds = 0.5 * parser.parse_args().seconds
    pattern = Pattern()
    server = Server(lambda _: pattern, "127.0.0.1", 0, stale=2.0)
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.add_init_script(PAD.read_text(encoding="utf-8"))
        page.goto(server.address)
        page.locator("#camera[data-number]").wait_for()
        _measure(page, pattern, seconds)
        browser.close()
    server.stop()
    thread.join(5.0)


def _frames(page: Page, seconds: float) -> str:
    page.wait_for_timeout(2000)  # frames are counted over a second
    rates: list[float] = []
    for _ in range(max(int(seconds) - 2, 2)):
        page.wait_for_timeout(1000)
        rates.append(float(page.locator("#map").get_attribute("data-fps") or 0))
    return f"{statistics.median(rates):.0f} frames/s (worst second {min(rates):.0f})"


def _measure(page: Page, pattern: Pattern, seconds: float) -> None:
    page.evaluate(
        """() => {
          window.drawn = []
          const canvas = document.getElementById('camera')
          new MutationObserver(() => drawn.push([Number(canvas.dataset.number),
            performance.timeOrigin + performance.now()]))
            .observe(canvas, {attributeFilter: ['data-number']})
          window.moved = []
          testPad.plug()
          let side = 1
          const again = () => {
            side = -side
            moved.push([performance.timeOrigin + performance.now(), side])
            testPad.deflect(0, side)
            setTimeout(again, 90 + Math.random() * 40)
          }
          setTimeout(again, 500)
        }"""
    )
    near = _frames(page, seconds)
    for _ in range(5):
        page.get_by_role("button", name="Farther").click()
    whole = _frames(page, seconds)
    drawn: list[tuple[int, float]] = page.evaluate("drawn")
    moved: list[tuple[float, float]] = page.evaluate("moved")
    camera = [at - 1e3 * pattern.pictures[n] for n, at in drawn if n in pattern.pictures]
    sticks: list[float] = []
    for at, side in moved[:-1]:
        later = [t for t, psi in pattern.sticks if 1e3 * t >= at - 1.0 and psi * side > 0.5]
        if later:
            sticks.append(1e3 * later[0] - at)
    print(f"map around the robot: {near}")
    print(f"the whole map: {whole}")
    print(
        f"camera, message to pixel: {quantiles(camera)}; {0.5 * len(camera) / seconds:.1f} a second"
    )
    print(f"stick, moved to the link's door: {quantiles(sticks)}")


if __name__ == "__main__":
    main()
