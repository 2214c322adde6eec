"""Where both ends are put together: robot, gate, loop, record, and who sits at the stick.

`simulated` the robot of a scenario; `recorder` the record, in a process of its own; `session` all
of it, started and ended in the right order; `operate` from the command line to a session; `served`
a session driven over the link, `desk` what is asked of it beside driving; `beside` all that in a
process beside the station's; `film` shows a record again; `factory` a robot by somebody else, and
`library` driving it from a script.
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
