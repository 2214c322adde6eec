"""Files and names into checked models: scenarios, robots, anything built on `Schema`."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Sequence
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, TypeVar, cast

import yaml
from pydantic import ValidationError
from yaml.nodes import MappingNode, Node

from cohelm.core.errors import CohelmError, did_you_mean
from cohelm.core.files import as_path, check_regular, read_bytes
from cohelm.core.schema import Schema
from cohelm.robot.model import SHIPPED, RobotModel, shipped_path
from cohelm.scenario.explain import sentences
from cohelm.scenario.model import Scenario, Start
from cohelm.scenario.stick import StickFile
from cohelm.scenario.text import graft, plain, tree
from cohelm.scenario.world import AnyWorld, GazeboWorld, barn_of

Model = TypeVar("Model", bound=Schema)

_LARGEST = 50_000_000  # bytes of YAML; more is a mistake


def scenario(path: str | Path, overrides: Sequence[str] = (), stick: str | None = None) -> Scenario:
    """The scenario in a file, or one that comes with the package by its bare name.

    overrides: `key.path=value` with the value in YAML. stick: a stick file to play instead of the
    scenario's stick, relative to the working folder; so may be a robot that an override names, if
    it is not beside the scenario. The robot is read in and the stick file's path made absolute, so
    that the result stands alone. Raises CohelmError with every problem of the file, one per line.
    """
    file = find(path)
    made = read(file, Scenario, overrides)
    if isinstance(made.robot, str):
        typed = any(one.partition("=")[0].strip() == "robot" for one in overrides)
        here = typed and not (file.parent / made.robot).exists()
        where = (Path(), "--set ") if here else (file.parent, f"{file}: ")
        made = made.model_copy(update={"robot": robot(made.robot, *where)})
    if stick is not None:
        played = StickFile(kind="file", path=str(Path(stick).absolute()))
        made = made.model_copy(update={"stick": played})
    return standing_alone(made, file.parent)


def read(path: str | Path, model: type[Model], overrides: Sequence[str] = ()) -> Model:
    """The checked model in a YAML file; CohelmError with every problem, one per line."""
    return parse(_text(Path(path)), model, str(path), overrides)


def tree_of(file: Path) -> Node:
    """The YAML in a file that is no scenario. CohelmError where it is none."""
    return tree(_text(file), str(file))


def parse(text: str, model: type[Model], source: str, overrides: Sequence[str] = ()) -> Model:
    """The checked model in YAML text; `source` is what errors call it."""
    root = tree(text, source, "docs/robot-yaml.md" if model is RobotModel else "`minimal`")
    for override in overrides if isinstance(root, MappingNode) else ():
        graft(root, override)
    problems: list[str] = []
    try:
        data = plain(root, problems)
        _check_kind(data, model, source)
        # As JSON, the strict mode still takes a list for a tuple, and no text for a number.
        made = model.model_validate_json(json.dumps(data), strict=True)
    except ValidationError as error:
        raise CohelmError("\n".join(problems + sentences(error, root, model))) from error
    if problems:
        raise CohelmError("\n".join(problems))
    return made


def is_robot_file(path: Path) -> bool:
    """Whether a file describes a robot, not a scenario; a file of neither fails when it is read."""
    try:
        return path.is_file() and _describes_robot(plain(tree_of(path), []))
    except CohelmError:
        return False


def _describes_robot(data: Any) -> bool:
    """Whether YAML is a robot's, not a scenario's; also where its keys are mistyped."""
    if not isinstance(data, dict):
        return False
    from difflib import get_close_matches  # imported only when needed

    keys = [str(key) for key in cast("dict[Any, Any]", data)][:100]
    mine, others = (
        sum(1 for key in keys if get_close_matches(key, of.model_fields, 1, 0.75))
        for of in (RobotModel, Scenario)
    )
    return mine > others


def _check_kind(data: Any, model: type[Schema], source: str) -> None:
    """CohelmError where a robot's file is given for a scenario, or the reverse, or a map's."""
    if not isinstance(data, dict):
        return
    if {"image", "resolution", "origin"} <= data.keys():
        wanted = (
            "a scenario: name it in one, as its world" if model is Scenario else "a robot's file"
        )
        raise CohelmError(
            f"{source} is a map of map_server, not {wanted}; to look at it: cohelm map {source}"
        )
    robots, sites = _describes_robot(data), "reference" in data
    if robots and not sites and model is Scenario:
        raise CohelmError(
            f"{source} describes a robot, not a scenario: name it in one, with `robot: {source}`, "
            f"or with --set robot={source}"
        )
    if sites and not robots and model is RobotModel:
        raise CohelmError(
            f"{source} is a scenario, and does not describe a robot: give the robot's YAML file"
        )


def dump(model: Schema) -> str:
    """YAML text that loads as an equal model."""
    data = model.model_dump(mode="json", exclude_none=True)
    return yaml.safe_dump(data, sort_keys=False, default_flow_style=None, allow_unicode=True)


def standing_alone(made: Scenario, folder: Path) -> Scenario:
    """The same with absolute paths of other files, or their contents.

    The robot's description; a world's route where the scenario has none.
    """
    update: dict[str, object] = {}
    if isinstance(made.robot, str):
        update["robot"] = robot(made.robot, folder)
    if isinstance(made.stick, StickFile) and not Path(made.stick.path).is_absolute():
        path = str((folder / made.stick.path).absolute())
        update["stick"] = made.stick.model_copy(update={"path": path})
    if made.zones is not None:
        update["zones"] = made.zones.standing_alone(folder, made.name)
    if made.world is not None:
        world = _found(made.world, folder, made.name)
        update["world"] = world
        if not made.reference.waypoints_m:
            update |= _on_course(made, world)
    return made.model_copy(update=update)


def _found(world: AnyWorld, folder: Path, requested_by: str) -> AnyWorld:
    """A world by absolute paths, with the digest of its file."""
    update: dict[str, object] = {"file": str((folder / world.file).absolute())}
    if isinstance(world, GazeboWorld) and world.path_file is not None:
        update["path_file"] = str((folder / world.path_file).absolute())
    made = world.model_copy(update=update)
    file = Path(made.file)
    if file.is_dir():
        raise CohelmError(f"{requested_by}: world.file: {file}: is a folder; name the file in it")
    if not file.is_file():
        close = did_you_mean(file.name, _siblings(file.parent))
        raise CohelmError(f"{requested_by}: world.file: {file}: no such file{close}")
    now = digest(file)
    if made.sha256 is not None and made.sha256 != now:
        raise CohelmError(
            f"{file}: the world has changed since this scenario was written down (its sha256 "
            "differs); remove world.sha256 to run in it as it is now"
        )
    return made.model_copy(update={"sha256": now})


def _on_course(made: Scenario, world: AnyWorld) -> dict[str, object]:
    """What the scenario leaves to the world's route."""
    course = barn_of(world)
    if course is None:  # the model requires waypoints then
        raise TypeError("the world has no route")
    near = made.reference.arrive_m or course.near_goal
    update: dict[str, object] = {
        "reference": made.reference.model_copy(
            update={"waypoints_m": course.waypoints, "arrive_m": near}
        )
    }
    if made.start is None:
        x, y, psi = course.start
        update["start"] = Start(x_m=x, y_m=y, heading_rad=psi)
    if made.simulation.duration_s is None:
        update["simulation"] = made.simulation.model_copy(update={"duration_s": course.time_limit})
    return update


