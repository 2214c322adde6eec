"""The transport for robots whose middleware is DDS: cyclonedds, with ROS 2's naming and discovery.

`ROS_DOMAIN_ID`, `ROS_AUTOMATIC_DISCOVERY_RANGE` (and the older `ROS_LOCALHOST_ONLY`) and
`CYCLONEDDS_URI` count as for ROS 2 itself.
"""

from __future__ import annotations

import atexit
import os
import threading
import time
from functools import cache, partial
from importlib import import_module
from types import SimpleNamespace
from typing import Any

from cohelm.core.errors import CohelmError
from cohelm.core.extras import missing, requirements
from cohelm.ros.graph import GRAPH, INFO, Graph, described
from cohelm.ros.names import dds_topic, namespace_of, ros_topic, ros_type
from cohelm.ros.port import LATCHED, Callback, End, Endpoint, Publisher, Qos, Received, ensure_open
from cohelm.ros.types import known, packed, type_hash, unpacked, wire

_MOST = 64
"""Samples taken from a reader at once."""
_MOST_ENDPOINTS = 10_000
_WAIT = 200_000_000
"""The listening thread looks whether it shall end this often [ns]."""
_LOCAL = (
    "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name='lo' multicast='false'/>"
    "</Interfaces><AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto"
    "</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex><Peers>"
    "<Peer address='127.0.0.1'/></Peers></Discovery></Domain></CycloneDDS>"
)
"""This machine only: ROS 2's discovery range LOCALHOST."""
_RANGES = ("SUBNET", "LOCALHOST", "SYSTEM_DEFAULT", "OFF", "NOT_SET")
"""Discovery ranges of ROS 2; but LOCALHOST all are cyclonedds' own."""
_LOCK = threading.RLock()
"""Of all transports of a process: cyclonedds converts every quality of service through the same few
variables, so that two threads that look at endpoints at once read freed memory; and of transports
that begin at once one does not."""
_domains: dict[int, Any] = {}
"""Domains that have been configured in this process; that can be done once."""


def domain_id(given: int | None = None) -> int:
    """The domain that is given, or in `ROS_DOMAIN_ID`. CohelmError for what is none."""
    text = os.environ.get("ROS_DOMAIN_ID", "0") if given is None else str(given)
    if not text.isdecimal() or not 0 <= int(text) <= 232:
        raise CohelmError(f"ROS_DOMAIN_ID must be a number from 0 to 232, got {text!r}")
    return int(text)


def local_only() -> bool:
    """Whether the environment limits discovery to this machine. CohelmError for an unknown
    range."""
    ranged = os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "").upper()
    if ranged not in ("", *_RANGES):
        raise CohelmError(
            f"ROS_AUTOMATIC_DISCOVERY_RANGE is {ranged!r}, and there are {', '.join(_RANGES)}"
        )
    return ranged == "LOCALHOST" or os.environ.get("ROS_LOCALHOST_ONLY", "0") == "1"


