"""What a bumper has met stands there for the filter, and is driven around for a while."""

import numpy as np
import pytest

from cohelm.core.types import Pose, Twist
from cohelm.perceive.pipeline import Perception
from cohelm.perceive.source.contact_memory import KEPT, ContactMemory
from cohelm.robot.contacts import ContactModel
from cohelm.robot.port import Contact, Odometry, Readings, Scan
from cohelm.scenario.load import robot

FRONT = ContactModel(name="front", mount_x_m=0.36, width_m=0.4)
HERE = Pose(1.0, 0.0, 0.0)


def on(t, pressed=True):
    return (Contact(t, "front", pressed), Contact(t, "unknown", True))


def test_an_obstacle_is_placed_across_the_pressed_bumper():
    memory = ContactMemory([FRONT])
    memory.take(0.0, on(0.0, False), HERE)
    assert not len(memory.points)
    memory.take(0.1, on(0.1), HERE)
    assert memory.points[:, 0] == pytest.approx(1.36)
    assert memory.points[:, 1] == pytest.approx(np.linspace(0.2, -0.2, 9))
    memory.take(0.2, on(0.2), Pose(1.01, 0.0, 0.0))  # the same place
    assert len(memory.points) == 9
    memory.take(0.3, on(0.3), Pose(1.05, 0.0, 0.0))
    assert len(memory.points) == 18


def test_the_bumper_obstacle_expires_after_its_release():
    memory = ContactMemory([FRONT])
    memory.take(0.0, on(0.0), HERE)
    memory.take(20.0, on(20.0), HERE)
    memory.take(20.0 + KEPT, on(0.0, False), HERE)
    assert len(memory.points)
    memory.take(20.1 + KEPT, on(0.0, False), HERE)
    assert not len(memory.points)


def test_a_bumper_without_a_width_is_one_point():
    memory = ContactMemory([ContactModel(name="front", mount_x_m=0.3, mount_y_m=0.1)])
    memory.take(0.0, on(0.0), HERE)
    assert memory.points.tolist() == [[1.3, 0.1]]


def test_perception_passes_the_bumper_obstacle_to_the_filter():
    model = robot("sally").model_copy(update={"bumpers": (FRONT,)})
    eyes, still = Perception(model), Twist(0.0, 0.0)

    def seen(t, pressed):
        scan = Scan(t, round(50 * t), np.full(model.lidar.beams, np.inf), 0.0)
        reported = Readings(Odometry(t, HERE, still), scan, contacts=on(t, pressed))
        return eyes.take(t, reported)

    before = len(seen(0.0, False).obstacles.points)
    assert len(seen(0.02, True).obstacles.points) == before + 9
    assert len(seen(0.04, False).obstacles.points) == before + 9
    assert seen(0.06, False).obstacles.points[:9, 0] == pytest.approx(1.36)
