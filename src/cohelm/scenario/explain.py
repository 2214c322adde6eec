"""What is wrong with a file, in sentences: where, what stands there, and what may stand there."""

from __future__ import annotations

import re
from functools import cache
from typing import Any, cast

from pydantic import ValidationError
from pydantic_core import ErrorDetails
from yaml.nodes import Node

from cohelm.core.errors import did_you_mean
from cohelm.core.schema import RENAMED, Schema
from cohelm.scenario.text import Path, at, dotted, where

UNITS = {
    "m": "m", "s": "s", "mps": "m/s", "mps2": "m/s²", "rad": "rad", "radps": "rad/s",
    "radps2": "rad/s²", "deg": "degrees", "degps": "degrees/s", "hz": "Hz", "kg": "kg",
    "per_s": "1/s", "per_rad": "1/rad",
}  # fmt: skip
"""What a key is in, by its end; nothing else is in degrees. The longest end counts."""
_NUMBER = re.compile(
    r"^\s*([-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?)(?![\d_,.'xX])"
)  # not of 1,000, 1_000 or 0x10
JsonSchema = dict[str, Any]


def sentences(error: ValidationError, root: Node, model: type[Schema]) -> list[str]:
    """Every problem as `file:line: key.path: sentence`."""
    schema = _schema(model)
    found: list[str] = []
    for detail in error.errors(include_url=False):
        if detail["type"] == "problems":
            for below, text in cast(list[tuple[str, str]], detail.get("ctx", {})["said"]):
                parts = (int(p) if p.isdigit() else p for p in below.split(".") if p)
                found.append(_line(root, (*detail["loc"], *parts), text))
        else:
            found.append(_line(root, detail["loc"], _sentence(detail, root, schema)))
    return found


@cache
def _schema(model: type[Schema]) -> JsonSchema:
    """Of a model, which takes a tenth of a second to make; to read, and not to change."""
    return model.model_json_schema()


def nearest(word: str, known: list[str]) -> str:
    """`did you mean X?`, or nothing: by stem first (a unit gone wrong), then by spelling."""
    stems = [k for k in known if k.rsplit("_", 1)[0] in (word, word.rsplit("_", 1)[0])]
    if len(stems) == 1:
        unit = unit_of((stems[0],))
        return f"did you mean {stems[0]}" + (f" (in {unit})?" if unit else "?")
    return did_you_mean(word, known).removeprefix("; ")


def unit_of(path: Path) -> str:
    """The unit that a key path's last key ends with, or nothing."""
    keys = [part for part in path if isinstance(part, str)]
    ends = [suffix for suffix in UNITS if keys and keys[-1].endswith(f"_{suffix}")]
    return UNITS[max(ends, key=len)] if ends else ""


def _line(root: Node, loc: Path, text: str) -> str:
    node, path = at(root, loc)
    return f"{where(node)}: {dotted(path)}: {text}" if path else f"{where(node)}: {text}"


