"""YAML text as a tree that remembers where every value came from. Nothing in it is evaluated.

The YAML 1.2 core schema is read (`1e-3` is a number, `on` is text), without tags, anchors and
aliases. Values given on the command line are grafted onto the tree, and remember that too.
"""

from __future__ import annotations

import re
from typing import Any, cast

import yaml
from yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from cohelm.core.errors import CohelmError

Path = tuple[str | int, ...]

_CORE = "tag:yaml.org,2002:"
OVERRIDE = "--set "
"""How the origin of a value from the command line begins."""


class _Loader(yaml.SafeLoader):
    """Composes nodes; only the types of the YAML 1.2 core schema are distinguished."""

    yaml_implicit_resolvers = {}  # noqa: RUF012 - PyYAML's own name, filled below

    def compose_node(self, parent: Any, index: Any) -> Any:
        parser = cast(Any, super())
        if parser.check_event(yaml.AliasEvent):
            raise yaml.MarkedYAMLError(
                problem="aliases (*name) are not read; write the value out",
                problem_mark=parser.peek_event().start_mark,
            )
        return parser.compose_node(parent, index)


for _tag, _pattern, _first in (
    ("null", r"^(?:~|null|Null|NULL|)$", ["~", "n", "N", ""]),
    ("bool", r"^(?:true|True|TRUE|false|False|FALSE)$", list("tTfF")),
    ("int", r"^[-+]?[0-9]{1,300}$", list("-+0123456789")),
    (
        "float",
        r"^(?:[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?"
        r"|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))$",
        list("-+.0123456789"),
    ),
):
    cast(Any, _Loader).add_implicit_resolver(_CORE + _tag, re.compile(_pattern), _first)


def where(node: Node) -> str:
    """`file:line` of a node, or the command-line argument that it came with."""
    mark = cast(Any, node.start_mark)
    name = str(mark.name)
    return name if name.startswith(OVERRIDE) else f"{name}:{mark.line + 1}"


def dotted(path: Path) -> str:
    """A key path as a user writes it: `obstacles.0.radius_m`."""
    return ".".join(str(part) for part in path)


def tree(text: str, source: str, like: str = "") -> Node:
    """The one YAML document in `text`; CohelmError with `source` and line if it is not one."""
    try:
        loader = _Loader(text)
        loader.name = source
        node = loader.get_single_node()
    except yaml.MarkedYAMLError as error:
        raise CohelmError(_not_yaml(error, text, source)) from error
    except yaml.YAMLError as error:
        detail = " ".join(str(error).split())
        raise CohelmError(f"{source}: not a YAML text file: {detail}") from error
    except RecursionError as error:
        raise CohelmError(f"{source}: nested too deeply to be a scenario") from error
    if node is None:
        start = f"; see {like} for one to start from" if like else ""
        raise CohelmError(f"{source}: the file is empty{start}")
    return node


def _not_yaml(error: yaml.MarkedYAMLError, text: str, source: str) -> str:
    mark = error.problem_mark or error.context_mark
    line = mark.line + 1 if mark else 1
    problem = str(error.problem or error.context)
    indent = "".join(text.splitlines()[line - 1 : line])
    if "'\\t'" in problem or indent.lstrip(" ").startswith("\t"):
        problem = "a tab; YAML is indented with spaces"
    elif "another document" in problem:
        problem = "a second document starts here; a file holds one"
    elif "could not find expected ':'" in problem:
        problem = "a key without a colon near here"
    problem = problem.replace("'<stream end>'", "the end of the file")
    return f"{source}:{line}: not valid YAML: {problem}"


def plain(node: Node, problems: list[str], path: Path = ()) -> Any:
    """The tree as dicts, lists and scalars; what is not allowed is reported in `problems`."""
    if isinstance(node, MappingNode):
        _check_tag(node, "map", problems, path)
        mapping: dict[str, Any] = {}
        for key, value in node.value:
            if not isinstance(key, ScalarNode):
                problems.append(f"{where(key)}: {dotted(path) or 'file'}: a key must be a word")
                continue
            if key.value in mapping:
                first = next(k for k, _ in node.value if k.value == key.value)
                problems.append(
                    f"{where(key)}: {dotted((*path, key.value))}: given twice, "
                    f"first at {where(first)}; remove one"
                )
            mapping[str(key.value)] = plain(value, problems, (*path, key.value))
        return mapping
    if isinstance(node, SequenceNode):
        _check_tag(node, "seq", problems, path)
        return [plain(item, problems, (*path, i)) for i, item in enumerate(node.value)]
    return _scalar(cast(ScalarNode, node), problems, path)


