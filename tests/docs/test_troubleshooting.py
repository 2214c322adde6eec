"""docs/troubleshooting.md lists every alarm, every reason of a stop and every refusal."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCES = ROOT / "src" / "cohelm"
TEXT = " ".join((ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8").split())
RAISING = {"on", "trouble", "over_already", "_alarm_while", "_notice", "Loss"}
SENTENCES = (
    "drive/path_check.py", "drive/progress_watch.py", "drive/rerouting.py", "link/lease.py",
    "loop/authorization.py", "loop/docking.py", "loop/sensor_watchdog.py", "loop/supervisor.py",
    "perceive/localize/localizer.py", "perceive/localize/verdict.py",
    "robot/collision_monitor/monitor.py", "robot/collision_monitor/source.py",
    "robot/contact_monitor.py", "robot/gate/gate.py", "robot/plausibility/content.py",
    "robot/plausibility/motion.py", "robot/plausibility/source.py", "robot/plausibility/wheels.py",
)  # fmt: skip
ONLY_LOGGED = {
    "{requested.name} requests {what.name} {value}: {refusal or 'done'}",
    "{math.copysign(way, motion[0]):.2f} m and {math.degrees(float(motion[2])):.0f} deg",
    "continues: {name}", "stands: {why}", "mode {mode.name}",
    "{lost.why}: the controller continues alone",
    "the driver who chose the mode has changed: hold", "{docking.activity}: {ended.why}",
    "{self.docking.activity} ended: {ended.why}", "replaced by another request",
    "{dock.name} is left",
    "docked at {dock.name}, {off}", "the driver", "faster than the robot may be",
    "a change faster than the robot may make", "out of order", "its readings are too old",
}  # fmt: skip
"""Neither alarm nor refusal: what the log alone has, and why a command was cut."""


def strings(node: ast.AST) -> Iterator[tuple[str, str]]:
    """Each text that is no docstring: as written, and its longest constant piece."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Expr) and isinstance(child.value, ast.Constant):
            continue
        if isinstance(child, ast.JoinedStr):
            pieces = [v.value for v in child.values if isinstance(v, ast.Constant)]
            yield ast.unparse(child)[2:-1], max(map(str, pieces), key=len, default="")
        elif isinstance(child, ast.Constant) and isinstance(child.value, str):
            yield child.value, child.value
        else:
            yield from strings(child)


@pytest.mark.parametrize("file", SENTENCES)
def test_every_sentence_is_on_the_page(file: str) -> None:
    tree = ast.parse((SOURCES / file).read_text(encoding="utf-8"))
    for whole, piece in strings(tree):
        said = piece.strip(" :;,().|%°")
        if " " in said and whole not in ONLY_LOGGED:
            assert said in TEXT, (file, whole)


def raised() -> set[str]:
    """The names of all alarms, where the code names them."""
    names: set[str] = set()
    for path in SOURCES.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        if "alarms" not in text:
            continue
        tree = ast.parse(text)
        constants = dict(re.findall(r"^(\w+) = \"([^\"]*)\"$", text, re.M))
        for pair in re.findall(r'^(\w+), (\w+) = "(.*)", "(.*)"$', text, re.M):
            constants |= dict(zip(pair[:2], pair[2:], strict=True))
        for call in ast.walk(tree):
            if not isinstance(call, ast.Call):
                continue
            of = call.func
            name = of.attr if isinstance(of, ast.Attribute) else getattr(of, "id", "")
            if name not in RAISING or (
                name in ("on", "trouble") and "alarms" not in ast.unparse(of)
            ):
                continue
            for given in call.args[:2]:
                for one in ast.walk(given):
                    if isinstance(one, ast.Constant) and isinstance(one.value, str):
                        names.add(one.value)
                    elif isinstance(one, ast.Name) and one.id in constants:
                        names.add(constants[one.id])
    return {name for name in names if name and name == name.strip(" :") and name != "the driver"}


def test_every_alarm_is_on_the_page() -> None:
    names = raised()
    assert {"stopped", "lost", "reach", "docks", "stick", "driver", "planner"} <= names
    for name in names:
        assert f"| `{name}` |" in TEXT, name
