"""Ctrl-C in the middle of compiled code ends a step, not the process."""

import subprocess
import sys

INTERRUPTED = """
import os, random, signal, threading, time
from cohelm.cli.interrupt import patient
from cohelm.core.types import Desired, Pose, Stick, disc, discs
from cohelm.law.step import step

post = discs(disc(x=0.5, y=0.05, radius=0.1))
def once():
    step(Pose(0.0, 0.0, 0.0), Desired(0.1, 0.0, 0.0, 0.5, 0.0), Stick(0.0, 0.0), post)

once()
signal.signal(signal.SIGINT, signal.default_int_handler)
if KIND:
    patient()
wanted = threading.Event()
def nag():
    while True:
        wanted.wait()
        wanted.clear()
        time.sleep(random.uniform(1e-4, 1e-3))
        os.kill(os.getpid(), signal.SIGINT)
threading.Thread(target=nag, daemon=True).start()
for _ in range(40):
    try:
        wanted.set()
        while True:
            once()
    except KeyboardInterrupt:
        pass
print("alive", flush=True)
os._exit(0)
"""


def outcome(kind: bool) -> tuple[int, str]:
    code = INTERRUPTED.replace("KIND", str(kind))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300)
    return done.returncode, done.stdout.strip()


def test_forty_interrupts_in_the_middle_of_steps_are_survived():
    assert outcome(kind=True) == (0, "alive")
