"""Puts a drive together: robot, gate, loop, record and operator.

`factory` makes the robot, a scenario's or a user's. `session` starts and ends all parts of a drive
in the right order; `operate` makes one from the command line, `library` from a Python script.
`teleop_server` is a session driven over the link, `operator_requests` handles its requests beside
driving, `robot_process` runs it in a process beside the station's. `recorder` writes the record, in
a process of its own; `playback` plays one back.
"""

from __future__ import annotations

import sys
from types import ModuleType
from typing import Any


class _Callable(ModuleType):
    """This package and the function `cohelm.drive` share a name: importing any of its modules puts
    the package in the function's place, so the package is callable."""

    def __call__(self, *args: Any, **options: Any) -> Any:
        from cohelm.drive.library import drive

        return drive(*args, **options)


sys.modules[__name__].__class__ = _Callable
