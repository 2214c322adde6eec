"""What the page makes of gamepads, keys and fingers, and sends; no robot drives."""

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import BrowserContext, Page, expect

from cohelm.link.messages import Arming, Command, Device
from cohelm.station.serve import Server
from tests.link.ends import STATUS, until
from tests.station.bare import Bare
from tests.station.person import device, page_of, take, who
from tests.station.servers import served

PAD = (Path(__file__).parent / "gamepad.js").read_text(encoding="utf-8")


@pytest.fixture
def bare(tmp_path: Path) -> Iterator[Bare]:
    """A robot that always says that it has the stick."""
    with Bare(tmp_path, STATUS._replace(arming=Arming.ARMED)) as made:
        yield made


@pytest.fixture
def server(bare: Bare) -> Iterator[Server]:
    with served(bare.connect) as made:
        yield made


def sent(bare: Bare) -> Command:
    """The driver's newest command."""
    command = bare.end.receive().command
    assert command is not None
    return command


def commanded(bare: Bare, right: Callable[[Command], bool]) -> None:
    until(lambda: bare.end.receive().command is not None and right(sent(bare)))


@pytest.fixture
def driver(context: BrowserContext, server: Server) -> Page:
    """The page of a driver, with a gamepad to plug in."""
    page = context.new_page()
    page.add_init_script(PAD)
    page.goto(server.address)
    take(page)
    return page


def test_of_two_gamepads_the_other_does_not_steer_when_one_is_unplugged(
    bare: Bare, driver: Page
) -> None:
    driver.evaluate("layOther([-1, 0, 0, 0])")  # on the table, on its side
    driver.evaluate("testPad.plug()")
    commanded(bare, lambda one: one.armed and one.device is Device.GAMEPAD)
    driver.evaluate("testPad.unplug()")
    expect(device(driver)).to_contain_text("the gamepad is disconnected")
    commanded(bare, lambda one: one.stick == (0.0, 0.0) and not one.valid)
    # it is taken up by a button, and steers once it was centred
    driver.evaluate("layOther([-1, 0, 0, 0], [3])")
    expect(device(driver)).to_contain_text("release it to the centre")
    driver.evaluate("layOther([0, 0, 0, 0])")
    expect(device(driver)).to_contain_text("gamepad: ready")
    driver.evaluate("layOther([-1, 0, 0, 0])")
    commanded(bare, lambda one: one.armed and one.stick.psi == 1.0)
    driver.evaluate("layOther([0, 0, 0, 0])")


@pytest.mark.slow  # of two gamepads one drives: above
def test_a_spare_gamepad_that_is_bumped_takes_nothing_from_the_one_that_drives(
    bare: Bare, driver: Page
) -> None:
    driver.evaluate("testPad.plug()")
    commanded(bare, lambda one: one.armed and one.device is Device.GAMEPAD)
    driver.evaluate("layOther([0, 0, 0, 0], [3]); bumpOther()")
    driver.wait_for_timeout(200)
    driver.evaluate("testPad.hold(1, 0)")
    commanded(bare, lambda one: one.armed and one.stick.x > 0.9)
    driver.evaluate("testPad.deflect(0, 0)")


def test_a_gamepad_that_lies_on_its_side_does_not_keep_keys_and_another_gamepad_from_steering(
    bare: Bare, driver: Page
) -> None:
    """Its stick trembles as under a hand, so that it does not count as silent."""
    lie = "setInterval(lie = () => layOther([-1 + 0.01 * Math.random(), 0, 0, 0]), 50); lie()"
    driver.add_init_script(lie)
    driver.reload()
    expect(who(driver)).to_contain_text("You drive")  # a new driver starts from the centre
    expect(device(driver)).to_contain_text("gamepad: release it to the centre first")
    driver.keyboard.down("ArrowUp")
    commanded(bare, lambda one: one.armed and one.stick == (1.0, 0.0))
    driver.keyboard.up("ArrowUp")
    commanded(bare, lambda one: one.armed and one.valid and one.stick == (0.0, 0.0))
    driver.wait_for_timeout(200)
    assert sent(bare).armed
    driver.evaluate("testPad.plug()")
    commanded(bare, lambda one: one.armed and one.device is Device.GAMEPAD)
    # in the settings it can be given back, and is waited for again
    driver.get_by_role("button", name="Stick settings").click()
    which = driver.locator("label", has_text=re.compile("^gamepad")).get_by_role("combobox")
    which.select_option("2: Other pad")
    expect(device(driver)).to_contain_text("gamepad: release it to the centre first")
    which.select_option("1: Test pad")
    expect(device(driver)).to_contain_text("gamepad: ready")
    driver.evaluate("testPad.hold(1, 0)")
    commanded(bare, lambda one: one.armed and one.stick.x > 0.9 and one.stick.psi == 0.0)
    driver.evaluate("testPad.deflect(0, 0)")


