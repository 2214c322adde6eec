"""Records are started and ended on request without a queue."""

import time

import pytest

from cohelm.drive.jobs import ThreadJobs
from cohelm.link.messages import RequestKind
from cohelm.link.rate import TokenBucket
from tests.drive.resuming import Drive, FakeRecording


class Slow(FakeRecording):
    """As on a busy machine."""

    at_work = most = 0
    made: list["Slow"] = []  # noqa: RUF012

    def __init__(self, *about) -> None:
        super().__init__(*about)
        Slow.at_work += 1
        Slow.most = max(Slow.most, Slow.at_work)
        Slow.made.append(self)

    def close(self, within: float = 0.0) -> bool:
        time.sleep(0.3)
        Slow.at_work -= 1
        return super().close(within)


def test_five_hundred_toggles_leave_one_record_and_delay_no_end(tmp_path):
    Slow.at_work = Slow.most = 0
    Slow.made.clear()

    def script(drive: Drive):
        anna = drive.station("anna")
        # the link refuses 20 a second; the switch itself has to stand more
        anna.client.requests = TokenBucket(1e3, 1e3, drive.link.now())
        yield from range(5)
        anna.ask(RequestKind.TAKE)
        yield from range(5)
        for k in range(500):
            anna.ask(RequestKind.RECORD, (k + 1) % 2)
            yield
            if k in (0, 250):  # on, and whoever makes them gets as much time as he needs
                end = time.monotonic() + 20.0
                while len(Slow.made) < (2 if k else 1) and time.monotonic() < end:
                    time.sleep(0.005)
                    yield
        yield from range(5)
        granted = [
            g for n, (g, _) in anna.answers.items() if anna.asked[n].what == RequestKind.RECORD
        ]
        assert len(granted) > 450
        assert all(granted)

    with Drive(tmp_path) as drive:
        switch = drive.desk._records
        switch._jobs, switch._make = ThreadJobs("records"), Slow
        drive.run(script(drive))
        began = time.monotonic()
        switch.close()
        took = time.monotonic() - began
    assert took < 3.0  # a record that ends, and one more
    assert Slow.most == 1
    assert Slow.at_work == 0
    assert len(list(tmp_path.glob("*.mcap"))) == len(Slow.made) > 1
    assert not list(tmp_path.glob("*.part"))


def recording_station(drive: Drive):
    """A station that drives, and has begun a record."""
    anna = drive.station("anna")
    yield from range(5)
    anna.ask(RequestKind.TAKE)
    yield from range(5)
    anna.ask(RequestKind.RECORD, 1)
    yield from range(10)
    return anna


def test_after_a_recorder_that_failed_another_record_can_be_begun(tmp_path):
    """As when the disk was full and there is room again; what was written can be fetched."""

    def script(drive: Drive):
        anna = yield from recording_station(drive)
        assert drive.loop.log.open
        drive.loop.log.fault = "recording stopped: No space left on device"
        yield from range(10)
        assert not drive.loop.log.open
        assert len(list(tmp_path.glob("*.mcap"))) == 1
        number = anna.ask(RequestKind.RECORD, 1)
        yield from range(10)
        assert anna.answers[number] == (True, "")
        assert drive.loop.log.open

    with Drive(tmp_path) as drive:
        drive.run(script(drive))


def test_only_the_driver_can_record(tmp_path):
    def script(drive: Drive):
        anna, bert = drive.station("anna"), drive.station("bert")
        yield from range(5)
        anna.ask(RequestKind.TAKE)
        yield from range(5)
        anna.ask(RequestKind.RECORD, 1)
        anna.ask(RequestKind.GIVE, bert.number)
        number = bert.ask(RequestKind.RECORD, 1)
        yield from range(10)
        assert anna.answers[2] == (False, "you are no longer the driver")
        assert not bert.answers[number][0]
        bert.ask(RequestKind.RECORD, 1)
        yield from range(10)
        assert drive.loop.log.open
        bert.ask(RequestKind.RECORD, 0)
        yield from range(10)
        assert not drive.loop.log.open

    with Drive(tmp_path) as drive:
        drive.run(script(drive))
    assert len(list(tmp_path.glob("*.mcap"))) == 1


@pytest.mark.parametrize("fails", ["begin", "end", "threads"])
def test_a_record_that_can_not_be_made_is_an_alarm(tmp_path, fails):
    """Whoever pressed the button is told, and not only the robot's log."""
    begun = []

    class Failing(FakeRecording):
        def begin(self, epoch: int) -> None:
            begun.append(epoch)
            if fails != "end":
                super().close()
            if fails == "begin":
                raise OSError(28, "No space left on device")
            if fails == "threads":
                raise RuntimeError("can't start new thread")
            super().begin(epoch)

        def close(self, within: float = 0.0) -> bool:
            return super().close(within) and fails != "end"

    def script(drive: Drive):
        anna = yield from recording_station(drive)
        anna.ask(RequestKind.RECORD, 0)
        yield from range(20)
        (alarm,) = drive.loop.alarms.worst()
        assert not alarm.acknowledged
        assert (
            alarm.text
            == {
                "begin": "no record: No space left on device",
                "end": "the record is not whole, or still being written",
                "threads": "no record: RuntimeError: can't start new thread",
            }[fails]
        )
        assert len(begun) == 1
        assert len(alarm.text.encode()) <= 64

    with Drive(tmp_path) as drive:
        drive.desk._records._make = Failing
        drive.run(script(drive))
