"""Serves a record to the pages like a robot; every page has its own playback position."""

from __future__ import annotations

import time
from collections.abc import Callable

from cohelm.drive.playback import Playback
from cohelm.link.bulk_messages import slot_of
from cohelm.link.rasters import drawable
from cohelm.link.station_end import LinkState
from cohelm.station.robot_link import News, PlaybackPosition, RefusingLink

_PERIOD = 0.03
_REFUSAL = "this is a record; nothing can be done to it any more"


class Replaying(RefusingLink):
    """Plays a record, at first from its start; stops at its end. It can not be steered."""

    def __init__(self, played: Playback, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__(_REFUSAL)
        self._played, self._clock = played, clock
        self._place = PlaybackPosition(0.0, True, 1.0)
        self._since = clock()
        self._sent_at = -1.0
        self._first = True
        self._new = True
        self._shown: dict[object, object] = {}

    @property
    def duration(self) -> float:
        """Of the record [s]."""
        return self._played.duration

    @property
    def place(self) -> PlaybackPosition:
        """The present playback position."""
        at, playing, speed = self._place
        if playing:
            at += (self._clock() - self._since) * speed
            if at >= self.duration:
                self._place = PlaybackPosition(self.duration, False, speed)
                return self._place
        return PlaybackPosition(at, playing, speed)

    def play(self, playing: bool | None, speed: float | None, at: float | None) -> None:
        """Continue from here, or from `at`; from the start if it was at the end."""
        now = self.place
        playing = now.playing if playing is None else playing
        speed = now.speed if speed is None else speed
        where = now.at if at is None else min(max(at, 0.0), self.duration)
        if playing and at is None and not now.playing and where >= self.duration:
            where = 0.0
        self._place, self._since = PlaybackPosition(where, playing, speed), self._clock()
        self._new = True

    def news(self) -> list[News]:
        """The robot's messages at this position."""
        out = super().news()
        if self._first:
            self._first = False
            out += [News(message, self._played.start, 0.0) for message in self._played.first()]
        now = self._clock()
        if self._new or now - self._sent_at >= _PERIOD:
            self._new = False
            self._sent_at = now
            out += [
                news._replace(message=drawable(news.message))
                for news in self._played.at(self.place.at)
                if self._is_new(news.message)
            ]
        return out

    def _is_new(self, message: object) -> bool:
        """Whether it is not the last of its kind that was sent."""
        slot = slot_of(message), getattr(message, "lidar", 0)
        before, self._shown[slot] = self._shown.get(slot), message
        return before is not message

    def state(self) -> LinkState:
        """There is no link."""
        return LinkState(True, "a record", "")
