"""A real robot at the other end of a bad network: `cohelm robot --listen` in its own namespace."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

from cohelm.link import keys
from tests.link import net
from tests.link.ends import until

STARTED = 240.0  # with nothing compiled, on a busy machine [s]
PORT = 7660


class FarRobot:
    """The command, in the robot's namespace; paired with the station of this process."""

    def __init__(self, network: net.Network, scenario: str, folder: Path, *more: str) -> None:
        """folder: for keys, record and log. COHELM_KEYS must be `folder/keys`."""
        assert os.environ["COHELM_KEYS"] == str(folder / "keys")
        self.record = folder / "far.mcap"
        self.log = folder / "far.log"
        if not (folder / "far.pair").exists():
            keys.pair("far", folder / "far.pair")
            keys.install(folder / "far.pair")
        command = [sys.executable, "-m", "cohelm", "robot", scenario, "--json"]
        command += ["--listen", f"{net.ROBOT}:{PORT}", "--record", str(self.record), *more]
        with network.robot():
            self.process = subprocess.Popen(
                command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
            )
        assert self.process.stderr is not None
        self.said = ""
        self._reader = threading.Thread(target=self._read, args=(self.process.stderr,))
        self._reader.start()
        try:
            until(lambda: "listening on" in self.said or self.process.poll() is not None, STARTED)
            assert self.process.poll() is None, self.said
        except BaseException:
            self.close()
            raise

    def _read(self, stream) -> None:
        for line in stream:
            self.said += line

    def logged(self, pattern: str, since: int = 0, within: float = 30.0) -> re.Match[str]:
        """Wait until the log says so, beyond its first `since` letters."""
        end = time.monotonic() + within
        text = ""
        while time.monotonic() < end:
            text = self.log.read_text()[since:]
            found = re.search(pattern, text)
            if found:
                return found
            time.sleep(0.05)
        raise AssertionError(f"the log does not say {pattern!r}:\n{text}")

    def end(self) -> dict:
        """Have it stop and end; its summary."""
        self.process.send_signal(signal.SIGTERM)
        assert self.process.stdout is not None
        out = self.process.stdout.read()
        self.close()
        return json.loads(out)

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.terminate()
        try:
            self.process.wait(60.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self._reader.join()
        for pipe in (self.process.stdout, self.process.stderr):
            pipe.close()
