"""The page's message types, made from the Python definitions so that the two cannot differ.

python -m cohelm.station.typescript > src/cohelm/station/web/src/messages.ts
"""

from __future__ import annotations

import ast
import inspect
import types
import typing
from collections.abc import Iterator, Sequence
from enum import IntEnum
from itertools import pairwise
from textwrap import dedent
from typing import Annotated, Any, Literal, get_args, get_origin

import numpy as np
from numpy.typing import NDArray

from cohelm.core.schema import Schema
from cohelm.link.codec import Reader
from cohelm.station import messages

HEAD = """// Made from station/messages.py and link/; a test holds them equal. To make it:
// python -m cohelm.station.typescript > src/cohelm/station/web/src/messages.ts
"""
_PLAIN = {float: "number", int: "number", str: "string", bool: "boolean", type(None): "null"}
_STAMPED = """  /** The robot's clock when it was sent [s]. */
  stamp: number
  /** Age when it was sent to the page [s]. */
  age: number"""


def text() -> str:
    """The whole of messages.ts."""
    from_page, own = _members(messages.FromPage), _members(messages.ToPage)
    robots = messages.FROM_ROBOT
    up = [_interface(model, known=True) for model in _inner(from_page)]
    down = map(_interface, (*_inner(robots), *from_page, *own, *robots))
    blocks = [HEAD, *up, *down]
    names = [model.__name__ for model in (*own, *robots)]
    for name, members in (("FromPage", [m.__name__ for m in from_page]), ("ToPage", names)):
        blocks.append(f"export type {name} = {' | '.join(members)}\n")
    return "\n".join(blocks)


def _members(union: Any) -> list[type[Schema]]:
    if get_origin(union) is Annotated:
        union = get_args(union)[0]
    return list(get_args(union))


def _inner(of: Sequence[type[Any]]) -> list[type[Any]]:
    """The named tuples within these messages that are no rows of numbers."""
    found: dict[type[Any], None] = {}

    def visit(hint: Any) -> None:
        for inner in get_args(hint):
            visit(inner)
        if hasattr(hint, "_fields"):
            for part in _parts(hint):
                visit(part)
            if hint not in of and not _is_row(hint):
                found[hint] = None

    for message in of:
        for part in _parts(message):
            visit(part)
    return list(found)


def _is_row(hint: Any) -> bool:
    """Whether it is a named tuple of nothing but numbers."""
    return hasattr(hint, "_fields") and set(_parts(hint)) == {float}


def _parts(of: Any) -> list[Any]:
    return list(typing.get_type_hints(of).values())


def _may_be_unknown(hint: Any) -> bool:
    if get_origin(hint) is Annotated:
        return _may_be_unknown(get_args(hint)[0])
    return hint is float or _is_row(hint) or set(get_args(hint)) == {float}


def _interface(model: type[Any], known: bool = False) -> str:
    """known: whether all its numbers are."""
    lines = [f"/** {_line(model.__doc__ or '')} */", f"export interface {model.__name__} {{"]
    if model in messages.FROM_ROBOT:
        lines.append(f"  type: '{model.__name__}'")
    hints = typing.get_type_hints(model, include_extras=True)
    described = dict(_described(model))
    for field, hint in hints.items():
        if described.get(field):
            lines.append(f"  /** {_line(described[field])} */")
        unknown = not known and hasattr(model, "_fields") and _may_be_unknown(hint)
        lines.append(f"  {field}: {_type(hint)}{' | null' if unknown else ''}")
    if model is messages.Status:
        lines.append(_STAMPED)
    return "\n".join([*lines, "}\n"])


def _line(words: str) -> str:
    return " ".join(words.split())


def _described(model: type[Any]) -> Iterator[tuple[str, str]]:
    """The fields' names, and the docstring below each."""
    body = typing.cast(ast.ClassDef, ast.parse(dedent(inspect.getsource(model))).body[0]).body
    for field, below in pairwise(body):
        match field, below:
            case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=words)):
                yield name, str(words)
            case _:
                pass


def _type(hint: Any) -> str:
    """The TypeScript of one Python type; only what messages use, anything else raises."""
    if hint in _PLAIN:
        return _PLAIN[hint]
    origin, args = get_origin(hint), get_args(hint)
    if origin is Annotated:
        # NumPy's NDArray is an alias of ndarray, from Python 3.12 on one with a type of its own
        is_array = get_origin(args[0]) in (np.ndarray, NDArray)
        return _rows(args[1]) if is_array else _type(args[0])
    if origin is Literal:
        return " | ".join(f"'{value}'" for value in args)
    if origin in (types.UnionType, typing.Union):
        return " | ".join(_type(arg) for arg in args)
    if origin is list or (origin is tuple and args[-1] is Ellipsis):
        return f"Array<{_type(args[0])}>"
    if origin is tuple:
        return f"[{', '.join(_type(arg) for arg in args)}]"
    if isinstance(hint, type) and issubclass(hint, IntEnum):
        return " | ".join(f"'{one.name.lower()}'" for one in hint)
    if _is_row(hint):
        return f"[{', '.join(['number'] * len(_parts(hint)))}]"
    if isinstance(hint, type):
        return hint.__name__
    raise TypeError(f"no TypeScript for {hint!r}")


def _rows(field: Any) -> str:
    """An array's: its columns are those of an empty one."""
    columns = field.read(Reader(bytes(4))).shape[1]
    return f"Array<[{', '.join(['number'] * columns)}]>"


if __name__ == "__main__":
    print(text(), end="")