@pytest.mark.slow  # nothing moves wrongly by it
def test_the_settings_show_what_is_moved_on_a_gamepad_without_the_usual_numbers(
    driver: Page,
) -> None:
    driver.evaluate("layOther([0, 0, -1, 0.25], [3])")
    driver.get_by_role("button", name="Stick settings").click()
    moved = driver.get_by_label("Moved now")
    expect(moved).to_have_text(
        "axis 0: 0.00 · axis 1: 0.00 · axis 2: −1.00 · axis 3: 0.25 · button 3"
    )
    driver.evaluate("layOther([0, 0, 0, 0])")
    expect(moved).not_to_contain_text("button")


def test_an_axis_that_is_chosen_in_the_settings_must_be_centred_before_it_steers(
    bare: Bare, driver: Page
) -> None:
    """As a trigger, which rests at one end."""
    driver.evaluate("setInterval(() => layOther([0, 0, -1 + 0.01 * Math.random(), 0]), 50)")
    driver.get_by_role("button", name="Stick settings").click()
    driver.locator(".settings select").first.select_option("gamepad")
    expect(device(driver)).to_contain_text("gamepad: ready")
    driver.get_by_role("combobox", name="left-right").select_option("axis 2")
    expect(device(driver)).to_contain_text("gamepad: release it to the centre first")
    commanded(bare, lambda one: not one.armed)
    driver.get_by_role("combobox", name="left-right").select_option("axis 0")
    expect(device(driver)).to_contain_text("gamepad: ready")


def test_the_dial_is_a_stick_under_the_mouse_and_springs_back(bare: Bare, driver: Page) -> None:
    box = driver.get_by_label("Stick, and clearance").bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    driver.mouse.move(x, y)
    driver.mouse.down()
    driver.mouse.move(x - box["width"] / 8, y - box["height"])  # also beyond its edge
    commanded(bare, lambda one: one.armed and one.stick.x == 1.0 and 0.4 < one.stick.psi < 0.6)
    driver.mouse.up()
    commanded(bare, lambda one: one.armed and one.stick == (0.0, 0.0))
    driver.mouse.move(x, y)
    driver.mouse.down()
    driver.mouse.move(x, y + 40)
    commanded(bare, lambda one: one.stick.x == -1.0)
    driver.evaluate("Object.defineProperty(document, 'hasFocus', {value: () => false})")
    driver.evaluate(
        "dispatchEvent(new Event('blur'))"
    )  # as where another window comes to the front
    commanded(bare, lambda one: one.stick == (0.0, 0.0))


def finger(number: int, x: float, y: float) -> dict[str, float]:
    return {"id": number, "x": x, "y": y}


def test_a_second_finger_on_a_pad_neither_moves_nor_releases_it(
    bare: Bare, browser_phone: BrowserContext, server: Server
) -> None:
    phone = page_of(browser_phone, server)
    take(phone)
    box = phone.get_by_label("Left and right").bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    touch: Any = browser_phone.new_cdp_session(phone)

    def fingers(what: str, *points: dict[str, float]) -> None:
        touch.send("Input.dispatchTouchEvent", {"type": what, "touchPoints": list(points)})

    fingers("touchStart", finger(1, x - 42, y))
    commanded(bare, lambda one: one.armed and one.stick.psi == 1.0)
    fingers("touchStart", finger(1, x - 42, y), finger(2, x + 42, y))
    fingers("touchMove", finger(1, x - 42, y), finger(2, x + 45, y))
    phone.wait_for_timeout(200)
    assert sent(bare).stick.psi == 1.0
    fingers("touchMove", finger(1, x - 42, y))
    phone.wait_for_timeout(200)
    assert sent(bare).stick.psi == 1.0
    fingers("touchEnd")
    commanded(bare, lambda one: one.stick.psi == 0.0)


def test_a_menu_over_the_page_lets_go_of_the_keys(bare: Bare, driver: Page) -> None:
    """While it is open, the page does not hear that a key is released."""
    driver.keyboard.down("ArrowUp")
    commanded(bare, lambda one: one.stick.x == 1.0)
    driver.evaluate("dispatchEvent(new MouseEvent('contextmenu'))")
    commanded(bare, lambda one: one.stick.x == 0.0)
    driver.keyboard.up("ArrowUp")
