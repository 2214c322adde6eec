"""Twist in to twist out through `cohelm filter`, over DDS: `python -m benchmarks.ros2`.

    python -m benchmarks.ros2 [--count 1000] [--rate 50] [--scenario lab-guard]

Base, filter, gate and controller are processes of their own on this machine. The controller
commands a small circle whose speed differs from command to command, so that each is recognised on
/cmd_vel; the time is from its `send` to its arrival there, both ways of DDS included.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np

from cohelm.core.types import Twist
from cohelm.ros.dds import DdsTransport
from cohelm.ros.messages import command
from cohelm.ros.mismatch import TWIST
from cohelm.ros.port import COMMAND, SENSOR
from tests.robot.keep.test_processes import children


def used(pid: int) -> float:
    """Processor time used by a process, all its threads together [s]."""
    threads = Path(f"/proc/{pid}/task").glob("*/schedstat")
    return sum(1e-9 * int(thread.read_text().split()[0]) for thread in threads)


def started(*arguments: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen([sys.executable, "-m", "cohelm", *arguments])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--rate", type=float, default=50.0)
    parser.add_argument("--scenario", default="lab-guard")
    args = parser.parse_args()
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ.setdefault("ROS_DOMAIN_ID", "87")
    base = started("base", args.scenario)
    transport = DdsTransport("controller")
    sent: dict[float, float] = {}
    took: list[float] = []

    def on_command(received) -> None:
        v = received.message.linear.x
        if v in sent:
            took.append(received.stamp - sent.pop(v))

    transport.subscribe("/cmd_vel", TWIST, SENSOR, on_command)
    out = transport.publish("/cmd_vel_nav", TWIST, COMMAND)
    over, number = threading.Event(), 0

    def publish() -> None:
        nonlocal number
        due = time.monotonic()
        while not over.is_set():
            due += 1.0 / args.rate
            time.sleep(max(due - time.monotonic(), 0.0))
            number += 1
            v = 0.1 + 1e-5 * (number % 1000)
            sent[v] = time.monotonic()
            out.send(command(Twist(v, 0.4), TWIST, ""))

    threading.Thread(target=publish, daemon=True).start()
    while not any(e.topic == "/odom" for e in transport.endpoints()):
        time.sleep(0.2)
    node = started("filter", "--robot", "sally", "--wait", "60")
    while not took:
        time.sleep(0.2)
    time.sleep(3.0)
    took.clear()
    sent.clear()
    first = number
    pids = {"filter": node.pid, **children(node.pid)}
    before, start = {name: used(pid) for name, pid in pids.items()}, time.monotonic()
    while number - first < args.count:
        time.sleep(0.1)
    time.sleep(0.2)
    wall = time.monotonic() - start
    shares = {name: (used(pid) - before[name]) / wall for name, pid in pids.items()}
    over.set()
    milliseconds = 1e3 * np.array(took)
    print(f"{len(took)} of {number - first} commands came out as they were")
    for name, q in (("median", 50.0), ("99 %", 99.0), ("most", 100.0)):
        print(f"{name}: {np.percentile(milliseconds, q):.2f} ms")
    each = ", ".join(f"{name} {share:.1%}" for name, share in shares.items())
    print(f"filter and gate use {sum(shares.values()):.1%} of one core ({each})")
    print(f"load {os.getloadavg()[0]:.1f}")
    for process in (node, base):
        process.terminate()
        process.wait()
    transport.close()


if __name__ == "__main__":
    main()
