"""Masks of Nav2's costmap filters: over every transport on which what lasts lasts, and each bad one
in a sentence."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest

from cohelm.core.errors import CohelmError
from cohelm.core.types import Pose
from cohelm.ros.masks import KEEP_OUT, PERCENT, SPEED, FilterMask, Masks
from cohelm.ros.mismatch import FILTER_INFO, GRID, TWIST
from cohelm.ros.port import COMMAND, LATCHED
from tests.ros.costmap_filters import CELLS, grid, info
from tests.ros.stage import until
from tests.ros.transports import TRANSPORTS

pytestmark = pytest.mark.xdist_group("bridge")  # which a worker starts once
NAN = math.nan
LASTING = {name: one for name, one in TRANSPORTS.items() if name != "from_foxglove"}
"""What a bridge's client publishes is volatile."""


class Filter:
    """Somebody's costmap_filter_info_server and map_server."""

    def __init__(self, transport, space, name="costmap_filter_info", mask="filter_mask"):
        self.info = transport.publish(f"{space}/{name}", FILTER_INFO, LATCHED)
        self.grid = transport.publish(f"{space}/{mask}", GRID, LATCHED)


@pytest.fixture(scope="module", params=LASTING.items(), ids=LASTING)
def pair(request):
    """Of the transport its name, who has the masks, and who hears them."""
    name, kind = request.param
    made = kind.one("map_server", "/"), kind.two("cohelm_robot", "/")
    yield name, *made
    for transport in made:
        transport.close()


def test_masks_and_filter_infos_are_received_by_late_subscribers(pair):
    name, theirs, ours = pair
    space = f"/masks_{name}"
    kept_out, slow = Filter(theirs, space), Filter(theirs, space, "speed_info", "speed_mask")
    kept_out.grid.send(grid())
    slow.grid.send(grid(np.array([[0, 50]], np.int8), 0.5, (0.0, 0.0, 0.0)))
    kept_out.info.send(info())
    slow.info.send(info(f"{space}/speed_mask", PERCENT, 100.0, -1.0))
    heard: list[bool] = []
    topics = "costmap_filter_info", f"{space}/speed_info"
    masks = Masks(ours, topics, "map", space, lambda: heard.append(True))
    one, other = masks.read(20.0)
    assert one[:5] == (
        f"{space}/costmap_filter_info", f"{space}/filter_mask", KEEP_OUT, 0.0, 1.0
    )  # fmt: skip
    assert one.cells.tolist() == CELLS.tolist()
    assert one.resolution == pytest.approx(0.1)
    assert one.origin == pytest.approx(Pose(1.0, -2.0, 0.5))
    assert other[1:5] == (f"{space}/speed_mask", PERCENT, 100.0, -1.0)
    assert other.cells.tolist() == [[0, 50]]
    same = masks.changed((one, other))
    assert same[0] is one
    assert same[1] is other
    heard.clear()
    slow.grid.send(grid(np.array([[0, 60]], np.int8), 0.5, (0.0, 0.0, 0.0)))
    assert until(lambda: masks.changed((one, other))[1] is not other)
    assert heard
    same, newer = masks.changed((one, other))
    assert same is one
    assert newer.cells.tolist() == [[0, 60]]
    assert newer[:5] == other[:5]
    slow.info.send(info("elsewhere", PERCENT, 100.0, -1.0))
    waited = f"{space}/speed_info names {space}/elsewhere now, and nothing came there yet"
    assert until(lambda: said(masks, one, other) == waited)
    slow.info.send(info(f"{space}/speed_mask", KEEP_OUT))
    assert until(lambda: "now of one of type 0: start the drive again" in said(masks, one, other))
    slow.info.send(info(f"{space}/speed_mask", SPEED, 0.0, 0.01))
    assert until(lambda: not said(masks, one, other))
    assert masks.changed((one, newer))[1][2:5] == (SPEED, 0.0, pytest.approx(0.01))
    masks.close()


def said(masks, *used) -> str:
    """What is wrong with what comes instead."""
    try:
        masks.changed(used)
    except CohelmError as error:
        return str(error)
    return ""