def robot(name: str, folder: Path = Path(), requested_by: str = "") -> RobotModel:
    """A robot by its shipped name, or from its YAML file, relative to `folder`.

    requested_by: where the name is, for the error's beginning.
    """
    if name in SHIPPED:
        return _shipped(name).model_copy(deep=True)
    file = folder / name
    if not file.exists() and Path(name).suffix not in (".yaml", ".yml"):
        raise CohelmError(
            f"{requested_by}robot: no robot is called {name!r}; there are {', '.join(SHIPPED)}, "
            f"or give the path of a robot's YAML file{did_you_mean(name, SHIPPED)}"
        )
    if not file.exists():
        close = did_you_mean(file.name, _names(file.parent))
        raise CohelmError(f"{requested_by}robot: {file}: no such file{close}")
    return read(file, RobotModel)


@cache
def _shipped(name: str) -> RobotModel:
    """The robot of a file, cached: campaigns read it in every episode."""
    return read(shipped_path(name), RobotModel)


def load_robot(name: str | Path) -> RobotModel:
    """A robot by its shipped name, or from its YAML file.

        >>> import cohelm
        >>> cohelm.load_robot("sally").track_m
        0.5

    Raises CohelmError with every problem of the file, one per line.
    """
    return robot(str(as_path(name, "a robot, or its YAML file")), Path())


