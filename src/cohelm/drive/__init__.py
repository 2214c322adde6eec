"""Where both ends are put together: robot, gate, loop, record, and who sits at the stick.

`simulated` makes the robot of a scenario, `factory` one by somebody else. `session` is all of a
drive, started and ended in the right order; `operate` makes one of the command line, `library` of a
Python script. `teleop_server` is a session driven over the link, `operator_requests` what is
requested of it beside driving, `robot_process` all that in a process beside the station's.
`recorder` writes the record, in a process of its own; `playback` shows one again.
"""

from __future__ import annotations

import sys
from types import ModuleType
from typing import Any


class _Callable(ModuleType):
    """This room and the function `cohelm.drive` have one name: importing any of its modules puts
    the room in the function's place, so the room answers the call."""

    def __call__(self, *args: Any, **options: Any) -> Any:
        from cohelm.drive.library import drive

        return drive(*args, **options)


sys.modules[__name__].__class__ = _Callable
