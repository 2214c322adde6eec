"""The filter through a `foxglove_bridge`: it drives, and stands for what it must."""

from __future__ import annotations

import json
import re
import struct
import threading

import pytest

pytest.importorskip("cyclonedds", reason="what the bridge bridges has no wheel here")

from websockets.sync.server import ServerConnection, serve
from websockets.typing import Subprotocol

from cohelm.core.errors import CohelmError
from cohelm.core.types import Twist
from cohelm.ros import connection as which
from cohelm.ros.connection import DDS, FOXGLOVE, Connection, connection
from cohelm.ros.foxglove import FoxgloveTransport
from cohelm.ros.look import look
from cohelm.ros.messages import command
from cohelm.ros.mismatch import TWIST
from cohelm.ros.port import SENSOR, Received
from cohelm.ros.topics import Topics
from cohelm.ros.types import packed
from cohelm.scenario.load import robot as load_robot
from tests.ros.bridge import Bridge
from tests.ros.stage import alone, stage, until

pytestmark = pytest.mark.xdist_group("bridge")  # which a worker starts once


def test_auto_takes_the_bridge_where_its_address_is_given_or_nothing_else_is_there(monkeypatch):
    monkeypatch.delenv("RMW_IMPLEMENTATION", raising=False)
    assert connection().kind == DDS
    assert connection(url="ws://robot:8765")[:2] == (FOXGLOVE, "ws://robot:8765")
    monkeypatch.setattr(which, "find_spec", lambda name: None)
    assert connection()[:2] == (FOXGLOVE, "ws://localhost:8765")
    with pytest.raises(CohelmError, match="--url is of a foxglove_bridge"):
        connection(DDS, "ws://robot:8765")
    with pytest.raises(CohelmError, match="there are auto, dds, foxglove and zenoh"):
        connection("carrier pigeon")


def test_a_missing_or_limited_bridge_is_reported_with_the_cure():
    with pytest.raises(CohelmError, match="no foxglove_bridge answers at ws:"):
        FoxgloveTransport("ws://127.0.0.1:9")
    for none in ("robot:8765", "ws://[::1", "wss://robot:99999"):
        with pytest.raises(CohelmError, match="give the bridge's address"):
            FoxgloveTransport(none)

    def poor(there: ServerConnection) -> None:
        there.send(json.dumps({
            "op": "serverInfo", "name": "poor", "supportedEncodings": ["cdr"],
            "capabilities": ["clientPublish"],
        }))  # fmt: skip
        for _ in there:
            pass

    with serve(poor, "127.0.0.1", 0, subprotocols=[Subprotocol("foxglove.sdk.v1")]) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        port = server.socket.getsockname()[1]
        with pytest.raises(CohelmError, match="offers no connectionGraph: add that to its"):
            FoxgloveTransport(f"ws://127.0.0.1:{port}")


@pytest.mark.slow  # an advice; that without any bridge is above
def test_without_nodes_behind_the_bridge_the_advice_is_about_the_bridge():
    lonely = Bridge(domain=99)
    transport = FoxgloveTransport(lonely.url)
    try:
        with pytest.raises(CohelmError) as error:
            look(transport, load_robot("sally"), Topics(), wait=0.1)
        said = str(error.value)
        assert said.startswith("no node of ROS is seen (foxglove_bridge")
        assert "the bridge sees none either: is the ROS_DOMAIN_ID it was started" in said
    finally:
        transport.close()
        lonely.close()


def told(made, words: str) -> None:
    assert until(lambda: any(re.search(words, said) for said in list(made.filter.said)), 3.0), (
        made.filter.said
    )


@pytest.mark.parametrize("plant", ["kinematic", pytest.param("twin", marks=pytest.mark.slow)])
def test_it_drives_and_stands_when_the_bridge_is_lost(plant):
    alone()
    bridge = Bridge()
    with stage(way=Connection(FOXGLOVE, bridge.url), plant=plant) as made:
        assert made.drives(0.4), made.filter.said
        bridge.close()
        made.robot_gone = True
        assert made.stands(3.0)
        told(made, "foxglove_bridge at ws://127.0.0.1:.* is gone")
        assert made.base.truth().least_moving > 0.01


@pytest.mark.slow
def test_it_drives_with_half_of_the_messages_and_stands_when_they_are_wrong():
    alone()
    bridge = Bridge()
    with stage(way=Connection(FOXGLOVE, bridge.url)) as made:
        assert made.drives(0.4), made.filter.said
        made.base.fault("half")
        assert until(lambda: len(made.filter.rows) > 50)
        made.base.fault("tomorrow")
        assert made.stands(3.0)
        told(made, "from the future: a clock jumped")
        made.base.fault("")

        def again() -> bool:
            if made.filter.latched:
                made.reset()
            return abs(made.base.truth().twist.v) > 0.05

        assert until(again, 15.0) or made.base.truth().pose.x > 3.0
        assert made.base.truth().least_moving > 0.01
    bridge.close()


def test_a_subscription_that_was_too_early_for_the_bridge_is_repeated():
    """It tells of a new channel a moment before it takes subscriptions of it (foxglove-sdk)."""
    asked: list[int] = []

    def bridge(there: ServerConnection) -> None:
        there.send(json.dumps({
            "op": "serverInfo", "name": "early", "supportedEncodings": ["cdr"],
            "capabilities": ["clientPublish", "connectionGraph"],
        }))  # fmt: skip
        channel = {"id": 5, "topic": "/twist", "encoding": "cdr", "schemaName": TWIST}
        there.send(json.dumps({"op": "advertise", "channels": [channel]}))
        for said in map(json.loads, there):
            if said["op"] != "subscribe":
                continue
            asked.append(said["subscriptions"][0]["id"])
            if len(asked) < 3:
                there.send(json.dumps({"op": "status", "level": 2, "message": "Unknown channel"}))
            else:
                sent = packed(command(Twist(1.0, 0.0), TWIST, ""), TWIST)
                there.send(struct.pack("<BIQ", 1, asked[-1], 0) + sent)

    with serve(bridge, "127.0.0.1", 0, subprotocols=[Subprotocol("foxglove.sdk.v1")]) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        transport = FoxgloveTransport(f"ws://127.0.0.1:{server.socket.getsockname()[1]}")
        heard: list[Received] = []
        transport.subscribe("/twist", TWIST, SENSOR, heard.append)
        assert until(lambda: bool(heard))
        assert heard[0].message.linear.x == 1.0
        assert len(asked) == 3
        transport.close()