def _check_tag(node: Node, expected: str, problems: list[str], path: Path) -> None:
    if node.tag != _CORE + expected:
        tag = node.tag.replace(_CORE, "!!")
        place = dotted(path) or "file"
        problems.append(f"{where(node)}: {place}: the tag {tag} is not read; remove it")


def _scalar(node: ScalarNode, problems: list[str], path: Path) -> Any:
    text = str(node.value)
    kind = node.tag.removeprefix(_CORE)
    try:
        if kind == "null":
            return None
        if kind == "bool":
            return {"true": True, "false": False}[text.lower()]
        if kind == "int":
            return int(text)
        if kind == "float":
            return float(re.sub(r"\.(?=inf|nan)", "", text.lower()))
    except (KeyError, ValueError):
        problems.append(f"{where(node)}: {dotted(path)}: {text!r} is not a {kind}")
        return text
    _check_tag(node, "str", problems, path)
    return text


def graft(root: Node, override: str) -> None:
    """Put `key.path=value` into the tree; the value is YAML, a list's item its number or name.

    Raises CohelmError if that is not its form, or the path leads through something that has
    no keys.
    """
    origin = OVERRIDE + override
    key_path, equals, text = override.partition("=")
    parts = key_path.strip().split(".")
    if not equals or not all(parts):
        raise CohelmError(f"{origin}: write key.path=value, for example law.barrier.k_cbf=1.0")
    value = tree(text, origin) if text.strip() else _new_scalar("", "null", origin)
    here = root
    for i, part in enumerate(parts[:-1]):
        below = _child(here, part, origin, parts[:i])
        if below is None or (isinstance(below, ScalarNode) and below.tag == _CORE + "null"):
            below = MappingNode(_CORE + "map", [], value.start_mark)
            _put(here, part, below, origin, parts[:i])
        here = below
    _put(here, parts[-1], value, origin, parts[:-1])


def _new_scalar(text: str, kind: str, origin: str) -> ScalarNode:
    return ScalarNode(_CORE + kind, text, cast(Any, yaml.Mark)(origin, 0, 0, 0, None, None))


def _child(node: Node, part: str, origin: str, path: list[str]) -> Node | None:
    if isinstance(node, MappingNode):
        return next((v for k, v in node.value if k.value == part), None)
    return cast(Node, node.value[_item(node, part, origin, path)])


def _put(node: Node, part: str, value: Node, origin: str, path: list[str]) -> None:
    if isinstance(node, MappingNode):
        node.value = [pair for pair in node.value if pair[0].value != part]
        node.value.append((_new_scalar(part, "str", origin), value))
    else:
        node.value[_item(node, part, origin, path)] = value


def _item(node: Node, part: str, origin: str, path: list[str]) -> int:
    """The index of a list's item, given as a number from 0 or as the item's `name`."""
    place = dotted(tuple(path)) or "the file"
    if not isinstance(node, SequenceNode):
        raise CohelmError(f"{origin}: {place} is a value and has no {part!r} in it")
    names = [
        next((str(v.value) for k, v in item.value if k.value == "name"), "")
        if isinstance(item, MappingNode)
        else ""
        for item in node.value
    ]
    if part in names:
        return names.index(part)
    if part.isascii() and part.isdigit() and int(part) < len(names):
        return int(part)
    named = f" or a name ({', '.join(filter(None, names))})" if any(names) else ""
    raise CohelmError(
        f"{origin}: {place} has {len(names)} items, no {part!r}; "
        f"count from 0 to {len(names) - 1}{named}"
    )


def at(root: Node, path: Path) -> tuple[Node, Path]:
    """The node of a key path, as far as the tree goes, and the path really walked.

    A part that is no key of a mapping is skipped when more follow (it names which of several forms
    was checked); the last one then stands for a key that is missing from the mapping.
    """
    node, walked, spot = root, (), root
    for i, part in enumerate(path):
        if isinstance(node, MappingNode):
            # the last of two equal keys is the one that was read
            pair = next(((k, v) for k, v in reversed(node.value) if k.value == part), None)
            if pair is not None:
                spot, node = pair
                walked = (*walked, part)
            elif i == len(path) - 1:
                return spot if walked else node, (*walked, part)
        elif isinstance(node, SequenceNode) and isinstance(part, int) and part < len(node.value):
            spot = node = node.value[part]
            walked = (*walked, part)
    return spot, walked
