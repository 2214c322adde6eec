"""Driving in a browser: keyboard, gamepad, touch."""

import itertools
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, BrowserContext, Page, expect

from cohelm.link.bulk_messages import Hello
from cohelm.link.messages import RequestKind
from cohelm.station.serve import Server
from tests.few import first
from tests.link.ends import STATUS
from tests.patience import OwnTime
from tests.station.bare import Bare
from tests.station.person import (
    LEFT,
    RIGHT,
    SOON,
    STILL,
    alarms,
    choose,
    device,
    drive,
    free,
    given,
    keep,
    lead,
    mode_button,
    page_of,
    release,
    request_control,
    stopped,
    take,
    until,
    who,
)
from tests.station.servers import Robot, served

pytestmark = pytest.mark.xdist_group("realtime")
PAD = (Path(__file__).parent / "gamepad.js").read_text(encoding="utf-8")


def plug(page: Page, axes: str = "") -> None:
    """Load the page again with a gamepad, whose axes are centred or as they are given."""
    page.add_init_script(PAD)
    page.reload()
    page.evaluate(f"testPad.plug({axes})")


def test_take_over_drive_with_the_keyboard_and_release(page: Page) -> None:
    expect(who(page)).to_contain_text("No driver")
    drive(page)
    lead(page, "ArrowLeft", LEFT)  # which has pressed that mode, and chooses no other
    expect(mode_button(page, "Manual", pressed=True)).to_be_focused()
    page.keyboard.up("ArrowLeft")
    expect(given(page)).to_contain_text(STILL)
    # of a group of these a screen reader says that arrow keys choose
    expect(page.get_by_role("radio")).to_have_count(0)
    release(page)


SECOND_CLICK = """() => {
    let first = NaN
    window.apart = Infinity
    addEventListener('click', () => (first = performance.now()), { capture: true, once: true })
    new MutationObserver((_, watching) => {
        const there = [...document.querySelectorAll('button')]
        const release = there.find((one) => one.textContent === 'Release')
        if (release === undefined) return
        watching.disconnect()
        window.apart = performance.now() - first
        release.click()
    }).observe(document.body, { childList: true, subtree: true, characterData: true })
}"""
"""As soon as Release stands where Take over was pressed; `apart`: how long after that [ms]."""


@pytest.mark.slow  # nothing moves by it
def test_a_double_click_on_take_over_does_not_release(page: Page) -> None:
    def twice() -> None:
        release(page)
        page.evaluate(SECOND_CLICK)
        take(page)

    def in_time() -> None:  # a robot that answers late is released by two clicks
        assert page.evaluate("apart") < 500

    until(in_time, twice)
    page.wait_for_timeout(700)
    expect(who(page)).to_contain_text("You drive")
    release(page)


@pytest.mark.slow  # what is said: test_page_connection; nothing moves by it
def test_keys_without_effect_show_what_to_do_first(page: Page) -> None:
    stop = page.get_by_role("button", name="Stop the robot")
    place = stop.bounding_box()
    page.keyboard.down("ArrowUp")
    expect(alarms(page)).to_contain_text("does not steer: press Take over first")
    assert stop.bounding_box() == place  # who reaches for it then must find it
    page.keyboard.up("ArrowUp")
    expect(alarms(page)).not_to_contain_text("does not steer")
    take(page)
    free(page)
    page.keyboard.down("ArrowUp")
    how = "mode is Hold; release it, then choose Shared or Manual"
    expect(alarms(page)).to_contain_text(f"does not steer: {how}")
    page.keyboard.up("ArrowUp")
    release(page)


@pytest.mark.slow
def test_keys_in_a_field_do_not_steer(page: Page) -> None:
    drive(page)
    page.get_by_role("button", name="Stick settings").click()
    page.get_by_label("stop button").focus()
    page.keyboard.down("a")
    page.wait_for_timeout(300)
    expect(given(page)).to_contain_text(STILL)
    page.keyboard.up("a")
    release(page)


