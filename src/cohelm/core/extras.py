"""The error for a missing optional dependency, with the command to install it."""

from __future__ import annotations

import re
from importlib import metadata

from packaging.requirements import Requirement

from cohelm.core.errors import CohelmError


def requirements(extra: str) -> list[str]:
    """The requirements of an extra of cohelm on this machine, as pip takes them.

    The packages themselves and not `cohelm[extra]`: that works from a checkout, from a wheel and
    before any release alike.
    """
    try:
        declared = metadata.requires("cohelm") or []
    except metadata.PackageNotFoundError:  # run from the sources without being installed
        return [f"cohelm[{extra}]"]
    found: list[str] = []
    for line in declared:
        need = Requirement(line)
        only_so = need.marker is not None and not need.marker.evaluate({"extra": ""})
        if only_so and need.marker is not None and need.marker.evaluate({"extra": extra}):
            need.marker = None
            found.append(re.sub(r"\s", "", str(need)))
    return found


def missing(purpose: str, *extras: str) -> CohelmError:
    """The error for a feature whose packages are not installed.

    purpose: what needs them, the beginning of the sentence, e.g. "mapping".
    """
    return CohelmError(f"{purpose} needs what is not installed here: {pip_line(*extras)}")


def pip_line(*extras: str) -> str:
    """The command to install the packages of some extras."""
    named = (f"'{one}'" for extra in extras for one in requirements(extra))
    return f"pip install {' '.join(named)}"
