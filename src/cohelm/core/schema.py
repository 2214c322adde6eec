"""The strict base of everything a user writes in YAML."""

from __future__ import annotations

import ast
import inspect
from itertools import pairwise
from typing import Annotated, Any, NoReturn

from pydantic import BaseModel, ConfigDict, Field, GetJsonSchemaHandler, ValidationError
from pydantic_core import CoreSchema, ErrorDetails, PydanticCustomError

Coordinate = Annotated[float, Field(ge=-1e5, le=1e5)]
"""x or y of a world [m]."""


def refuse(*problems: tuple[str, str]) -> NoReturn:
    """Raise, from a validator, problems as (key path below the model, sentence)."""
    text = "; ".join(f"{key}: {sentence}" if key else sentence for key, sentence in problems)
    raise PydanticCustomError("problems", "{text}", {"said": problems, "text": text})


def first_fault(error: ValidationError) -> str:
    """What is wrong with keys that no file has, as one sentence."""
    return fault_sentence(error.errors(include_url=False)[0])


def fault_sentence(fault: ErrorDetails) -> str:
    """One of pydantic's faults: the key's path, if it is of one, and why."""
    place = ".".join(str(key) for key in fault["loc"])
    text = fault["msg"].removeprefix("Value error, ")
    return f"{place}: {text}" if place else text


def renamed(**keys: str) -> ConfigDict:
    """The configuration of a model some of whose keys had other names: old=new. An old one is
    refused with the new one."""
    return ConfigDict(json_schema_extra={RENAMED: dict(keys)})


RENAMED = "x-renamed"
"""Under this, a model's JSON schema has its keys' old names."""


class Schema(BaseModel):
    """Unknown keys, NaN and infinities are refused; values do not change after loading."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        """With the text below each key as its description.

        pydantic reads it from the sources when it makes the class (`use_attribute_docstrings`):
        0.16 s in each process that knows scenarios.
        """
        made = handler(core_schema)
        keys = handler.resolve_ref_schema(made)["properties"]
        for base in cls.__mro__:
            if base is not Schema and issubclass(base, Schema):
                for key, text in _texts(base).items():
                    keys[key].setdefault("description", text)
        return made


def _texts(model: type[Schema]) -> dict[str, str]:
    """The text below each key of a model."""
    (made,) = ast.parse(inspect.getsource(model)).body
    found: dict[str, str] = {}
    for key, text in pairwise(made.body if isinstance(made, ast.ClassDef) else ()):
        match key, text:
            case ast.AnnAssign(ast.Name(name)), ast.Expr(ast.Constant(str(said))):
                found[name] = inspect.cleandoc(said)
            case _:
                pass
    return found