@pytest.mark.parametrize("how", first(["space on a button", "space", "button"]))
def test_stop_stops_and_only_the_driver_resets_it(page: Page, how: str) -> None:
    drive(page)
    lead(page, "ArrowLeft", LEFT)
    if how == "button":
        page.get_by_role("button", name="Stop the robot").click()
    else:
        if how == "space on a button":
            page.get_by_role("button", name="Release").focus()
        page.keyboard.press("Space")
    expect(given(page)).to_contain_text(STILL)
    expect(stopped(page)).to_be_visible()
    page.keyboard.up("ArrowLeft")
    expect(who(page)).to_contain_text("You drive")
    release(page)
    expect(page.get_by_role("button", name="Reset")).to_be_disabled()
    drive(page)
    expect(stopped(page)).to_be_hidden()
    release(page)


def test_a_gamepad_must_be_centred_before_it_steers(context: BrowserContext, page: Page) -> None:
    plug(page, "[-1, 0, 0, 0]")
    drive(page)
    expect(device(page)).to_contain_text("release it to the centre")
    expect(page.get_by_role("alert", name="Alarms")).to_contain_text("Your stick does not steer")
    expect(given(page)).to_contain_text(STILL)
    page.evaluate("testPad.deflect(0, 0)")
    expect(device(page)).to_contain_text("gamepad: ready")
    page.evaluate("testPad.deflect(0, 1)")
    expect(given(page)).to_contain_text(LEFT)
    page.evaluate("testPad.deflect(0, -1)")
    expect(given(page)).to_contain_text(RIGHT)
    page.evaluate("testPad.deflect(0, 0)")
    expect(given(page)).to_contain_text(STILL)
    release(page)


@pytest.mark.slow  # tests/drive/test_resume.py has it without a browser
def test_a_mode_does_not_begin_with_a_gamepad_that_lies_on_its_side(page: Page) -> None:
    plug(page)
    take(page)
    free(page)
    expect(device(page)).to_contain_text("gamepad: ready")
    page.evaluate("testPad.hold(0, 1)")
    expect(alarms(page)).to_contain_text("does not steer: mode is Hold; release it")
    choose(page, "Manual")
    expect(alarms(page)).to_contain_text("does not steer: waiting for your stick to be centred")
    page.wait_for_timeout(400)
    expect(given(page)).to_contain_text(STILL)
    page.evaluate("testPad.deflect(0, 0)")
    expect(device(page)).to_contain_text("gamepad: ready")
    page.evaluate("testPad.deflect(0, 1)")
    expect(given(page)).to_contain_text(LEFT)
    page.evaluate("testPad.deflect(0, 0)")
    release(page)


def test_an_unplugged_gamepad_is_a_lost_stick(page: Page) -> None:
    plug(page)
    drive(page)
    expect(device(page)).to_contain_text("gamepad: ready")
    page.evaluate("testPad.deflect(0, 1)")
    expect(given(page)).to_contain_text(LEFT)
    page.evaluate("testPad.unplug()")
    alarms = page.get_by_role("alert", name="Alarms")
    expect(alarms).to_contain_text("the gamepad is disconnected")
    expect(given(page)).to_contain_text(STILL)
    expect(stopped(page)).to_be_visible()
    alarm = alarms.locator(".alarm").filter(has=page.get_by_role("button", name="Acknowledge"))
    alarm.get_by_role("button").first.click()
    # with the pad back in its place, and centred, the driver lets it go on
    page.evaluate("testPad.plug([-1, 0, 0, 0])")
    expect(device(page)).to_contain_text("release it to the centre")
    page.evaluate("testPad.deflect(0, 0)")
    free(page)
    choose(page, "Manual")
    expect(device(page)).to_contain_text("gamepad: ready")
    page.evaluate("testPad.deflect(0, 1)")
    expect(given(page)).to_contain_text(LEFT)
    page.evaluate("testPad.deflect(0, 0)")
    release(page)


