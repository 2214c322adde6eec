"""A process that has another one started, which would sleep for long: on its own, or bound."""

import sys
import time

from cohelm.robot.keep.processes import bound, started


def sleep(how: str) -> None:
    let_go = bound()
    if how == "free":
        let_go()
    print("ready", flush=True)
    time.sleep(60.0)


if __name__ == "__main__":
    print(started("cohelm sleeper", sleep, sys.argv[1]).pid, flush=True)
    time.sleep(60.0)
