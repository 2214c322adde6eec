"""The page's message types, made from the Python definitions so that the two cannot differ.

python -m cohelm.station.typescript > src/cohelm/station/web/src/messages.ts
"""

from __future__ import annotations

import types
import typing
from typing import Any, Literal, get_args, get_origin

from cohelm.core.schema import Schema
from cohelm.station import messages

HEAD = """// Made from src/cohelm/station/messages.py; a test holds the two equal. To make it:
// python -m cohelm.station.typescript > src/cohelm/station/web/src/messages.ts
"""
_PLAIN = {float: "number", int: "number", str: "string", bool: "boolean", type(None): "null"}


def text() -> str:
    """The whole of messages.ts."""
    from_page, to_page = _members(messages.FromPage), _members(messages.ToPage)
    inner = [messages.Camera, messages.Alarm, messages.Dock, messages.RecordFile]
    blocks = [HEAD, *(_interface(model) for model in (*inner, *from_page, *to_page))]
    for name, members in (("FromPage", from_page), ("ToPage", to_page)):
        blocks.append(f"export type {name} = {' | '.join(m.__name__ for m in members)}\n")
    return "\n".join(blocks)


def _members(union: Any) -> list[type[Schema]]:
    if get_origin(union) is typing.Annotated:
        union = get_args(union)[0]
    return list(get_args(union))


def _interface(model: type[Schema]) -> str:
    lines = [f"/** {(model.__doc__ or '').strip()} */", f"export interface {model.__name__} {{"]
    hints = typing.get_type_hints(model)
    for name, field in model.model_fields.items():
        if field.description:
            lines.append(f"  /** {' '.join(field.description.split())} */")
        lines.append(f"  {name}: {_type(hints[name])}")
    return "\n".join([*lines, "}\n"])


def _type(hint: Any) -> str:
    """The TypeScript of one Python type; only what messages use, anything else raises."""
    if hint in _PLAIN:
        return _PLAIN[hint]
    origin, args = get_origin(hint), get_args(hint)
    if origin is typing.Annotated:
        return _type(args[0])
    if origin is Literal:
        return " | ".join(f"'{value}'" for value in args)
    if origin in (types.UnionType, typing.Union):
        return " | ".join(_type(arg) for arg in args)
    if origin is list:
        return f"Array<{_type(args[0])}>"
    if origin is tuple:
        return f"[{', '.join(_type(arg) for arg in args)}]"
    if isinstance(hint, type) and issubclass(hint, Schema):
        return hint.__name__
    raise TypeError(f"no TypeScript for {hint!r}")


if __name__ == "__main__":
    print(text(), end="")