def test_after_a_stop_only_a_long_press_on_the_gamepad_resumes(
    page: Page,
) -> None:
    plug(page)
    drive(page)

    def hold(seconds: float) -> None:  # by the page's own clock: a short one is no long one
        page.evaluate(
            """(ms) => new Promise((done) => {
                testPad.press(0, true)
                setTimeout(() => done(testPad.press(0, false)), ms)
            })""", 1000.0 * seconds,
        )  # fmt: skip

    expect(device(page)).to_contain_text("gamepad: ready")
    expect(alarms(page)).not_to_contain_text("To continue")
    page.evaluate("testPad.press(0, true)")  # held before the stop, and on
    page.keyboard.press("Space")
    expect(alarms(page)).to_contain_text("To continue: release A or ✕ of the gamepad first")
    page.wait_for_timeout(1200)
    page.evaluate("testPad.press(0, false)")
    how = "hold A or ✕ of the gamepad for a second, stick centred, and release it"
    expect(alarms(page)).to_contain_text(f"To continue: {how}: resets the stop")
    hold(0.4)
    page.evaluate("testPad.deflect(0, 1)")
    hold(1.2)
    page.evaluate("testPad.deflect(0, 0)")
    expect(alarms(page)).to_contain_text(f"{how}: resets the stop")
    expect(stopped(page)).to_be_visible()
    until(lambda: expect(stopped(page)).to_be_hidden(timeout=4_000), lambda: hold(1.2))
    expect(mode_button(page, "Hold", pressed=True)).to_be_visible()
    expect(alarms(page)).to_contain_text(f"{how}: continues in Manual")
    manual = mode_button(page, "Manual", pressed=True)
    until(lambda: expect(manual).to_be_visible(timeout=4_000), lambda: hold(1.2))
    expect(given(page)).to_contain_text(STILL)
    expect(alarms(page)).not_to_contain_text("To continue")
    page.evaluate("testPad.deflect(0, 1)")
    expect(given(page)).to_contain_text(LEFT)
    page.evaluate("testPad.deflect(0, 0)")
    release(page)
    expect(alarms(page)).not_to_contain_text("To continue")


@pytest.mark.slow
def test_a_gamepad_without_any_change_counts_as_lost(page: Page) -> None:
    """Its battery is flat, or it is out of reach: the receiver shows the last it heard."""
    plug(page)
    drive(page)
    expect(device(page)).to_contain_text("gamepad: ready")
    page.evaluate("testPad.hold(0, 0.6)")
    expect(given(page)).to_contain_text(LEFT)
    page.wait_for_timeout(4_000)  # a hand trembles
    expect(device(page)).to_contain_text("gamepad: ready")
    page.evaluate("clearInterval(testPad.hand)")
    expect(device(page)).to_contain_text("the gamepad has sent nothing new for 3 s")
    expect(given(page)).to_contain_text(STILL)
    page.evaluate("testPad.deflect(0, 0.7)")  # it is back, and was not centred
    expect(device(page)).to_contain_text("release it to the centre first")
    expect(given(page)).to_contain_text(STILL)
    page.evaluate("testPad.deflect(0, 0)")
    free(page)
    choose(page, "Manual")
    expect(device(page)).to_contain_text("gamepad: ready")
    release(page)


@pytest.mark.slow
def test_a_key_that_was_held_when_the_window_lost_the_focus_must_be_pressed_again(
    page: Page,
) -> None:
    drive(page)
    page.keyboard.down("ArrowLeft")
    expect(given(page)).to_contain_text(LEFT)
    page.evaluate("document.hasFocus = () => false; dispatchEvent(new Event('blur'))")
    expect(given(page)).to_contain_text(STILL)
    page.evaluate("delete document.hasFocus; dispatchEvent(new Event('focus'))")
    free(page)
    choose(page, "Manual")
    page.keyboard.down("ArrowLeft")  # as a key that is held repeats itself
    page.wait_for_timeout(600)
    expect(given(page)).to_contain_text(STILL)
    page.keyboard.up("ArrowLeft")
    page.keyboard.down("ArrowLeft")
    expect(given(page)).to_contain_text(LEFT)
    page.keyboard.up("ArrowLeft")
    release(page)


