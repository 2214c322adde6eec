"""The strict base of everything a user writes in YAML."""

from __future__ import annotations

from typing import Annotated, NoReturn

from pydantic import BaseModel, ConfigDict, Field
from pydantic_core import PydanticCustomError

Coordinate = Annotated[float, Field(ge=-1e5, le=1e5)]
"""x or y of a world [m]."""


def refuse(*problems: tuple[str, str]) -> NoReturn:
    """Raise, from a validator, problems as (key path below the model, sentence)."""
    raise PydanticCustomError("problems", "{said}", {"said": problems})


def renamed(**keys: str) -> ConfigDict:
    """The configuration of a model some of whose keys had other names: old=new. An old one is
    refused with the new one."""
    return ConfigDict(json_schema_extra={RENAMED: dict(keys)})


RENAMED = "x-renamed"
"""Under this, a model's JSON schema has its keys' old names."""


class Schema(BaseModel):
    """Unknown keys, NaN and infinities are refused; values do not change after loading."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, allow_inf_nan=False, use_attribute_docstrings=True
    )
