"""The robot in a process beside the station's, on one machine."""

from __future__ import annotations

import logging
import multiprocessing
import threading
from collections.abc import Callable
from multiprocessing.connection import Connection, wait
from typing import TYPE_CHECKING, Any

from cohelm.core.errors import CohelmError
from cohelm.drive.operate import DriveOptions
from cohelm.drive.teleop_server import TeleopConfig
from cohelm.robot.keep.processes import end_with_parent, how_ended, resume, start_process

if TYPE_CHECKING:
    from cohelm.drive.live import LiveConfig

_log = logging.getLogger("cohelm.drive")
_START = 900.0
"""Time limit for the start, compiling included [s]."""
_END = 15.0
"""Time limit for the end; then the process is terminated [s]."""
_WAITS = 1.5
"""An end that takes longer is no longer waited for in silence [s]."""


class RobotProcess:
    """A robot in a process of its own; it ends when this process does, in whatever way.

    A context manager. The robot is stopped before its process ends. When that ends by itself, or is
    killed, `over` says so; it is never restarted automatically.
    """

    def __init__(
        self, options: DriveOptions, config: TeleopConfig, carry_on: bool = False,
        patience: float = 0.0, pictures: float = 5.0, live: LiveConfig | None = None,
    ) -> None:  # fmt: skip
        """patience, pictures, live: as in `SessionConfig`. Returns at once: see `ready`, and `over`
        where the robot can not be started."""
        self._line, theirs = multiprocessing.Pipe()
        self._process = start_process(
            "cohelm robot", _drive, theirs, options, config, carry_on, patience, pictures, live
        )
        theirs.close()
        self.host, self.port = "", 0
        self.ready = threading.Event()
        """Set when the robot can be driven, at `host` and `port`."""
        self.over = ""
        """Why the robot's process has ended without a request; empty: it has not."""
        self._driver = f", with {options.driver}" if options.driver else ""
        self._end_requested = False
        self._on_ready: Callable[[], None] | None = None
        self._turn = threading.Lock()
        self._then: Callable[[], None] = lambda: None
        self._on_wait: Callable[[], None] = lambda: None
        self._watch = threading.Thread(target=self._watching, name="robot's end", daemon=True)
        self._watch.start()

    def _awaited(self) -> None:
        """Wait until it can be driven. Raises CohelmError where it can not be started."""
        try:
            if not self._line.poll(_START):
                raise CohelmError(f"the robot was not ready within {_START:.0f} s; see above")
            answer = self._line.recv()
        except (EOFError, OSError):
            self._end()
            raise CohelmError(
                f"the robot's process ended before it was ready{self._driver}: {self._how_ended()}"
            ) from None
        except BaseException:
            self._process.kill()  # it does not drive yet, and need not be waited for
            self._end()
            raise
        if isinstance(answer, str):
            self._end()
            raise CohelmError(answer)
        self.host, self.port = str(answer[0]), int(answer[1])

    def __enter__(self) -> RobotProcess:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def pid(self) -> int:
        """Of the robot's process."""
        return self._process.pid or 0

    def afterwards(self, then: Callable[[], None]) -> None:
        """Call `then`, in a thread, when the robot's process ends without a request."""
        self._then = then
        if self.over:
            then()

    def when_ready(self, then: Callable[[], None]) -> None:
        """Call a function, in a thread, as soon as the robot can be driven. A CohelmError from it
        ends the robot."""
        with self._turn:
            came = self.ready.is_set()
            self._on_ready = None if came else then
        if came:
            then()

    def when_waiting(self, then: Callable[[], None]) -> None:
        """Call a function, in the thread that closes, if the robot's process does not end soon."""
        self._on_wait = then

    def kill(self) -> None:
        """End the robot's process at once; its gate process stops the robot. Also in a signal's
        handler while another call of `close` waits."""
        self._process.kill()

    def close(self) -> None:
        """Request the robot to stop and end, and wait for that."""
        self._end_requested = True
        if not self.ready.is_set():
            self._process.kill()  # it does not drive yet, and need not be waited for
            self._watch.join()
        self._end()

    def _end(self) -> None:
        self._line.close()
        resume(self._process)
        self._process.join(_WAITS)
        if self._process.is_alive():
            self._on_wait()
        self._process.join(_END)
        if self._process.is_alive():
            self._process.terminate()
            self._process.join(_END)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()

    def _watching(self) -> None:
        try:
            self._awaited()
            with self._turn:
                self.ready.set()
                on_ready = self._on_ready
            if on_ready is not None:
                on_ready()  # once: a later caller calls it itself
        except CohelmError as error:
            if not self._end_requested:
                self.over = str(error)
                self._then()
            return
        wait([self._process.sentinel])
        if not self._end_requested:
            self.over = f"the robot's process has ended: {self._last_words()}"
            self._then()

    def _last_words(self) -> str:
        """The process's last message; or else how it ended."""
        try:
            if self._line.poll():
                return str(self._line.recv())
        except (EOFError, OSError):
            pass
        return self._how_ended()

    def _how_ended(self) -> str:
        return how_ended(self._process, _END) or "it does not end"


def _drive(
    line: Connection, options: DriveOptions, config: TeleopConfig, carry_on: bool, patience: float,
    pictures: float, live: LiveConfig | None,
) -> None:  # fmt: skip
    """Main function of the robot's process."""
    release = end_with_parent()
    from cohelm.drive.on_topics import TopicsConfig, on_topics
    from cohelm.drive.operate import end_signals, map_and_zones, masks_on_topics, robot_factory
    from cohelm.drive.session import SessionConfig
    from cohelm.drive.teleop_server import serve
    from cohelm.loop.loop import LoopParams

    with end_signals() as end:

        def over() -> str:
            try:
                return end.reason or ("the station has ended" if line.poll() else "")
            except OSError:
                return "the station has ended"

        def ready(address: tuple[Any, ...]) -> None:
            end.handle_signals()
            line.send(address)
            release()

        try:
            made = robot_factory(options)
            masks = masks_on_topics(options, made)
            chart, zones = map_and_zones(options, made, masks)
            plan = SessionConfig(
                made, live=live, known=chart, zones=zones, loop=LoopParams(carry_on=carry_on),
                patience=patience, pictures=pictures,
            )  # fmt: skip
            with on_topics(made, TopicsConfig(masks=masks), _log.warning) as topics:
                serve(plan, config, ready, over, topics)
        except CohelmError as error:
            try:
                line.send(str(error))
            except OSError:  # the station has ended
                _log.error("%s", error)
