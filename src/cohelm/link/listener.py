"""The robot's listening socket: performs DTLS handshakes and returns authenticated channels.

Designed against floods. No state is kept until the sender has proved its address (cookie). Then
handshakes are limited in rate, number and time. Each authenticated client has a socket of its own,
which a flood does not fill.
"""

from __future__ import annotations

import contextlib
import logging
import socket
from collections import Counter
from collections.abc import Callable
from typing import NamedTuple

from OpenSSL import SSL

from cohelm.link import udp
from cohelm.link.dtls import Channel, HandshakeRefused
from cohelm.link.rate import TokenBucket
from cohelm.link.udp import Address

_PER_TURN = 16
"""Unauthenticated datagrams processed before the clients' turn."""
_HANDSHAKES = 20.0  # begun per second, all together
_UNDER_WAY = 8
_MOST_REASONS = 64
_PATIENCE = 5.0  # [s], for a handshake
_log = logging.getLogger("cohelm.link")


class Guest(NamedTuple):
    """An authenticated peer."""

    channel: Channel
    socket: socket.socket
    address: Address
    first: list[bytes]
    """Messages that came together with the end of the handshake."""


class _Handshake(NamedTuple):
    channel: Channel
    socket: socket.socket
    since: float


class Listener:
    """One listening socket."""

    def __init__(self, made: SSL.Context, host: str, port: int, clock: Callable[[], float]) -> None:
        self._context = made
        self._clock = clock
        self._family, bind = udp.resolved(host, port, socket.SOCK_DGRAM)
        self.socket = udp.opened(self._family, bind, shared=True)
        self.address: Address = self.socket.getsockname()
        self._listener = Channel(made, server=True)
        self._under_way: dict[Address, _Handshake] = {}
        self._handshakes = TokenBucket(_HANDSHAKES, _HANDSHAKES, clock())
        self.counts: Counter[str] = Counter()
        """Refusals, by reason."""
        self._logged: dict[str, float] = {}

    def sockets(self) -> list[socket.socket]:
        """To wait on."""
        return [self.socket, *(handshake.socket for handshake in self._under_way.values())]

    def turn(self) -> list[Guest]:
        """Process what came; returns newly authenticated peers."""
        now = self._clock()
        guests: list[Guest] = []
        for address, handshake in list(self._under_way.items()):
            for datagram, source in udp.receive(handshake.socket, _PER_TURN):
                if source[:2] == address[:2]:
                    guests += self._continue(address, datagram)
        for datagram, address in udp.receive(self.socket, _PER_TURN):
            if address in self._under_way:
                guests += self._continue(address, datagram)
            else:
                self._stranger(datagram, address, now)
        self._tick(now)
        return guests

    def refuse(self, address: Address, why: str) -> None:
        """Count it, and log it, though not more than one of a kind a second."""
        if why not in self.counts and len(self.counts) > _MOST_REASONS:
            why = "other reasons"
        self.counts[why] += 1
        now = self._clock()
        if now - self._logged.get(why, -1.0) >= 1.0:
            self._logged[why] = now
            _log.warning("refused %s: %s (%d so far)", address[0], why, self.counts[why])

    def close(self) -> None:
        """Let go of all sockets."""
        for sock in self.sockets():
            sock.close()
        self._under_way.clear()

    def _stranger(self, datagram: bytes, address: Address, now: float) -> None:
        channel = self._listener
        try:
            known = channel.greeted(datagram, address)
        except HandshakeRefused as refused:
            self.refuse(address, f"handshake failed: {refused}")
            self._listener = Channel(self._context, server=True)
            return
        if not known:
            udp.send(self.socket, channel.waiting(), address)
            return
        self._listener = Channel(self._context, server=True)
        if not self._handshakes.take(now):
            self.refuse(address, "too many handshakes")
            return
        same = [other for other in self._under_way if other[0] == address[0]]
        if len(same) >= _UNDER_WAY // 2:  # nobody may take all the places
            self._drop(same[0], "too many handshakes from there")
        if len(self._under_way) >= _UNDER_WAY:
            self._drop(next(iter(self._under_way)), "replaced by newer handshakes")
        try:
            own = udp.opened(self._family, self.address, shared=True)
        except Exception as error:  # out of descriptors must not end the robot
            self.refuse(address, f"no socket: {error}")
            return
        with contextlib.suppress(OSError):
            own.connect(address)
        self._under_way[address] = _Handshake(channel, own, now)
        self._continue(address, None)

    def _continue(self, address: Address, datagram: bytes | None) -> list[Guest]:
        """Continue a handshake, or begin it."""
        handshake = self._under_way.get(address)
        if handshake is None:
            return []
        first: list[bytes] = []
        why = ""
        try:
            if datagram is None:
                handshake.channel.start()
            else:
                first = handshake.channel.take(datagram)
        except HandshakeRefused as refused:
            why = str(refused)
        udp.send(handshake.socket, handshake.channel.waiting())
        if why:
            self._drop(address, why)
        elif handshake.channel.up:
            del self._under_way[address]
            return [Guest(handshake.channel, handshake.socket, address, first)]
        return []

    def _tick(self, now: float) -> None:
        for address, handshake in list(self._under_way.items()):
            if now - handshake.since > _PATIENCE:
                self._drop(address, "the handshake took too long")
                continue
            try:
                handshake.channel.tick()
            except HandshakeRefused as refused:
                self._drop(address, str(refused))
                continue
            udp.send(handshake.socket, handshake.channel.waiting())

    def _drop(self, address: Address, why: str) -> None:
        self._under_way.pop(address).socket.close()
        self.refuse(address, why)
