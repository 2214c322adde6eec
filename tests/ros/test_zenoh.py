"""Robots whose middleware is rmw_zenoh: found, heard and driven by its keys and tokens."""

from __future__ import annotations

import json
import struct
import sys

import pytest
from hypothesis import given, settings, strategies as st

pytest.importorskip("zenoh", reason="eclipse-zenoh is not installed")

import zenoh

from cohelm.core.errors import CohelmError
from cohelm.core.types import Twist
from cohelm.ros import connection as which, tokens, zenoh as ours
from cohelm.ros.connection import ZENOH, Connection, connection
from cohelm.ros.messages import command
from cohelm.ros.mismatch import SCAN, TWIST
from cohelm.ros.port import COMMAND, LATCHED, SENSOR, Endpoint, Qos
from cohelm.ros.types import packed
from cohelm.ros.zenoh import ZenohTransport
from tests.few import first
from tests.ros.stage import DOMAIN, alone, stage, until
from tests.ros.transports import Router, router

pytestmark = pytest.mark.xdist_group("realtime")
STRING = "std_msgs/msg/String"
HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
LISTENER = (
    "@ros2_lv/2/aac3178e146ba6f1fc6e6a4085e77f21/0/10/MS/%/%/listener/%chatter/"
    f"std_msgs::msg::dds_::String_/{HASH}/::,10:,:,:,,"
)
"""In rmw_zenoh's own description (docs/design.md)."""


def test_keys_and_tokens_are_those_of_rmw_zenohs_description():
    owner = tokens.Owner(2, "aac3178e146ba6f1fc6e6a4085e77f21", "listener")
    assert owner.of(10, False, "/chatter", STRING, Qos(depth=10)) == LISTENER
    assert owner.token() == "@ros2_lv/2/aac3178e146ba6f1fc6e6a4085e77f21/0/0/NN/%/%/listener"
    assert tokens.data_key(0, "/robot1/chatter", STRING) == (
        f"0/robot1/chatter/std_msgs::msg::dds_::String_/{HASH}"
    )
    spaced = owner._replace(namespace="/j100/front").of(1, True, "/j100/scan", SCAN, SENSOR)
    assert "/MP/%/%j100%front/listener/%j100%scan/sensor_msgs::msg::dds_::LaserScan_/" in spaced
    assert spaced.endswith("/2::,5:,:,:,,")
    assert owner.of(1, True, "/map", STRING, LATCHED).endswith("/:1:,1:,:,:,,")


def test_tokens_of_others_are_read_and_another_definition_is_named():
    session, listener = tokens.read(LISTENER) or ("", None)
    assert session == "aac3178e146ba6f1fc6e6a4085e77f21"
    assert listener == Endpoint("/chatter", STRING, Qos(True, False, 10), False, "/listener")
    own = tokens.Owner(0, "abc", "laser", "/j100").of(3, True, "/j100/scan", SCAN, SENSOR)
    assert tokens.read(own) == (
        "abc", Endpoint("/j100/scan", SCAN, Qos(False, False, 5), True, "/j100/laser"),
    )  # fmt: skip
    _, humble = tokens.read(LISTENER.replace(HASH, "TypeHashNotSupported")) or ("", None)
    assert humble is not None
    assert humble.type == f"{STRING} of another definition (is ROS_DISTRO here the robot's?)"
    _, mine = tokens.read(LISTENER.replace("std_msgs", "my_msgs")) or ("", None)
    assert mine is not None
    assert mine.type == "my_msgs/msg/String"
    assert tokens.read(LISTENER + "/backends:cpu") is not None  # newer ones have more at the end
    assert tokens.read("@ros2_lv/2/aac/0/0/NN/%/%/listener") is None


def test_humble_has_no_hashes(monkeypatch):
    monkeypatch.setenv("ROS_DISTRO", "humble")
    assert tokens.data_key(0, "/c", STRING) == "0/c/std_msgs::msg::dds_::String_/" + tokens.NO_HASH
    _, humble = tokens.read(LISTENER.replace(HASH, "TypeHashNotSupported")) or ("", None)
    assert humble is not None
    assert humble.type == STRING


@settings(max_examples=50, deadline=None)
@given(st.lists(st.text(max_size=6), max_size=16), st.integers(0, len(LISTENER)))
def test_whatever_token_comes_it_is_read_or_none(parts, cut):
    tokens.read("@ros2_lv/" + "/".join(parts))
    tokens.read(LISTENER[:cut] + "/".join(parts))


def test_what_goes_with_a_message_is_its_number_time_and_sender():
    sender = tokens.identity(LISTENER)
    assert len(sender) == 16
    made = tokens.attachment(7, 1_234_567_890_123_456_789, sender)
    assert made == struct.pack("<qq", 7, 1_234_567_890_123_456_789) + b"\x10" + sender
    serialized = zenoh.ext.z_serialize(
        (zenoh.ext.Int64(7), zenoh.ext.Int64(1_234_567_890_123_456_789), sender)
    )
    assert made == serialized.to_bytes()


def stranger(url: str):
    """A session that knows nothing of cohelm."""
    config = {"mode": "client", "connect": {"endpoints": [url]}}
    return zenoh.open(zenoh.Config.from_json5(json.dumps(config)))