@pytest.mark.slow  # a busy machine makes gaps of its own
def test_a_page_that_hangs_for_a_moment_continues_in_its_mode(
    browser: Browser, robot: Robot
) -> None:
    with served(robot.connect, stale=0.25) as server:
        page = browser.new_page()
        page.add_init_script(PAD)
        page.goto(server.address)
        page.evaluate("testPad.plug()")
        drive(page)
        expect(device(page)).to_contain_text("gamepad: ready")
        page.evaluate("testPad.hold(0, 0.6)")
        expect(given(page)).to_contain_text(LEFT)
        page.evaluate("{ const end = performance.now() + 600; while (performance.now() < end); }")
        expect(page.get_by_role("alert", name="Alarms")).to_contain_text(
            "waiting for your stick to be centred"
        )
        expect(given(page)).to_contain_text(STILL)
        page.evaluate("testPad.deflect(0, 0)")
        expect(device(page)).to_contain_text("gamepad: ready")
        expect(stopped(page)).to_be_hidden()
        page.evaluate("testPad.hold(0, 0.6)")
        expect(given(page)).to_contain_text(LEFT)
        expect(mode_button(page, "Manual", pressed=True)).to_be_visible()
        page.evaluate("testPad.deflect(0, 0)")
        release(page)
        page.close()


@pytest.mark.slow  # it is some way to the next wall
def test_the_gamepad_rumbles_near_an_obstacle(page: Page) -> None:
    plug(page)
    drive(page)
    expect(device(page)).to_contain_text("gamepad: ready")
    assert page.evaluate("testPad.rumbles.length") == 0
    page.evaluate("testPad.hold(1, 0)")

    def rumbled() -> None:
        assert page.evaluate("testPad.rumbles.length") > 5

    def stronger() -> None:  # the nearer it is
        strong = page.evaluate("testPad.rumbles.map(r => r.strongMagnitude)")
        assert 0.0 < strong[0] < strong[-1] <= 1.0

    for seen in (rumbled, stronger):
        until(seen, lambda: page.wait_for_timeout(500))
    page.evaluate("testPad.deflect(0, 0)")
    page.get_by_role("button", name="Stick settings").click()
    page.get_by_label("rumble near obstacles").uncheck()
    count = page.evaluate("testPad.rumbles.length")
    page.wait_for_timeout(600)
    assert page.evaluate("testPad.rumbles.length") == count
    release(page)


@pytest.mark.slow
def test_the_stop_button_of_the_gamepad_stops(page: Page) -> None:
    plug(page)
    drive(page)
    page.evaluate("testPad.press(1, true)")
    expect(stopped(page)).to_be_visible()
    release(page)


@pytest.mark.slow  # nothing moves wrongly by it
def test_stick_settings_are_stored(page: Page) -> None:
    plug(page)
    page.get_by_role("button", name="Stick settings").click()
    page.get_by_label("dead band").fill("0.5")
    page.get_by_label("inverted").first.uncheck()
    page.reload()
    page.evaluate("testPad.plug()")
    page.get_by_role("button", name="Stick settings").click()
    expect(page.get_by_label("dead band")).to_have_value("0.5")
    expect(page.get_by_label("inverted").first).not_to_be_checked()
    drive(page)
    page.evaluate("testPad.deflect(0, 0.45)")
    page.wait_for_timeout(400)
    expect(given(page)).to_contain_text(STILL)
    release(page)


@pytest.mark.parametrize("how", first(["hidden", "blurred"]))
def test_a_hidden_tab_does_not_steer(page: Page, how: str) -> None:
    drive(page)
    lead(page, "ArrowLeft", LEFT)
    if how == "hidden":
        page.evaluate(
            "Object.defineProperty(document, 'visibilityState', {value: 'hidden'});"
            "document.dispatchEvent(new Event('visibilitychange'))"
        )
    else:
        page.evaluate("document.hasFocus = () => false; dispatchEvent(new Event('blur'))")
    expect(given(page)).to_contain_text(STILL)
    expect(stopped(page)).to_be_visible()
    release(page)


@pytest.mark.slow
def test_touch_pads_steer_on_a_phone(browser_phone: BrowserContext, server: Server) -> None:
    page = page_of(browser_phone, server)
    take(page)
    free(page)
    choose(page, "Manual")
    screen = page.viewport_size
    assert screen is not None
    for name in ("Stop the robot", "Release"):
        box = page.get_by_role("button", name=name).bounding_box()
        assert box is not None
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= screen["width"]
        assert box["height"] >= 34
    assert page.evaluate("document.documentElement.scrollWidth") <= screen["width"]
    pad = page.get_by_role("slider", name="Left and right").bounding_box()
    assert pad is not None
    x, y = pad["x"] + pad["width"] / 2, pad["y"] + pad["height"] / 2
    touch = browser_phone.new_cdp_session(page)
    touch.send("Input.dispatchTouchEvent", _touch("touchStart", x, y))
    touch.send("Input.dispatchTouchEvent", _touch("touchMove", x - 60, y))
    expect(given(page)).to_contain_text(LEFT)
    touch.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    expect(given(page)).to_contain_text(STILL)
    for panel in ("Camera", "Plots", "Link", "Drive"):
        page.get_by_role("navigation").get_by_role("button", name=panel).tap()
        expect(page.get_by_role("button", name="Stop the robot")).to_be_in_viewport()
    release(page)


