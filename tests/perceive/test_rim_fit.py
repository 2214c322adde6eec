"""Of whom only a part is in view, place and velocity are told as of whom all is."""

import math

import numpy as np
import pytest

from cohelm.core.frames import compose, inverse, placed, turned
from cohelm.core.types import Pose, Twist, disc, discs
from cohelm.perceive.pipeline import Perception
from cohelm.perceive.track.rim_fit import rim_distance, rim_fit
from cohelm.scenario import load
from tests.perceive.drives import LIDAR, drive

SALLY = load.robot("sally").model_copy(update={"lidar": LIDAR})
HERE = Pose(0.0, 0.0, 0.0)
HALL = np.array([[-9, -6, 9, -6], [9, -6, 9, 6], [9, 6, -9, 6], [-9, 6, -9, -6]], dtype=float)
LOOKS = 12  # scans are gone on with after the last look


def arc(x, y, radius, first, last, n=20):
    a = np.radians(np.linspace(first, last, n))
    return np.column_stack((x + radius * np.cos(a), y + radius * np.sin(a)))


@pytest.mark.parametrize("span", [40.0, 90.0, 180.0])
def test_a_part_of_a_rim_tells_the_whole_disc(span):
    points = arc(2.0, 1.0, 0.4, 180.0, 180.0 + span)
    fit = rim_fit(points, 2.1, 0.9, 0.4, 0.04, 1e-6, 0.0025)
    assert fit.good
    assert math.hypot(fit.x - 2.0, fit.y - 1.0) < (0.03 if span < 90.0 else 0.01)
    free = rim_fit(points, 2.05, 0.95, 0.35, 1.0, 1.0, 1e-6)
    assert (free.x, free.y, free.radius) == pytest.approx((2.0, 1.0, 0.4), abs=1e-3)


def test_what_lies_on_no_rim_is_none():
    wall = np.column_stack((np.full(40, 2.0), np.linspace(-0.5, 0.5, 40)))
    assert not rim_fit(wall, 2.3, 0.0, 0.3, 0.04, 0.0025, 0.0025).good
    assert rim_distance(arc(0.0, 0.0, 0.5, 0.0, 90.0), 0.0, 0.0, 0.4) == pytest.approx(0.1)


def test_a_sliver_says_little_along_the_rim():
    fit = rim_fit(arc(2.0, 0.0, 0.4, 178.0, 182.0, 5), 2.0, 0.0, 0.4, 0.04, 0.0025, 0.0025)
    wide = rim_fit(arc(2.0, 0.0, 0.4, 90.0, 270.0, 5), 2.0, 0.0, 0.4, 0.04, 0.0025, 0.0025)
    assert wide.variance < 0.1 * fit.variance
    assert fit.variance == pytest.approx(0.04, rel=0.1)


def errors(where, velocity, radius, last, standing=None):
    """Of the velocity at the `last` look [m/s], and of the place 0.6 s later [m]."""

    def around(t):
        x, y = where(t)
        return (
            discs(disc(x, y, radius)) if standing is None else discs(standing, disc(x, y, radius))
        )

    eyes, found = Perception(SALLY), []
    n = round((last + 0.8) / 0.02)
    for moment in drive([HERE] * (n + 1), [Twist(0.0, 0.0)] * n, 1, around, HALL):
        seen = eyes.take(moment.now, moment.readings)
        for after in (0.0, 0.6):
            if abs(moment.now - last - 0.06 - after) < 0.005:
                frame = compose(moment.truth, inverse(seen.odometry))
                place, going = (
                    placed(seen.movers[:, :2], frame),
                    turned(seen.movers[:, 2:4], frame.psi),
                )
                off = np.hypot(*(place - where(moment.now)).T)
                i = int(np.argmin(off))
                found += [float(off[i]), math.dist(going[i], velocity)]
    return found[1], found[2]


@pytest.mark.parametrize(
    ("radius", "speed", "aside"),
    [
        (0.25, 1.2, 0.8), (0.5, 1.8, 1.2),
        *(pytest.param(r, v, y, marks=pytest.mark.slow)
          for r in (0.25, 0.4, 0.5) for v in (1.2, 1.8) for y in (0.8, 1.2, 1.8)),
    ],
)  # fmt: skip
def test_a_mover_that_leaves_the_view_is_predicted_on_its_course(radius, speed, aside):
    """Backwards past a robot that stands; the view ends 45 degrees behind its LiDAR's left."""
    edge = LIDAR.mount_x_m - aside - math.sqrt(2.0) * radius  # where his last point leaves
    last = math.floor(10.0 * (2.2 - edge) / speed) / 10.0

    def where(t):
        return 2.2 - speed * t, aside

    v, later = errors(where, (-speed, 0.0), radius, last)
    assert v < 0.25
    assert later < 0.25


@pytest.mark.parametrize(
    ("radius", "speed"),
    [
        (0.4, 1.2), (0.5, 1.8),
        *(pytest.param(r, v, marks=pytest.mark.slow)
          for r, v in ((0.25, 1.2), (0.25, 1.8), (0.5, 1.2))),
    ],
)  # fmt: skip
def test_a_mover_behind_a_post_is_predicted_on_its_course(radius, speed):
    post = disc(2.1, 0.0, 0.45)  # 14.5 degrees to either side of the LiDAR
    hidden = 3.0 * math.tan(math.asin(0.45 / 1.8)) - radius / math.cos(math.asin(0.45 / 1.8))
    last = math.floor(10.0 * (2.2 - hidden) / speed) / 10.0

    def where(t):
        return 3.3, -2.2 + speed * t

    v, later = errors(where, (0.0, speed), radius, last, post)
    assert v < 0.25
    assert later < 0.25


@pytest.mark.parametrize(
    ("radius", "speed", "edge"),
    [
        (0.5, 1.4, 128.0), (0.4, -0.8, 135.0),
        *(pytest.param(r, v, e, marks=pytest.mark.slow)
          for r in (0.25, 0.4, 0.5) for v in (0.8, -0.8, 1.4) for e in (128.0, -128.0, 135.0)),
    ],
)  # fmt: skip
def test_a_mover_that_the_edge_of_the_view_cuts_is_known_whole(radius, speed, edge):
    """It comes or goes along that edge, and was never all in view."""
    away, bearing = 3.6 if speed > 0.0 else 1.6, math.radians(edge)

    def where(t):
        far = away - speed * t
        return LIDAR.mount_x_m + far * math.cos(bearing), far * math.sin(bearing)

    velocity = -speed * math.cos(bearing), -speed * math.sin(bearing)
    v, later = errors(where, velocity, radius, 1.5)
    assert v < 0.1
    assert later < 0.1