def test_what_goes_over_the_network_is_what_rmw_zenoh_sends():
    alone()
    session, came, live = stranger(router().url), [], []
    session.declare_subscriber(f"{DOMAIN}/wire/**", came.append)
    session.liveliness().declare_subscriber("@ros2_lv/**", live.append, history=True)
    transport = ZenohTransport("filter", "/j100", router().url)
    out = transport.publish("/wire", TWIST, COMMAND)
    said = command(Twist(0.5, 0.25), TWIST, "")
    assert until(lambda: out.send(said) or len(came) > 1)
    assert str(came[0].key_expr) == tokens.data_key(DOMAIN, "/wire", TWIST)
    assert came[0].payload.to_bytes() == packed(said, TWIST)
    numbers = [struct.unpack_from("<q", one.attachment.to_bytes())[0] for one in came[:2]]
    assert numbers[1] == numbers[0] + 1
    assert any(
        str(one.key_expr).endswith("NN/%/%j100/filter") and one.kind == zenoh.SampleKind.PUT
        for one in live
    )
    transport.close()
    assert until(lambda: sum(one.kind == zenoh.SampleKind.DELETE for one in live) >= 2)
    session.close()


def test_auto_takes_zenoh_where_it_is_the_middleware_and_is_installed(monkeypatch):
    monkeypatch.setenv("RMW_IMPLEMENTATION", "rmw_zenoh_cpp")
    assert connection() == (ZENOH, "", "RMW_IMPLEMENTATION is rmw_zenoh_cpp")
    assert connection(url="tcp/robot:7447")[:2] == (ZENOH, "tcp/robot:7447")
    monkeypatch.setattr(which, "find_spec", lambda name: None)
    why = connection().why
    assert "RMW_IMPLEMENTATION is rmw_zenoh_cpp, which is no DDS" in why
    assert "eclipse-zenoh is not installed (pip install 'eclipse-zenoh>=" in why


def test_missing_messages_are_reported_with_the_cure(monkeypatch):
    monkeypatch.setattr(ours, "_OPEN", 0.1)
    with pytest.raises(CohelmError, match=r"no zenoh router answers at tcp/127.0.0.1:9: .*zenohd"):
        ZenohTransport(url="tcp/127.0.0.1:9")
    with pytest.raises(CohelmError, match="give the router's address, such as tcp/"):
        ZenohTransport(url="ws://robot:8765")
    monkeypatch.setenv("ZENOH_CONFIG_OVERRIDE", "mode=sideways")
    with pytest.raises(CohelmError, match=r"ZENOH_CONFIG_OVERRIDE: .*fix them, or unset them"):
        ZenohTransport(url=router().url)
    monkeypatch.delenv("ZENOH_CONFIG_OVERRIDE")
    ours._zenoh.cache_clear()
    monkeypatch.setitem(sys.modules, "zenoh.ext", None)
    with pytest.raises(CohelmError, match="ROS 2 over zenoh needs what is not installed here: pip"):
        ZenohTransport()


@pytest.mark.parametrize("kind", first(["tls", "quic"]))  # of QUIC zenoh itself waits 10 s
def test_a_router_with_tls_may_be_there_and_its_certificate_not_accepted(kind, monkeypatch):
    """zenoh does not say which it was, so both cures are named."""
    monkeypatch.setattr(ours, "_OPEN", 0.1)
    with pytest.raises(CohelmError) as error:
        ZenohTransport(url=f"{kind}/127.0.0.1:9")
    assert str(error.value).startswith(f"no zenoh router answers at {kind}/127.0.0.1:9: start it")
    assert "transport/link/tls/root_ca_certificate" in str(error.value)


def test_what_zenoh_says_of_its_settings_is_told_without_its_sources(monkeypatch):
    monkeypatch.setenv("ZENOH_CONFIG_OVERRIDE", "mode=sideways")
    with pytest.raises(CohelmError) as error:
        ZenohTransport(url="tcp/127.0.0.1:9")
    assert ".rs" not in str(error.value)


def test_rmw_zenohs_own_settings_name_the_router(monkeypatch, tmp_path):
    alone()
    there = json.dumps([router().url])
    monkeypatch.setenv("ZENOH_CONFIG_OVERRIDE", f'mode="client";connect/endpoints={there}')
    transport = ZenohTransport("one")
    assert router().url in transport.name
    transport.close()
    monkeypatch.delenv("ZENOH_CONFIG_OVERRIDE")
    file = tmp_path / "session.json5"
    file.write_text(json.dumps({"mode": "peer", "connect": {"endpoints": [router().url]}}))
    monkeypatch.setenv("ZENOH_SESSION_CONFIG_URI", str(file))
    transport = ZenohTransport("one")
    assert router().url in transport.name
    transport.close()


def test_a_lost_router_is_reported_and_reconnected_when_it_is_back():
    alone()
    first = Router()
    one = ZenohTransport("one", url=first.url)
    assert not one.lost()
    first.close()
    assert until(lambda: "is gone: is rmw_zenohd still running" in one.lost())
    second = Router(first.port)
    assert until(lambda: not one.lost())
    two = ZenohTransport("two", url=second.url)
    heard = []
    two.subscribe("/again", TWIST, SENSOR, heard.append)
    out = one.publish("/again", TWIST, COMMAND)
    assert until(lambda: out.send(command(Twist(1.0, 0.0), TWIST, "")) or bool(heard))
    for each in (one, two, second):
        each.close()


def test_it_drives_over_zenoh_on_without_a_router_and_stands_without_a_robot():
    alone()
    made_for_it = Router()
    way = Connection(ZENOH, made_for_it.url)
    with stage(way=way, theirs=way) as made:
        assert made.drives(0.4), made.filter.said
        made.base.fault("half")
        count = len(made.filter.rows)
        assert until(lambda: len(made.filter.rows) > count + 25)
        made.base.fault("")
        made_for_it.close()  # those on one machine speak to each other themselves
        assert made.drives(-0.3), made.filter.said
        assert made.base.truth().least_moving > 0.01
        made.base.fault("no odometry")
        assert made.stands(3.0)
        made.base.process.kill()
        made.robot_gone = True
        assert until(lambda: made.filter.rows[-1].applied == Twist(0.0, 0.0))
