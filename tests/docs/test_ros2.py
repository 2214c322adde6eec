"""The pages on ROS 2 name options, topics and robots that there are."""

import re
from pathlib import Path

from typer.main import get_command

from cohelm.cli import app
from cohelm.robot.model import SHIPPED

DOCS = Path(__file__).parents[2] / "docs"
PAGES = "".join(page.read_text(encoding="utf-8") for page in sorted(DOCS.glob("ros2*.md")))
COMMANDS = get_command(app).commands


def options(name: str) -> set[str]:
    return {one for p in COMMANDS[name].params for one in (*p.opts, *p.secondary_opts)}


def test_every_option_on_the_pages_is_one():
    known = options("filter") | options("base") | options("robot")
    named = set(re.findall(r"(?<![\w-])--[a-z][a-z0-9-]*", PAGES)) - {"--ros-args", "--once"}
    assert named <= known, named - known
    table = PAGES.split("| option | is for |")[1].split("\n\n")[0]
    assert set(re.findall(r"--[a-z][a-z-]+", table)) == options("filter") - {
        "--robot", "--print-config", "--json",
    }  # fmt: skip


def test_every_robot_that_comes_along_is_named_where_robots_are_described():
    described = (DOCS / "robot-yaml.md").read_text(encoding="utf-8")
    assert all(f"`{name}`" in described for name in SHIPPED)
