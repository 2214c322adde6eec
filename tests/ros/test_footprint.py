"""A footprint that changes while driving: what is none, and when another one is taken up."""

from types import SimpleNamespace

import numpy as np
import pytest

from cohelm.law.verdict import Verdict
from cohelm.pilot.reshaping import Shape
from cohelm.robot.limits import Limits
from cohelm.robot.model import RobotModel
from cohelm.ros import footprint
from cohelm.ros.footprint import FootprintTopic
from cohelm.ros.port import Received

NAN, INF = float("nan"), float("inf")
LIMITS = Limits(1.0, 1.0, 1.0, 1.0)
BOX = [(0.3, 0.2), (-0.3, 0.2), (-0.3, -0.2), (0.3, -0.2)]
ARM = [(0.6, 0.1), (0.3, 0.2), (-0.3, 0.2), (-0.3, -0.2), (0.3, -0.2), (0.6, -0.1)]


class Topic:
    """The topic in a test's hands."""

    def __init__(self, axle=0.0):
        self.heard = []
        box = [(0.346, 0.2), (-0.346, 0.2), (-0.346, -0.2), (0.346, -0.2)]  # reaches 0.4 m
        model = RobotModel.of("box", box, LIMITS).model_copy(update={"axle_x_m": axle})
        self.told = FootprintTopic(self, "/footprint", "base_link", model)

    def subscribe(self, topic, kind, qos, heard):
        self.heard.append(heard)
        return lambda: None

    def say(self, corners, frame="base_link"):
        points = [SimpleNamespace(x=x, y=y, z=0.0) for x, y in corners]
        header = SimpleNamespace(frame_id=frame)
        message = SimpleNamespace(header=header, polygon=SimpleNamespace(points=points))
        for heard in self.heard:  # best effort and transient local, both
            heard(Received(message, 0.0))


def test_until_a_message_arrives_the_robots_file_applies():
    assert Topic().told.read() == (None, "")


def test_an_outline_is_taken_either_way_round_and_wherever_it_begins():
    topic = Topic()
    topic.say(BOX)
    first, wrong = topic.told.read()
    assert wrong == ""
    assert len(first) == 4
    for again in (BOX[::-1], BOX[2:] + BOX[:2], [(x + 4e-4, y) for x, y in BOX]):
        for _ in range(10):
            topic.say(again)
        assert topic.told.read() == (first, "")
    topic.say(ARM, frame="/base_link")
    assert len(topic.told.read()[0]) == 6


def test_an_outline_is_taken_from_the_axle_where_that_is_not_the_bases_origin():
    topic = Topic(axle=0.1)
    topic.say(BOX)
    told, wrong = topic.told.read()
    assert wrong == ""
    assert (told[:, 0].min(), told[:, 0].max()) == pytest.approx((-0.4, 0.2))


@pytest.mark.parametrize(
    ("corners", "frame", "said"),
    [
        ([(0.3, 0.2), (0.0, 0.0), (-0.3, 0.2), (-0.3, -0.2), (0.3, -0.2)], "base_link", "dent"),
        (BOX[:2], "base_link", "at least 3 different corners, got 2"),
        ([], "base_link", "at least 3 different corners, got 0"),
        ([(0.3, NAN), *BOX[1:]], "base_link", "must be finite numbers"),
        ([(INF, 0.2), *BOX[1:]], "base_link", "must be finite numbers"),
        ([(300.0, 200.0), (-300.0, 200.0), (-300.0, -200.0)], "base_link", "divide millimetres"),
        ([(x, x) for x in (0.1, 0.2, 0.3)], "base_link", "must have a width"),
        ([BOX[0], BOX[2], BOX[1], BOX[3]], "base_link", "crosses itself"),
        ([(x + 1.0, y) for x, y in BOX], "base_link", "does not contain the middle of the axle"),
        ([(3 * x, 3 * y) for x, y in BOX], "base_link", "more than twice the 0.40 m"),
        ([(0.001, 0.0), (-0.001, 0.001), (-0.001, -0.001)], "base_link", "leaves out [0.17, 0.1]"),
        ([(0.4 * x, 2.0 * y) for x, y in BOX], "base_link", "give the bare robot as least_footpri"),
        ([(np.cos(a), np.sin(a)) for a in np.arange(0, 6.2, 0.1)], "base_link", "at most 32"),
        (BOX, "map", "in the frame 'map', and an outline is in that of the base, 'base_link'"),
        (BOX, "", "in the frame ''"),
    ],
)
def test_an_invalid_outline_is_refused_and_the_earlier_one_applies(corners, frame, said):
    topic = Topic()
    topic.say(BOX)
    before = topic.told.read()[0]
    topic.say(corners, frame)
    outline, wrong = topic.told.read()
    assert outline is before
    assert wrong.startswith("/footprint: ")
    assert said in wrong
    topic.say(BOX)
    assert topic.told.read() == (before, "")


def test_bytes_that_are_no_message_are_reported():
    topic = Topic()
    topic.heard[0](Received(None, 0.0, "7 bytes are no PolygonStamped"))
    assert topic.told.read() == (
        None,
        "/footprint: it can not be read (7 bytes are no PolygonStamped)",
    )


def test_one_that_changes_with_every_message_is_none(monkeypatch):
    topic, now = Topic(), [0.0]
    monkeypatch.setattr(footprint.time, "monotonic", lambda: now[0])
    for k in range(7):
        topic.say([(x + 0.01 * k, y) for x, y in BOX])
        assert ("changes with every message" in topic.told.read()[1]) == (k >= 5)
        now[0] += 0.2
    seldom = Topic()
    for k in range(20):
        seldom.say(ARM if k % 2 else BOX)
        assert seldom.told.read()[1] == ""
        now[0] += 1.5


def shape():
    told = []
    made = Shape(np.array(BOX), told.append)
    return made, told


def test_both_outlines_count_until_a_motion_is_certified_with_both():
    made, told = shape()
    made.take(None)
    made.take(np.array(BOX))
    assert told == []
    made.take(np.array(ARM))
    assert len(told) == 1
    assert made.settle(Verdict.BRAKING, False)
    assert made.settle(Verdict.STANDING, False)
    assert made.settle(Verdict.INVALID, False)
    made.take(np.array(ARM))  # said again
    assert len(told) == 1
    assert not made.settle(Verdict.SHAPED, False)
    assert np.array_equal(told[-1], ARM)
    assert not made.settle(Verdict.BRAKING, False)
    made.take(np.array(BOX))
    assert told[-1][:, 0].max() == pytest.approx(0.6)  # smaller: the larger counts meanwhile
    assert made.settle(Verdict.BRAKING, False)
    assert not made.settle(Verdict.BRAKING, True)  # it stands
    assert np.array_equal(told[-1], BOX)


def test_of_three_all_count():
    made, told = shape()
    made.take(np.array(ARM))
    made.take(np.array([(0.3, 0.35), (-0.3, 0.35), (-0.3, -0.35), (0.3, -0.35)]))
    assert told[-1].max(axis=0) == pytest.approx([0.6, 0.35])
    made.settle(Verdict.UNTOUCHED, False)
    assert told[-1].max(axis=0) == pytest.approx([0.3, 0.35])