class DdsTransport:
    """A node on the network. See `port.Transport`."""

    unseen = (
        "is ROS_DOMAIN_ID the robot's, does its middleware speak DDS (rmw_zenoh does not), and "
        "does the network let multicast through (ROS 2's own `ros2 multicast send` and `receive` "
        "tell)?"
    )

    def __init__(self, node: str = "cohelm", namespace: str = "/", domain: int | None = None):
        """Raises CohelmError where DDS is not installed, or can not begin."""
        self.domain = domain_id(domain)
        dds = _cyclonedds()
        self.name = f"DDS, domain {self.domain}" + (", this machine only" if local_only() else "")
        try:
            with _LOCK:
                self._begin(node, namespace, dds)
        except dds.DDSException as error:
            raise CohelmError(
                f"DDS can not begin in domain {self.domain} ({error.msg}): is a network interface "
                "up, and CYCLONEDDS_URI sound, if it is set? "
                "ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST needs neither"
            ) from error

    def _begin(self, node: str, namespace: str, dds: Any) -> None:
        if local_only() and self.domain not in _domains:
            _domains[self.domain] = dds.Domain(self.domain, _LOCAL)
        enclave = dds.Qos(dds.Policy.Userdata(b"enclave=/;"))
        self._participant = dds.DomainParticipant(self.domain, enclave)
        kept = dds.Qos(dds.Policy.Reliability.Reliable(0), dds.Policy.Durability.TransientLocal)
        anything = dds.ViewState.Any | dds.InstanceState.Any | dds.SampleState.Any
        self._built: dict[bool | None, tuple[Any, Any]] = {}
        """Discovery: of publishers, of subscribers, and (None) of participants."""
        for publishes, topic in (
            (True, dds.BuiltinTopicDcpsPublication), (False, dds.BuiltinTopicDcpsSubscription),
            (None, dds.BuiltinTopicDcpsParticipant),
        ):  # fmt: skip
            reader = dds.BuiltinDataReader(self._participant, topic, kept)
            self._built[publishes] = reader, dds.ReadCondition(reader, anything)
        self._ends: dict[bytes, Endpoint] = {}
        self._readers: list[tuple[Any, str, Callback]] = []
        self._writers: list[Any] = []
        self._topics: dict[tuple[str, str], Any] = {}
        self._waiting = dds.WaitSet(self._participant)
        self._closed = threading.Event()
        self._graph = Graph(self._participant.guid.bytes, node, namespace_of(namespace))
        self._about = self._writer(GRAPH, INFO, LATCHED)
        self._others: dict[bytes, list[Any]] = {}
        self._reader(GRAPH, INFO, LATCHED._replace(depth=100), self._on_graph)
        self._thread = threading.Thread(target=self._listen, name="dds", daemon=True)
        self._thread.start()
        self._publish_graph()

    def publish(self, topic: str, kind: str, qos: Qos) -> Publisher:
        """A publisher, which others see with its type's hash."""
        with _LOCK:
            ensure_open(self._closed)
            writer = self._writer(dds_topic(topic), known(kind), qos)
            self._graph.writers.append(writer.guid.bytes)
            self._publish_graph()
        return _Writer(writer, kind, self._closed)

    def subscribe(self, topic: str, kind: str, qos: Qos, callback: Callback) -> End:
        """A subscriber, and what ends it."""
        with _LOCK:
            ensure_open(self._closed)
            reader = self._reader(dds_topic(topic), known(kind), qos, callback)
            self._graph.readers.append(reader.guid.bytes)
            self._publish_graph()
        return partial(self._leave, reader)

    def endpoints(self) -> list[Endpoint]:
        """Of other participants."""
        dds = _cyclonedds()
        with _LOCK:
            ensure_open(self._closed)
            others = [node for nodes in list(self._others.values()) for node in nodes]
            nodes = {gid: name for name, gids in others for gid in gids}  # of each endpoint
            own, gone = self._participant.guid, set[bytes]()
            for publishes, (reader, anything) in self._built.items():
                for sample in reader.take(_MOST_ENDPOINTS, anything):  # what is new since last time
                    key = sample.key.bytes
                    if sample.sample_info.instance_state != dds.InstanceState.Alive:
                        self._ends.pop(key, None)
                        gone.add(key)
                    elif publishes is None:
                        gone.discard(key)  # it is back, and may have published its nodes again
                    elif sample.sample_info.valid_data and sample.participant_key != own:
                        topic, kind = ros_topic(sample.topic_name), ros_type(sample.type_name)
                        if topic:
                            self._ends[key] = Endpoint(topic, kind, _qos(sample.qos), publishes, "")
            for key in gone:  # of each `ros2 topic echo` there was one
                self._others.pop(key, None)
            return sorted(e._replace(node=nodes.get(key, "")) for key, e in self._ends.items())

    def lost(self) -> str:
        """Nothing is between peers that could be lost."""
        return ""

    def close(self) -> None:
        """Leave the network."""
        if self._closed.is_set():
            return
        self._closed.set()
        self._thread.join(2.0)
        with _LOCK:
            self._readers.clear()
            self._writers.clear()
            self._built.clear()
            self._topics.clear()
            del self._about, self._waiting
            self._participant.__del__()  # with all that is left of it, whoever still holds it

    def _leave(self, reader: Any) -> None:
        with _LOCK:
            mine = [one for one in self._readers if one[0] is reader]
            if self._closed.is_set() or not mine:
                return
            self._readers.remove(mine[0])
            self._graph.readers.remove(reader.guid.bytes)
            self._waiting.detach(reader.anything)
            self._publish_graph()

    def _topic(self, topic: str, kind: str) -> Any:
        key = (topic, kind)
        if key not in self._topics:
            self._topics[key] = _cyclonedds().Topic(self._participant, topic, wire(kind))
        return self._topics[key]

    def _writer(self, topic: str, kind: str, qos: Qos) -> Any:
        made = _cyclonedds().DataWriter(
            self._participant, self._topic(topic, kind), _policies(qos, kind)
        )
        self._writers.append(made)
        return made

    def _reader(self, topic: str, kind: str, qos: Qos, callback: Callback) -> Any:
        dds = _cyclonedds()
        made = dds.DataReader(self._participant, self._topic(topic, kind), _policies(qos, kind))
        new = dds.ViewState.Any | dds.InstanceState.Any | dds.SampleState.NotRead
        anything = dds.ReadCondition(made, new)
        made.anything = anything  # lives as long as the reader
        self._readers.append((made, kind, callback))
        self._waiting.attach(anything)
        return made

    def _listen(self) -> None:
        """Everything that comes is taken here, in the order in which it came per topic."""
        while not self._closed.is_set():
            if not self._waiting.wait(_WAIT):
                continue
            stamp = time.monotonic()
            with _LOCK:
                readers = list(self._readers)
            for reader, kind, callback in readers:
                for sample in reader.take(_MOST):
                    if getattr(sample, "data", None):  # else its publisher has gone
                        message, damage = unpacked(sample.data, kind)
                        sender = str(sample.sample_info.publication_handle)
                        callback(Received(message, stamp, damage, sender))

    def _publish_graph(self) -> None:
        """Publish on ros_discovery_info which node has which publishers and subscribers."""
        self._about.write(wire(INFO)(packed(self._graph.message(), INFO)))

    def _on_graph(self, received: Received) -> None:
        if received.message is not None:
            gid, nodes = described(received.message)
            self._others[gid] = nodes


