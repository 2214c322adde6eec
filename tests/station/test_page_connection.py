"""The page's connection: a STOP is never lost, and a connection that hangs is made anew."""

from __future__ import annotations

import time
from collections.abc import Iterator

import pytest
from playwright.sync_api import BrowserContext, Page, expect

from cohelm.link.messages import RequestKind
from cohelm.station import app
from cohelm.station.serve import Server
from tests.station.bare import Bare
from tests.station.conftest import WAIT
from tests.station.person import who
from tests.station.servers import served

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


def shown(context: BrowserContext, server: Server, script: str = "") -> Page:
    page = context.new_page()
    page.add_init_script(script)
    page.goto(server.address)
    return page


def connected(page: Page) -> None:
    who(page).get_by_role("status").wait_for()


def requested(bare: Bare, what: RequestKind, within: float = WAIT / 1e3) -> bool:
    end = time.monotonic() + within
    while time.monotonic() < end:
        if what in bare.requests:
            return True
        time.sleep(0.02)
    return False


def test_space_on_a_slider_or_a_number_stops(
    context: BrowserContext, station: Server, bare: Bare
) -> None:
    page = shown(context, station)
    connected(page)
    page.get_by_role("button", name="Stick settings").click()
    for field in ("Share of the full speed", "dead band", "stop button"):
        page.evaluate("document.querySelectorAll('input').forEach((one) => (one.disabled = false))")
        bare.requests.clear()
        page.get_by_label(field).focus()
        page.keyboard.press("Space")
        assert requested(bare, RequestKind.STOP), field
    bare.requests.clear()
    page.get_by_label("device").focus()
    page.keyboard.press("Space")
    assert not requested(bare, RequestKind.STOP, 0.3)


def test_a_stop_passes_a_connection_that_is_full(
    context: BrowserContext, station: Server, bare: Bare
) -> None:
    page = shown(context, station, FULL)
    connected(page)
    bare.requests.clear()
    page.keyboard.press("Space")
    assert requested(bare, RequestKind.STOP)


def test_a_stop_without_a_connection_is_shown_and_sent_on_the_next(
    context: BrowserContext, bare: Bare
) -> None:
    with served(bare.connect) as station:
        page = shown(context, station)
        connected(page)
        port = station.port
    alarms = page.get_by_role("alert", name="Alarms")
    expect(alarms).to_contain_text("No connection to the station")
    bare.requests.clear()
    page.keyboard.press("Space")
    expect(alarms).to_contain_text("STOP is not sent yet")
    with served(bare.connect, port=port) as again:
        page.evaluate("""async (token) => {
            const answer = await fetch('./session', { method: 'POST', body: token })
            localStorage.setItem('cohelm.session', await answer.text())
        }""", again.token)  # fmt: skip
        page.evaluate("dispatchEvent(new StorageEvent('storage', "
                      "{ key: 'cohelm.session', newValue: 'new' }))")  # fmt: skip
        assert requested(bare, RequestKind.STOP)
        expect(alarms).not_to_contain_text("STOP is not sent yet")


def test_a_connection_that_hangs_is_made_anew(context: BrowserContext, station: Server) -> None:
    page = shown(context, station, HANGING)
    connected(page)


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
    page = shown(context, station)
    expect(page.locator(".refused")).to_contain_text("too many operators")
