"""The JSON Schema of scenario files, for editors."""

from __future__ import annotations

import json
from typing import Any

from cohelm.scenario.model import Scenario


def json_schema() -> dict[str, Any]:
    """What a scenario file may contain, as JSON Schema 2020-12."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **Scenario.model_json_schema(),
        "description": (Scenario.__doc__ or "").partition("\n")[0],  # without the Python example
    }


def text() -> str:
    """The same as text, as shipped beside the scenarios."""
    return json.dumps(json_schema(), indent=2, ensure_ascii=False) + "\n"
