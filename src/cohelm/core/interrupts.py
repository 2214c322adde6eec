"""The signals that end a command."""

import signal

INTERRUPTS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Ctrl-C, the end of a batch system's time, and that of the terminal; under `nohup`, which ignores
the last, a command continues without one."""