def load_scenario(path: str | Path, changes: Sequence[str] = ()) -> Scenario:
    """A scenario by its shipped name, or from its YAML file.

        >>> import cohelm
        >>> cohelm.load_scenario("minimal", ["reference.speed_mps=0.3"]).reference.speed_mps
        0.3

    changes: `key.path=value`, as in `cohelm run --set`. Raises CohelmError with every problem of
    the file, one per line.
    """
    return scenario(as_path(path, "a scenario, or its YAML file"), changes)


def digest(path: Path) -> str:
    """SHA-256 of a file, to know it again."""
    check_regular(path)
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def shipped() -> dict[str, Path]:
    """The scenarios that come with the package, by name."""
    installed = Path(str(files("cohelm"))) / "scenarios"
    folder = installed if installed.is_dir() else Path(__file__).parents[3] / "scenarios"
    return {file.stem: file for file in sorted(folder.glob("*.yaml"))}


def find(path: str | Path, robots: Iterable[str] = ()) -> Path:
    """The file that a path or a shipped scenario's bare name means; CohelmError if none.

    robots: that might have been named instead.
    """
    file, named = Path(path), shipped()
    if str(path) in named and not file.is_file():
        return named[str(path)]
    if file.exists():
        return file
    if file.stem in named:
        raise CohelmError(f"{path}: no such file; did you mean the shipped scenario {file.stem!r}?")
    if str(path) in SHIPPED:
        raise CohelmError(
            f"{path} is a robot that comes with cohelm, not a scenario: give it with "
            f"--set robot={path}, or `robot: {path}` in a scenario"
        )
    siblings = _names(file.parent)
    close = did_you_mean(file.name, siblings) or did_you_mean(file.stem, named)
    close = close or did_you_mean(file.stem, SHIPPED)
    there = f"scenarios that come with cohelm: {', '.join(named)}"
    if others := ", ".join(robots):
        there = f"robots that come with cohelm: {others}; {there}; or give the YAML file of either"
    raise CohelmError(f"{path}: no such file{close}; {there}")


def _names(folder: Path) -> list[str]:
    there = (f for f in folder.glob("*.y*ml") if f.exists()) if folder.is_dir() else ()
    return sorted(f.name for f in there)


def _siblings(folder: Path) -> list[str]:
    return sorted(f.name for f in folder.iterdir()) if folder.is_dir() else []


def _text(file: Path) -> str:
    """A file's text. Raises CohelmError in plain words."""
    if not file.exists():
        raise CohelmError(f"{file}: no such file{did_you_mean(file.name, _names(file.parent))}")
    if file.is_dir():
        inside = ", ".join(_names(file)) or "none"
        raise CohelmError(f"{file}: is a folder; name a YAML file in it ({inside})")
    try:
        return read_bytes(file, _LARGEST, "a scenario").decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise CohelmError(f"{file}: not a text file in UTF-8, so not a YAML file") from error
    except OSError as error:
        raise CohelmError(f"{file}: can not be read: {error.strerror}") from error
