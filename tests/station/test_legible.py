"""What the page says can be read: contrast, and the size of letters that the system is set to."""

from __future__ import annotations

from pathlib import Path

from playwright.sync_api import Browser, BrowserContext, expect

from cohelm.link.messages import Alarm, Mode, Severity
from tests.link.ends import STATUS
from tests.station.bare import Bare
from tests.station.conftest import CHROMIUM, FLAGS
from tests.station.person import alarms, stopped, take, who
from tests.station.servers import served

STANDS = STATUS._replace(mode=Mode.HOLD, why="idle")
PALE = """() => {
  const light = (c) => {
    const part = (v) => (v / 255 <= 0.04045 ? v / 255 / 12.92 : ((v / 255 + 0.055) / 1.055) ** 2.4)
    return 0.2126 * part(c[0]) + 0.7152 * part(c[1]) + 0.0722 * part(c[2])
  }
  const parsed = (text) => {
    const [r, g, b, a] = text.match(/[\\d.]+/g).map(Number)
    return [r, g, b, a ?? 1]
  }
  const over = (a, b, share = a[3]) => [0, 1, 2].map((i) => a[i] * share + b[i] * (1 - share))
  const out = []
  const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT)
  while (texts.nextNode()) {
    const one = texts.currentNode.parentElement
    const text = texts.currentNode.textContent.trim()
    if (text === '' || !one.checkVisibility() || one.closest(':disabled, noscript')) continue
    let share = 1
    let ground = [255, 255, 255]
    const grounds = []
    for (let at = one; at !== null; at = at.parentElement) {
      const style = getComputedStyle(at)
      grounds.unshift(parsed(style.backgroundColor))
      share *= Number(style.opacity) * Number(style.filter.match(/opacity\\((.*?)\\)/)?.[1] ?? 1)
    }
    for (const each of grounds) ground = over(each, ground)
    const ink = over(parsed(getComputedStyle(one).color), ground, share)
    const [dark, bright] = [light(ink), light(ground)].sort((a, b) => a - b)
    if ((bright + 0.05) / (dark + 0.05) < 4.5) out.push(text)
  }
  return out
}"""
"""Texts with a contrast of less than 4.5, as WCAG 2 asks for small letters; not of what is grey as
it can not be pressed."""


def test_every_text_of_the_page_has_contrast_also_where_it_is_stale(
    context: BrowserContext, tmp_path: Path
) -> None:
    alarm = Alarm(1, Severity.WARNING, False, False, "a warning that is over")
    with Bare(tmp_path, STANDS) as robot, served(robot.connect) as server:
        page = context.new_page()
        page.goto(server.address)
        expect(who(page)).to_contain_text("No driver")
        assert page.evaluate(PALE) == []
        take(page)
        page.get_by_role("button", name="Stick settings").click()
        robot.status = STANDS._replace(stopped="stop by anna (3)", why="", alarms=(alarm,))
        expect(stopped(page)).to_be_visible()
        assert page.evaluate(PALE) == []
        robot.die()
        expect(alarms(page)).to_contain_text("No link to the robot")
        assert page.evaluate(PALE) == []


def test_letters_grow_with_those_of_the_system(browser: Browser, tmp_path: Path) -> None:
    large = browser.browser_type.launch(
        executable_path=CHROMIUM, args=[*FLAGS, "--blink-settings=defaultFontSize=24"]
    )
    with Bare(tmp_path, STANDS) as robot, served(robot.connect) as server:
        page = large.new_page(viewport={"width": 1280, "height": 800})
        page.goto(server.address)
        take(page)
        why = page.locator(".why")
        expect(why).to_contain_text("idle")
        assert why.evaluate("(one) => parseFloat(getComputedStyle(one).fontSize)") > 20
        slider = page.get_by_label("Share of the full speed").bounding_box()
        assert slider is not None
        assert slider["width"] > 40
        assert page.evaluate("document.documentElement.scrollWidth") <= 1280
    large.close()


def test_a_number_that_is_out_of_the_normal_is_marked_by_more_than_its_colour(
    context: BrowserContext, tmp_path: Path
) -> None:
    mark = "(one) => getComputedStyle(one, '::before').content.replace(/[^◆]/g, '')"
    with Bare(tmp_path, STANDS) as robot, served(robot.connect) as server:
        page = context.new_page()
        page.goto(server.address)
        clearance = page.locator(".nearest b")
        expect(clearance).to_have_text("0.20 m")
        assert clearance.evaluate(mark) == "◆"
        far = STANDS.guarding._replace(clearance=1.0)
        robot.status = STANDS._replace(guarding=far)
        expect(clearance).to_have_text("1.00 m")
        assert clearance.evaluate(mark) == ""
