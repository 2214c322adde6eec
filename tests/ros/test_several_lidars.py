"""A robot with a LiDAR in front and one behind, each on a topic of its own."""

from __future__ import annotations

import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds has no wheel for this machine")

from tests.ros.stage import stage, until

pytestmark = [pytest.mark.xdist_group("realtime"), pytest.mark.slow]


def test_a_rear_lidar_is_used_too_and_without_it_the_base_stands():
    with stage(robot="sally-rear") as made:
        assert [lidar.name for lidar in made.found.model.lidars] == ["front", "rear"]
        assert made.turned_round()
        assert made.drives()
        made.base.fault("no rear scan")
        assert made.stands()
        assert until(lambda: any("rear LiDAR" in said for said in list(made.filter.said)), 3.0)
