"""Login with one click; the token is left nowhere."""

from __future__ import annotations

import logging
from collections.abc import Iterator

import pytest
from playwright.sync_api import BrowserContext, Page, Request, expect

from cohelm.core.errors import CohelmError
from cohelm.station.robot_link import RobotLink
from cohelm.station.serve import Server
from tests.link.ends import until
from tests.station.bare import Bare
from tests.station.person import alarms, page_of, who
from tests.station.servers import served

pytestmark = pytest.mark.xdist_group("realtime")


@pytest.fixture
def server(bare: Bare) -> Iterator[Server]:
    with served(bare.connect) as made:
        yield made


def inside(page: Page) -> None:
    expect(who(page)).to_contain_text("No driver")


def test_the_token_is_required_and_the_printed_address_has_it(
    context: BrowserContext, server: Server
) -> None:
    page = context.new_page()
    page.goto(f"{server.origin}/")
    for typed, wrong in (("guess", True), (server.address, True), (server.token, False)):
        page.get_by_label("Token").fill(typed + "x" * wrong)
        page.get_by_role("button", name="Log in").click()
        if wrong:
            expect(page.get_by_role("alert")).to_contain_text("Wrong token")
    inside(page)


@pytest.mark.slow  # the token alone: above
@pytest.mark.parametrize("typed", ["address", "token"])
def test_the_login_takes_the_token_or_the_whole_address(
    context: BrowserContext, server: Server, typed: str
) -> None:
    page = context.new_page()
    page.goto(f"{server.origin}/")
    page.get_by_label("Token").fill(getattr(server, typed))
    page.get_by_label("Token").press("Enter")
    inside(page)


def test_one_click_on_the_printed_address_logs_in(
    context: BrowserContext, server: Server, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG)
    asked: list[Request] = []
    page = context.new_page()
    page.on("request", lambda request: asked.append(request))
    wrong: list[str] = []
    page.on("console", lambda said: wrong.append(said.text) if said.type == "error" else None)
    page.goto(server.address)
    inside(page)
    assert len(server.station.operators) == 1
    assert wrong == []
    # ... and what let it in is neither in the address line, nor in a cookie, a log or a Referer
    assert page.url == f"{server.origin}/"
    assert page.evaluate("history.length") <= 2
    assert context.cookies() == []
    said = [request.url for request in asked] + [str(request.all_headers()) for request in asked]
    said = [text for text in said if "#token=" not in text]  # the browser's own word for the first
    assert not any(server.token in text for text in said)
    session = page.evaluate("localStorage.getItem('cohelm.session')")
    assert session
    assert server.token not in caplog.text
    assert session not in caplog.text


def test_further_tabs_share_the_login_and_other_origins_do_not(
    context: BrowserContext, server: Server, bare: Bare
) -> None:
    page = page_of(context, server)
    inside(page)
    second = context.new_page()
    second.goto(f"{server.origin}/")
    inside(second)
    until(lambda: len(server.station.operators) == 2)
    with served(bare.connect) as other:  # another port of this machine, as another user's would be
        third = context.new_page()
        shown: list[dict[str, str]] = []
        third.on("request", lambda request: shown.append(request.all_headers()))
        third.goto(f"{other.origin}/")
        third.get_by_label("Token").wait_for()
        session = page.evaluate("localStorage.getItem('cohelm.session')")
        assert third.evaluate("localStorage.length") == 0
        assert not any(session in str(headers) for headers in shown)


@pytest.mark.slow
def test_a_login_in_one_tab_logs_in_the_waiting_tabs(
    context: BrowserContext, server: Server
) -> None:
    waiting = context.new_page()
    waiting.goto(f"{server.origin}/")
    waiting.get_by_label("Token").wait_for()
    page = page_of(context, server)
    inside(page)
    waiting.bring_to_front()
    inside(waiting)


def test_the_station_dies_and_comes_back_while_the_page_stays_open(
    context: BrowserContext, bare: Bare
) -> None:
    with served(bare.connect) as server:
        page = page_of(context, server)
        inside(page)
        port = server.port
    expect(alarms(page)).to_contain_text("No connection to the station")
    with served(bare.connect, port=port) as again:
        page.get_by_label("Token").wait_for()  # it is another station now: the session is nothing
        expect(page.get_by_role("alert").first).to_contain_text("the station was started anew")
        assert not again.station.operators
        page.goto(again.address)  # only what follows the # is new
        expect(alarms(page)).to_have_text("No alarms")
        inside(page)


@pytest.mark.slow  # nothing moves wrongly by it
def test_the_address_of_an_earlier_start_is_said_to_be_one(
    context: BrowserContext, server: Server
) -> None:
    """Who opened the printed address must not read that it is to be opened."""
    page = context.new_page()
    page.goto(f"{server.origin}/#token={'x' * 22}")
    expect(page.get_by_role("alert")).to_contain_text("Wrong token")
    expect(page.get_by_role("alert")).to_contain_text("the newest one")


@pytest.mark.slow  # nothing moves wrongly by it
def test_a_page_that_never_gets_a_connection_says_so(
    context: BrowserContext, server: Server
) -> None:
    """As behind a proxy that lets no WebSocket through."""
    page = context.new_page()
    page.route_web_socket("**/ws*", lambda socket: socket.close())
    page.goto(server.address)
    expect(alarms(page)).to_contain_text("No connection yet: the station does not answer")


@pytest.mark.slow  # nothing moves wrongly by it
def test_a_page_that_the_station_turns_away_says_why_for_as_long(context: BrowserContext) -> None:
    """Where the robot's host is not known, which may last until its WiFi is there."""

    def connect(_: str) -> RobotLink:
        raise CohelmError("the host 'robot.local' can not be found: check its name")

    with served(connect) as server:
        page = page_of(context, server)
        expect(alarms(page)).to_contain_text(
            "No connection yet: the host 'robot.local' can not be found: check its name"
        )
