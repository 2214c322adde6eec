"""The command line: thin commands, each importing what it needs when it is called.

A module here holds a group of commands and adds them to `app`; to add one, import it below.
The order of the imports is the order in `cohelm --help`.
"""

from cohelm.cli import campaign, link, map, robot, scenarios, station
from cohelm.cli.app import app, main

__all__ = ["app", "campaign", "link", "main", "map", "robot", "scenarios", "station"]