def _sentence(detail: ErrorDetails, root: Node, schema: JsonSchema) -> str:
    kind, loc, value = detail["type"], detail["loc"], detail["input"]
    context = detail.get("ctx", {})
    _, path = at(root, loc)
    unit = unit_of(path)
    got = _shown(value)
    if kind == "extra_forbidden":
        here, key = _under(schema, loc[:-1]), str(loc[-1])
        known = list(here.get("properties", {}))
        now = here.get(RENAMED, {}).get(key)
        hint = f"it is called {now} now" if now else nearest(key, known)
        return f"unknown key; {hint}" if hint else f"unknown key; known here: {', '.join(known)}"
    if kind == "union_tag_not_found":
        key = str(context.get("discriminator")).strip("'")
        forms = sorted(_under(schema, loc).get("discriminator", {}).get("mapping", {}))
        return f"{key} is missing; one of {', '.join(forms)}"
    if kind == "missing":
        below = _under(schema, loc)
        about = str(below.get("description", "")).split("\n")[0]
        return f"is missing{': ' + about if about else ''}"
    if kind == "finite_number":
        return f"must be a finite number{_in(unit)}, got {got}"
    if kind.startswith(("greater_than", "less_than")):
        return f"must be {_range(_under(schema, loc))}{' ' + unit if unit else ''}, got {got}"
    if kind in ("float_type", "int_type", "int_from_float", "float_parsing", "int_parsing"):
        what = "a number" if kind.startswith("float") else "a whole number"
        number = _NUMBER.match(value) if isinstance(value, str) else None
        hint = f"; write {number[1]}" if number and what == "a number" else ""
        return f"must be {what}{_in(unit)}, got {got}{hint}"
    if kind in ("literal_error", "union_tag_invalid"):
        expected = str(context.get("expected") or context.get("expected_tags"))
        options = re.findall(r"'([^']*)'", expected)
        got = _shown(context.get("tag", value))
        hint = nearest(str(context.get("tag", value)), options)
        return f"must be one of {', '.join(options)}; got {got}{'; ' + hint if hint else ''}"
    if kind in ("too_short", "too_long"):
        bound = context.get("min_length", context.get("max_length"))
        least = "at least" if kind == "too_short" else "at most"
        return f"needs {least} {bound} items, got {context.get('actual_length')}"
    if kind == "string_too_short":
        return "must not be empty"
    if kind == "string_too_long":
        most = context.get("max_length")
        return f"must have at most {most} characters, got {len(str(value))}"
    return _shape(kind, got, path, schema, loc) or detail["msg"].removeprefix("Value error, ")


def _shape(kind: str, got: str, path: Path, schema: JsonSchema, loc: Path) -> str:
    """Sentences for a value of the wrong shape."""
    if kind.startswith("bool"):
        return f"must be true or false, got {got}"
    if kind == "string_type":
        return f"must be text, got {got}; put it in quotes"
    if kind in ("list_type", "tuple_type"):
        return f"must be a list [..., ...], got {got}"
    if kind in ("model_type", "dict_type", "model_attributes_type"):
        known = list(_under(schema, loc).get("properties", {}))
        known = f" ({', '.join(known)})" if known else ""
        return f"needs keys of its own{known}, got {got}" + ("" if path else "; not a scenario")
    return ""


def _in(unit: str) -> str:
    return f" in {unit}, without the unit" if unit else ""


def _shown(value: object) -> str:
    if value is None:
        return "nothing"
    if isinstance(value, dict):
        return "a mapping"
    text = {True: "true", False: "false"}[value] if isinstance(value, bool) else repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


_BOUNDS = {"exclusiveMinimum": ">", "minimum": ">=", "exclusiveMaximum": "<", "maximum": "<="}


def _range(schema: JsonSchema) -> str:
    """`> 0 and <= 1`."""
    return " and ".join(f"{sign} {schema[key]:g}" for key, sign in _BOUNDS.items() if key in schema)


def _under(root: JsonSchema, loc: Path) -> JsonSchema:
    """The part of a JSON Schema that a key path leads to; empty where there is none."""
    here = _opened(root, root)
    for part in loc:
        forms = cast(list[JsonSchema], here.get("oneOf", []))
        tags = cast(dict[str, str], here.get("discriminator", {}).get("mapping", {}))
        if part in tags:
            here = _opened(root, {"$ref": tags[str(part)]})
        elif isinstance(part, int):
            items = cast(list[JsonSchema], here.get("prefixItems", []))
            here = _opened(root, items[part] if part < len(items) else here.get("items", {}))
        elif part in here.get("properties", {}):
            here = _opened(root, here["properties"][part])
        elif forms:  # distinguished by form, not by a key: the part is that form's name
            described = [form for form in forms if "$ref" in form]
            here = _opened(root, described[0]) if described else {}
        else:
            return {}
    return here


def _opened(root: JsonSchema, schema: JsonSchema) -> JsonSchema:
    """A schema with its reference followed, and the one form that is not null chosen."""
    forms = [f for f in cast(list[JsonSchema], schema.get("anyOf", [])) if f.get("type") != "null"]
    if len(forms) == 1:
        return {**schema, **_opened(root, forms[0])}
    if "$ref" in schema:
        target = root["$defs"][str(schema["$ref"]).rsplit("/", 1)[-1]]
        about = {k: v for k, v in schema.items() if k == "description"}
        return {**_opened(root, target), **about}
    return schema