@pytest.mark.parametrize(
    ("button", "asked"),
    first([("Stop the robot", RequestKind.STOP), ("Manual", RequestKind.MODE)]),
)
def test_a_button_is_pressed_by_a_second_finger_while_a_thumb_is_on_a_pad(
    browser_phone: BrowserContext, tmp_path: Path, button: str, asked: RequestKind
) -> None:
    with Bare(tmp_path, STATUS) as robot, served(robot.connect) as server:
        page = page_of(browser_phone, server)
        who(page).get_by_role("button", name="Take over").wait_for()
        take(page)
        pad, pressed = page.locator(".pad.x"), page.get_by_role("button", name=button)
        points = [
            {"x": box["x"] + box["width"] / 2, "y": box["y"] + box["height"] / 2, "id": finger}
            for finger, box in enumerate((pad.bounding_box(), pressed.bounding_box()))
            if box is not None
        ]
        touch = browser_phone.new_cdp_session(page)
        for kind, fingers in (
            ("touchStart", points[:1]), ("touchStart", points), ("touchEnd", points[1:]),
        ):  # fmt: skip
            touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": fingers})
        with OwnTime() as own:
            while asked not in robot.requests:
                assert own.now() < 5.0
                page.wait_for_timeout(50)
        touch.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})


def test_a_phone_in_landscape_shows_the_map_and_both_touch_pads(
    browser_phone: BrowserContext, server: Server
) -> None:
    """Nothing that is pressed lies under anything else, and most of it is the map."""
    page = browser_phone.new_page()
    page.set_viewport_size({"width": 740, "height": 330})  # a small one, within the browser's bars
    page.goto(server.address)
    who(page).get_by_role("button", name="Take over").wait_for()
    take(page)
    boxes = [
        page.get_by_role(role, name=name).bounding_box()
        for role, name in (
            ("slider", "Forward and back"), ("slider", "Left and right"), ("button", "Manual"),
            ("button", "Stop the robot"), ("button", "Release"), ("button", "Camera"),
        )
    ]  # fmt: skip
    for box in boxes:
        assert box is not None
        assert box["width"] >= 44
        assert box["height"] >= 33
        assert 0 <= box["x"] <= box["x"] + box["width"] <= 740
        assert 0 <= box["y"] <= box["y"] + box["height"] <= 330
    for one, other in itertools.combinations(filter(None, boxes), 2):
        apart_x = abs(2 * (one["x"] - other["x"]) + one["width"] - other["width"])
        apart_y = abs(2 * (one["y"] - other["y"]) + one["height"] - other["height"])
        assert (
            apart_x >= one["width"] + other["width"] or apart_y >= one["height"] + other["height"]
        )
    # an alarm of a busy machine takes a line of its own
    acknowledge = page.get_by_role("button", name="Acknowledge")
    until(
        lambda: expect(acknowledge).to_have_count(0, timeout=SOON),
        lambda: acknowledge.first.click() if acknowledge.count() else None,
    )
    seen = page.locator("#map").bounding_box()
    assert seen is not None
    assert seen["width"] >= 0.6 * 740
    assert seen["height"] >= 0.6 * 330
    release(page)


