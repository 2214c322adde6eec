"""Hypothesis profiles: `pytest --hypothesis-profile=thorough` digs; CI repeats its examples."""

import os
import signal

import numba
from hypothesis import HealthCheck, settings

_calm = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}
settings.register_profile("default", max_examples=40 if numba.config.DISABLE_JIT else 100, **_calm)
settings.register_profile("ci", max_examples=100, derandomize=True, print_blob=True, **_calm)
settings.register_profile("thorough", max_examples=5000, **_calm)
settings.load_profile("ci" if os.environ.get("CI") else "default")

# Started in the background of a shell, a process ignores Ctrl-C, and so would all that tests start.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