BAD_INFOS = [
    (info(kind=3), "is a filter of type 3, and masks are of type 0 (keep out), 1 (speed in"),
    (info(base=NAN), ": base nan and multiplier 1 make no speeds: fix the parameters of costmap_"),
    (info(multiplier=1e30), ": base 0 and multiplier 1e+30 make no speeds: fix the parameters of"),
    (info(""), "names no topic of a mask, but '': fix mask_topic of costmap_filter_info_server"),
    (info("no name!"), "names no topic of a mask, but 'no name!': fix mask_topic of costmap_"),
]
BAD_GRIDS = [
    (grid(frame="odom"), "it is in the frame 'odom', and the map's is 'map': set frame_id of its"),
    (grid(width=7), "7 x 2 cells are declared, and 6 come: fix what publishes it"),
    (
        grid(np.empty((0, 3), np.int8)),
        "3 x 0 cells are declared, and 0 come: fix what publishes it",
    ),
    (grid(resolution=0.0), "its cells are 0 m wide: fix its resolution"),
    (grid(resolution=1e-30), "its cells are 1e-30 m wide: fix its resolution"),
    (grid(resolution=NAN), "its cells are nan m wide: fix its resolution"),
    (grid(origin=(NAN, 0.0, 0.0)), "its origin is no pose: fix the origin in its map_server's"),
    (grid(inclined=0.3), "it is inclined, and a map lies flat: fix the orientation of its origin"),
]


@pytest.fixture(scope="module")
def two():
    """Over DDS, where quality of service counts too."""
    made = TRANSPORTS["dds"].one("map_server", "/"), TRANSPORTS["dds"].two("cohelm_robot", "/")
    yield made
    for transport in made:
        transport.close()


def refused(transport, space, *topics, wait=0.0):
    masks = Masks(transport, topics or ("costmap_filter_info",), "map", space)
    with pytest.raises(CohelmError) as caught:
        masks.read(wait)
    masks.close()
    return str(caught.value)


@pytest.mark.parametrize("n", range(len(BAD_INFOS)))
def test_an_info_that_can_not_be_used_is_one_sentence(two, n):
    theirs, ours = two
    message, why = BAD_INFOS[n]
    other = Filter(theirs, f"/bad_info_{n}")
    other.info.send(message)
    begun = time.monotonic()
    said = refused(ours, f"/bad_info_{n}", wait=30.0)
    assert time.monotonic() - begun < 20.0  # the mask, which changes nothing, is not waited for
    assert said.removeprefix(f"/bad_info_{n}/costmap_filter_info").lstrip().startswith(why), said


@pytest.mark.parametrize("n", range(len(BAD_GRIDS)))
def test_a_grid_that_can_not_be_used_is_one_sentence(two, n):
    theirs, ours = two
    message, why = BAD_GRIDS[n]
    other = Filter(theirs, f"/bad_grid_{n}")
    other.grid.send(message)
    other.info.send(info())
    assert refused(ours, f"/bad_grid_{n}", wait=5.0).startswith(f"/bad_grid_{n}/filter_mask: {why}")


def test_missing_or_silent_topics_are_reported_with_the_cure(two):
    theirs, ours = two
    assert refused(ours, "/none").startswith(
        "no node publishes /none/costmap_filter_info: start costmap_filter_info_server, or name "
    )
    other = theirs.publish("/bare/costmap_filter_info", FILTER_INFO, LATCHED)
    assert until(lambda: any(one.topic.startswith("/bare") for one in ours.endpoints()))
    assert "is its node not active yet (ros2 lifecycle get)" in refused(ours, "/bare")
    other.send(info("walls"))
    assert refused(ours, "/bare", wait=1.0).startswith(
        "no node publishes /bare/walls: /bare/costmap_filter_info says that the mask is there: "
        "start"
    )
    wrong = theirs.publish("/bare/walls", TWIST, COMMAND)
    assert until(lambda: any(one.topic == "/bare/walls" for one in ours.endpoints()))
    assert refused(ours, "/bare", wait=1.0).startswith(
        "/bare/walls is geometry_msgs/msg/Twist by /map_server, and nav_msgs/msg/OccupancyGrid is"
    )
    volatile = theirs.publish("/short/costmap_filter_info", FILTER_INFO, COMMAND)
    assert until(lambda: any(one.topic.startswith("/short") for one in ours.endpoints()))
    assert refused(ours, "/short").startswith(
        "/short/costmap_filter_info never reaches this node: the publisher is volatile and the"
    )
    with pytest.raises(CohelmError, match="is no name of a topic"):
        Masks(ours, ("no name!",), "map")
    assert wrong
    assert volatile


def test_two_of_one_kind_are_refused(two):
    theirs, ours = two
    for name, kind in (("a", PERCENT), ("b", SPEED)):
        other = Filter(theirs, "/twice", name, f"mask_{name}")
        other.grid.send(grid())
        other.info.send(info(f"mask_{name}", kind))
    said = refused(ours, "/twice", "a", "b", wait=5.0)
    assert said == "/twice/a and /twice/b both define speed zones: name one with --masks-from"


def test_a_mask_has_a_name_for_a_person():
    one = FilterMask("/info", "/mask", 0, 0.0, 1.0, CELLS, 0.1, Pose(0.0, 0.0, 0.0))
    assert one.name == "/mask (named by /info)"
