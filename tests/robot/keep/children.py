"""A process that starts another one, which would sleep for long: on its own, or bound."""

import sys
import time

from cohelm.robot.keep.processes import end_with_parent, start_process


def sleep(how: str) -> None:
    release = end_with_parent()
    if how == "free":
        release()
    print("ready", file=sys.stderr, flush=True)
    time.sleep(60.0)


if __name__ == "__main__":
    print(start_process("cohelm sleeper", sleep, sys.argv[1]).pid, flush=True)
    time.sleep(60.0)