class _Writer:
    """See `port.Publisher`."""

    def __init__(self, writer: Any, kind: str, closed: threading.Event) -> None:
        self._writer, self._kind, self._closed = writer, kind, closed
        self._wire = wire(kind)

    def send(self, message: Any) -> None:
        """Raises CohelmError for what is no message of the type, or when the transport is closed;
        what the network does with it is not known."""
        ensure_open(self._closed)
        dds = _cyclonedds()
        try:
            self._writer.write(self._wire(packed(message, self._kind)))
        except dds.DDSException as error:
            if error.code != dds.DDSException.DDS_RETCODE_TIMEOUT:  # no room: the next is newer
                raise CohelmError(f"a {self._kind} can not be sent: {error.msg}") from error


def _policies(qos: Qos, kind: str) -> Any:
    dds = _cyclonedds()
    lasting, durability = dds.Policy.Reliability, dds.Policy.Durability
    return dds.Qos(
        lasting.Reliable(0) if qos.reliable else lasting.BestEffort,
        durability.TransientLocal if qos.transient_local else durability.Volatile,
        dds.Policy.History.KeepLast(qos.depth),
        dds.Policy.Userdata(f"typehash={type_hash(kind)};".encode()),
    )


def _qos(given: Any) -> Qos:
    """Of another participant's endpoint."""
    policy = _cyclonedds().Policy
    found: dict[str, Any] = {one.__scope__: one for one in given}
    volatile: Any = policy.Durability.Volatile
    return Qos(
        found.get("Reliability") != policy.Reliability.BestEffort,
        found.get("Durability", volatile) != volatile, 0,
    )  # fmt: skip


@cache
def _cyclonedds() -> Any:
    """All that is used of it, under one name. CohelmError where it is not installed."""
    found: dict[str, Any] = {}
    try:
        for name in ("builtin", "core", "domain", "pub", "qos", "sub", "topic"):
            found |= vars(import_module(f"cyclonedds.{name}"))
    except ImportError as error:
        raise _not_installed() from error
    # Once Python ends it would delete whatever is left of DDS, in any order, and has been seen to
    # wait for that for ever: a gate whose loop had been killed did not end.
    atexit.register(found["Entity"]._entities.clear)
    return SimpleNamespace(**found)


def _not_installed() -> CohelmError:
    if requirements("ros2"):
        return missing("ROS 2 over DDS", "ros2")
    return CohelmError(
        "ROS 2 over DDS needs cyclonedds, of which there is no wheel for this machine and Python: "
        "use x86-64 and Python 3.13 or older"
    )
