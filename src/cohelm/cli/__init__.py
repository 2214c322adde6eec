"""The command line: thin commands, each importing what it needs when it is called.

A module here holds a group of commands and adds them to `app`; to add one, import it below.
The order of the imports is the order in `cohelm --help`.
"""

# isort: off
from cohelm.cli import scenarios
from cohelm.cli import campaign
from cohelm.cli import station
from cohelm.cli import robot
from cohelm.cli import ros
from cohelm.cli import calibrate
from cohelm.cli import map
from cohelm.cli import link
from cohelm.cli.app import app, main
# isort: on

__all__ = [
    "app", "calibrate", "campaign", "link", "main", "map", "robot", "ros", "scenarios", "station",
]  # fmt: skip