@pytest.mark.slow  # layouts of a phone held sideways: above and below
@pytest.mark.parametrize("width", [740, 667])
def test_on_a_phone_in_landscape_reset_and_route_are_not_covered(
    browser_phone: BrowserContext, page: Page, server: Server, width: int
) -> None:
    phone = browser_phone.new_page()
    phone.set_viewport_size({"width": width, "height": 330})
    phone.goto(server.address)
    who(phone).get_by_role("button", name="Take over").wait_for()
    take(phone)
    phone.get_by_role("button", name="Stop the robot").tap()
    expect(stopped(phone)).to_contain_text("stop by you")
    expect(stopped(page)).to_contain_text("stop by operator")  # as the page calls it
    question = request_control(page, phone)
    names = ("Reset", "Hand over", "Keep", "Stop the robot")
    boxes = [phone.get_by_role("button", name=name).bounding_box() for name in names]
    for name, box in zip(names, boxes, strict=True):
        assert box is not None
        assert 0 <= box["x"] < box["x"] + box["width"] <= width, name
    for one, other in itertools.combinations(filter(None, boxes), 2):
        apart_x = abs(2 * (one["x"] - other["x"]) + one["width"] - other["width"])
        apart_y = abs(2 * (one["y"] - other["y"]) + one["height"] - other["height"])
        assert (
            apart_x >= one["width"] + other["width"] or apart_y >= one["height"] + other["height"]
        )
    keep(phone, question)
    phone.get_by_role("button", name="Edit route").tap()
    panel = phone.get_by_role("dialog", name="Edit the route")
    panel.get_by_role("button", name="Add in the middle").tap()
    panel.get_by_role("button", name="Close").tap()
    expect(phone.get_by_role("slider", name="Left and right")).to_be_visible()


@pytest.mark.slow  # a layout
@pytest.mark.parametrize(
    ("width", "height"), first([(390, 780), (740, 330), (320, 568), (820, 1180)])
)
def test_a_long_reason_covers_nothing_that_is_pressed(
    browser_phone: BrowserContext, tmp_path: Path, width: int, height: int
) -> None:
    """The robot's own words may be long; between the thumbs there is little room."""
    reason = "the robot reports: motor controller: undervoltage on channel 2 of the left drive"
    told = STATUS._replace(stopped=reason, why=f"{reason}; check battery and fuse F3")
    with Bare(tmp_path, told) as robot, served(robot.connect) as server:
        robot.bulk.publish(
            Hello("cart", np.zeros((3, 2), np.float32), 2.0, 1.0, (np.nan,) * 4, False)  # type: ignore[arg-type]
        )
        page = browser_phone.new_page()
        page.set_viewport_size({"width": width, "height": height})
        page.goto(server.address)
        who(page).get_by_role("button", name="Take over").wait_for()
        take(page)
        expect(alarms(page)).not_to_contain_text("No link")  # else there are two of them yet
        until(lambda: _check_free(page), lambda: page.wait_for_timeout(100))
        seen = page.locator(".authority .why")
        expect(seen).to_contain_text("check battery")
        box = seen.bounding_box()
        assert box is not None
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= width
        if width >= 390:  # all of it; on a smaller one the rest is below, and in the stop's box
            assert seen.evaluate("(one) => one.scrollHeight <= one.clientHeight + 1")
        robot.die()  # what is old is pale, and stays where it was
        expect(page.locator(".station.stale")).to_have_count(1)
        if min(width, height) >= 390:  # on a smaller one two long alarms leave no room for all
            until(lambda: _check_free(page), lambda: page.wait_for_timeout(100))


def _check_free(page: Page) -> None:
    assert _covered(page) == []


def _covered(page: Page) -> list[str]:
    """What is pressed or slid, and lies under a fact of the panel between the thumbs."""
    return [
        name
        for role, name in (
            ("button", "Hold"), ("button", "Shared"), ("button", "Auto"), ("button", "Manual"),
            ("button", "Reset"), ("button", "Plots"), ("slider", "Share of the full speed"),
            ("slider", "Forward and back"), ("slider", "Left and right"),
        )
        if page.get_by_role(role, name=name).evaluate(
            "(one) => { const box = one.getBoundingClientRect();"
            " return [...document.querySelectorAll('.authority p, .authority tr, .dial, .pad')]"
            " .filter((e) => !e.contains(one))"
            " .map((e) => e.getBoundingClientRect())"
            " .some((b) => b.width * b.height > 0 && b.left < box.right - 1"
            " && b.right > box.left + 1 && b.top < box.bottom - 1 && b.bottom > box.top + 1) }"
        )
    ]  # fmt: skip


def _touch(kind: str, x: float, y: float) -> dict[str, object]:
    return {"type": kind, "touchPoints": [{"x": x, "y": y, "id": 1}]}
