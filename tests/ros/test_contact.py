"""Bumpers and cliff sensors over ROS 2: Bool, Range that looks down, and a Create 3's hazards."""

import math
import time
from types import SimpleNamespace

import pytest

from cohelm.core.errors import CohelmError
from cohelm.record.ros2 import header
from cohelm.robot.contacts import CliffModel, ContactModel
from cohelm.ros import look as looking
from cohelm.ros.contact import (
    Contacts,
    contact_messages,
    contact_topics,
    doubt,
    is_on,
    kind_of_contact,
)
from cohelm.ros.found import Allowed
from cohelm.ros.look import look
from cohelm.ros.mismatch import BOOL, RANGE, TF
from cohelm.ros.port import Received
from cohelm.ros.robot import Ros2Robot, topics_of
from cohelm.ros.served import mounts
from cohelm.ros.topics import Topics
from cohelm.ros.types import HAZARDS, packed, type_hash, unpacked
from cohelm.scenario.load import robot
from tests.ros.test_unheard import BEST_EFFORT, ENDS, Pretended, Spoken, out, readings

FRONT = ContactModel(name="front", mount_x_m=0.35, width_m=0.4)
SWITCH = CliffModel(name="left", mount_x_m=0.3, mount_y_m=0.1)
DOWN = CliffModel(name="right", mount_x_m=0.3, mount_y_m=-0.1, floor_m=0.05, drop_m=0.03)
CREATE = ContactModel(name="create", mount_x_m=0.17, hazard="bump_front_center")
MODEL = robot("sally").model_copy(
    update={"bumpers": (FRONT, CREATE), "cliff_sensors": (SWITCH, DOWN)}
)
TOPICS = contact_topics(MODEL, Topics().of_contacts(MODEL))


def measured(reach, low=0.01, high=1.0):
    return SimpleNamespace(range=reach, min_range=low, max_range=high)


@pytest.mark.parametrize(
    ("message", "means"),
    [
        (measured(0.05), False), (measured(0.08), False), (measured(0.081), True),
        (measured(math.inf), True), (measured(2.0), True), (measured(-math.inf), False),
        (measured(0.005), False), (measured(math.nan), None), (measured(0.0), None),
        (measured(math.inf, 0.1, 0.1), True), (measured(-math.inf, 0.1, 0.1), False),
        (measured(0.07, 0.01, 0.07), True), (measured(0.069, 0.01, 0.07), False),
    ],
)  # fmt: skip
def test_a_cliff_sensor_reports_when_the_floor_is_too_far(message, means):
    assert is_on(DOWN, message) is means


def test_each_has_a_topic_and_a_type():
    assert [(one.topic, one.kind) for one in TOPICS] == [
        ("/bumper_front", BOOL), ("/hazard_detection", HAZARDS), ("/cliff_left", BOOL),
        ("/cliff_right", RANGE),
    ]  # fmt: skip
    named = topics_of(["contact_front=/base/bump", "namespace=/r2"])
    assert named.of_contacts(MODEL)[:2] == ("/base/bump", "/r2/hazard_detection")
    with pytest.raises(CohelmError, match="no bumper or cliff sensor 'back': describe it"):
        Topics.named(contacts=["back=/b"]).of_contacts(MODEL)
    with pytest.raises(CohelmError, match="bumper or cliff sensor as NAME=TOPIC"):
        Topics.named(contacts=["front"])


@pytest.mark.parametrize("on", [set(), {"front"}, {"create"}, {"left"}, {"right"}])
def test_messages_of_ros_drivers_are_decoded_from_their_bytes(on):
    told = dict(contact_messages(TOPICS, on, header(0, "base_link")))
    found = set()
    for one in TOPICS:
        message, damage = unpacked(packed(told[one.topic], one.kind), one.kind)
        assert damage == ""
        if is_on(one.model, message):
            found.add(one.model.name)
    assert found == on


def test_irobots_type_is_known_by_its_own_hash():
    assert type_hash(HAZARDS).startswith("RIHS01_")
    assert kind_of_contact(CREATE) == HAZARDS


class Line:
    """A transport on which a test says what it likes."""

    def __init__(self):
        self.heard = {}

    def subscribe(self, topic, kind, qos, heard):
        self.heard[topic] = heard
        return lambda: None

    def say(self, topic, message):
        self.heard[topic](Received(message, time.monotonic()))


def test_a_bumper_that_was_pressed_for_a_moment_between_two_readings_was_pressed():
    line = Line()
    contacts = Contacts(line, TOPICS, lambda: 7.0)
    assert contacts.read() == ()
    for pressed in (True, False):
        line.say("/bumper_front", SimpleNamespace(data=pressed))
    assert contacts.read() == ((7.0, "front", True),)
    assert contacts.read() == ((7.0, "front", False),)
    line.say("/cliff_right", measured(math.nan))
    assert len(contacts.read()) == 1
    line.heard["/cliff_left"](Received(None, 0.0, "7 bytes are no std_msgs/msg/Bool"))
    assert len(contacts.read()) == 1


def test_a_hazard_that_no_create_3_sends_is_doubted():
    assert [doubt(one) for one in MODEL.contacts] == ["", "", "", ""]
    wrong = ContactModel(name="front", mount_x_m=0.17, hazard="bump_frnt_center")
    assert "front bumper: hazard 'bump_frnt_center' is no frame of a Create 3" in doubt(wrong)
    model = robot("sally").model_copy(update={"bumpers": (wrong,)})
    heard = Pretended(
        [*ENDS, out("/hazard_detection", HAZARDS, BEST_EFFORT)],
        [
            (("/tf_static", TF), mounts(model)), *readings(),
            (("/hazard_detection", HAZARDS), contact_messages(
                contact_topics(model, ("/hazard_detection",)), set(), header(0, "base_link")
            )[0][1]),
        ],
    )  # fmt: skip
    assert doubt(wrong) in look(heard, model, Topics(), Allowed(), 0.06).notes


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(looking, "_LEAST", 0.0)


def test_all_are_found_and_read_and_one_that_is_silent_is_named():
    ends = [*ENDS, *(out(one.topic, one.kind, BEST_EFFORT) for one in TOPICS)]
    kinds = {one.topic: one.kind for one in TOPICS}
    told = contact_messages(TOPICS, {"create"}, header(time.time_ns(), "base_link"))
    says = [((topic, kinds[topic]), message) for topic, message in told]
    frames = [(("/tf_static", TF), mounts(MODEL))]

    def found(messages):
        heard = Pretended(ends, [*frames, *readings(), *messages])
        return look(heard, MODEL, Topics(), Allowed(), 0.06)

    seen = found(says)
    assert f"front bumper: /bumper_front, {BOOL}" in seen.notes
    robot = Ros2Robot(seen.model, seen, Spoken(ends, readings() + says))
    assert {one.sensor: one.on for one in robot.read().contacts} == {
        "front": False, "create": True, "left": False, "right": False,
    }  # fmt: skip
    robot.close()
    with pytest.raises(CohelmError, match=r"/cliff_left is published.*but nothing comes"):
        found([one for one in says if one[0][0] != "/cliff_left"])
    ends.remove(out("/cliff_right", RANGE, BEST_EFFORT))
    with pytest.raises(
        CohelmError, match=r"no node publishes /cliff_right.*with --contact right=TOPIC"
    ):
        found(says[:-1])
