"""DTLS 1.2 (RFC 6347) with certificates at both ends, independent of any socket.

A `Channel` turns datagrams into messages and back; its owner moves the bytes. OpenSSL does the
cryptography: it drops forged and replayed records silently.
"""

from __future__ import annotations

import hashlib
import hmac
import os
from typing import Any

from cryptography import x509
from cryptography.hazmat.primitives.serialization import Encoding, load_pem_private_key
from OpenSSL import SSL, crypto

from cohelm.core.errors import CohelmError
from cohelm.link.keys import Keys, common_name, fingerprint

MTU = 1200
"""Largest datagram [byte]: with UDP and IPv6 below 1280, which every IPv6 path carries."""
CIPHERS = (
    b"ECDHE-ECDSA-AES128-GCM-SHA256:ECDHE-ECDSA-AES256-GCM-SHA384:ECDHE-ECDSA-CHACHA20-POLY1305"
)
_BUFFER = 65536


class HandshakeRefused(Exception):
    """The other end is not trusted, or broke off; the text gives the reason."""


def context(keys: Keys, server: bool) -> SSL.Context:
    """DTLS 1.2: an end that shows its certificate and accepts exactly those it trusts."""
    made = SSL.Context(SSL.DTLS_SERVER_METHOD if server else SSL.DTLS_CLIENT_METHOD)
    made.set_cipher_list(CIPHERS)
    # The MTU is ours, not the socket's; no new handshake inside an old one.
    made.set_options(SSL.OP_NO_QUERY_MTU | SSL.OP_NO_RENEGOTIATION | SSL.OP_NO_TICKET)
    made.set_session_cache_mode(SSL.SESS_CACHE_OFF)
    _certify(made, keys)
    if server:
        secret = os.urandom(32)

        def cookie(of: SSL.Connection) -> bytes:
            return hmac.digest(secret, repr(of.get_app_data()).encode(), hashlib.sha256)[:16]

        made.set_cookie_generate_callback(cookie)
        made.set_cookie_verify_callback(lambda of, shown: hmac.compare_digest(shown, cookie(of)))
    return made


def stream_context(keys: Keys) -> SSL.Context:
    """TLS 1.3 for bulk, with the same certificates; for either end."""
    made = SSL.Context(SSL.TLS_METHOD)
    made.set_min_proto_version(SSL.TLS1_3_VERSION)
    made.set_options(SSL.OP_NO_TICKET)
    made.set_session_cache_mode(SSL.SESS_CACHE_OFF)
    _certify(made, keys)
    return made


def _certify(made: SSL.Context, keys: Keys) -> None:
    own = x509.load_pem_x509_certificate(keys.certificate)
    key: Any = load_pem_private_key(keys.key, None)
    made.use_certificate(own)
    made.use_privatekey(key)
    made.check_privatekey()
    store = made.get_cert_store()
    if store is None:
        raise CohelmError("this OpenSSL offers no certificate store: reinstall pyopenssl")
    pinned: set[bytes] = set()
    for pem in keys.trusted:
        certificate = x509.load_pem_x509_certificate(pem)
        pinned.add(certificate.public_bytes(Encoding.DER))
        store.add_cert(crypto.X509.from_cryptography(certificate))

    def accepted(_: SSL.Connection, shown: crypto.X509, error: int, depth: int, good: int) -> bool:
        # Only the pinned certificates, none signed by one of them.
        if not good or depth != 0:
            return False
        try:
            return shown.to_cryptography().public_bytes(Encoding.DER) in pinned
        except ValueError:
            return False

    made.set_verify(SSL.VERIFY_PEER | SSL.VERIFY_FAIL_IF_NO_PEER_CERT, accepted)


class Secured:
    """One end of a connection with certificates at both ends."""

    def __init__(self, made: SSL.Context, server: bool) -> None:
        self._ssl = SSL.Connection(made, None)
        if server:
            self._ssl.set_accept_state()  # before DTLSv1_listen, or it fails
        else:
            self._ssl.set_connect_state()
        self.up = False
        self.peer = ""
        """Fingerprint of the other end's certificate, once up."""
        self.name = ""
        """The name in it."""

    def _handshake(self) -> None:
        """Begin or continue it. Raises SSL.Error, or HandshakeRefused."""
        try:
            self._ssl.do_handshake()
        except SSL.WantReadError:
            return
        shown = self._ssl.get_peer_certificate(as_cryptography=True)
        if shown is None:
            raise HandshakeRefused("no certificate was presented")
        pem = shown.public_bytes(Encoding.PEM)
        self.peer, self.name, self.up = fingerprint(pem), common_name(pem), True


class Channel(Secured):
    """One end of a DTLS connection: `take` received datagrams, send those of `waiting`."""

    def __init__(self, made: SSL.Context, server: bool) -> None:
        super().__init__(made, server)
        self._ssl.set_ciphertext_mtu(MTU)

    def greeted(self, datagram: bytes, address: object) -> bool:
        """Server, before a handshake: whether this is a client's second hello, with our cookie.

        Stateless for all other datagrams: a flood of hellos costs an answer each, and only a client
        that has the address it claims gets further. Raises HandshakeRefused for what is no hello.
        """
        if not datagram:
            return False
        self._ssl.set_app_data(address)
        try:
            self._ssl.bio_write(datagram)
            self._ssl.DTLSv1_listen()
        except SSL.WantReadError:
            return False
        except SSL.Error as error:
            raise HandshakeRefused(reason_of(error)) from None
        return True

    def start(self) -> None:
        """Begin or continue the handshake."""
        try:
            self._handshake()
        except SSL.Error as error:
            raise HandshakeRefused(reason_of(error)) from None

    def take(self, datagram: bytes) -> list[bytes]:
        """The messages in a datagram; none while the handshake goes on, or if it is forged.

        Raises HandshakeRefused when the other end is not trusted or has closed the connection.
        """
        messages: list[bytes] = []
        if not datagram:
            return messages
        try:
            self._ssl.bio_write(datagram)
        except SSL.Error as error:
            raise HandshakeRefused(reason_of(error)) from None
        if not self.up:
            self.start()
            if not self.up:
                return messages
        while True:
            try:
                messages.append(self._ssl.recv(_BUFFER))
            except SSL.WantReadError:
                return messages
            except SSL.ZeroReturnError:
                raise HandshakeRefused("the other end closed the connection") from None
            except SSL.Error as error:
                raise HandshakeRefused(reason_of(error)) from None

    def seal(self, message: bytes) -> list[bytes]:
        """The datagrams that carry a message to the other end."""
        try:
            self._ssl.send(message)
        except SSL.Error as error:
            raise HandshakeRefused(reason_of(error)) from None
        return self.waiting()

    def waiting(self) -> list[bytes]:
        """The datagrams that must be sent now, one at a time."""
        datagrams: list[bytes] = []
        while True:
            try:
                flight = self._ssl.bio_read(_BUFFER)
            except SSL.Error:
                return datagrams
            datagrams.extend(_records(flight))

    def tick(self) -> float | None:
        """Repeat lost parts of the handshake, if due; returns the seconds until the next time."""
        if self.up:
            return None
        try:
            left = self._ssl.DTLSv1_get_timeout()
            if left is not None and left <= 0.0:
                self._ssl.DTLSv1_handle_timeout()
                left = self._ssl.DTLSv1_get_timeout()
        except SSL.Error as error:
            raise HandshakeRefused(reason_of(error)) from None
        return left

    def close(self) -> list[bytes]:
        """Shut the connection down; the datagrams that do it."""
        if self.up:
            try:
                self._ssl.shutdown()
            except SSL.Error:
                return []
        return self.waiting()


def _records(flight: bytes) -> list[bytes]:
    """DTLS records that OpenSSL wrote one after the other, packed into datagrams of <= MTU.

    A memory buffer keeps no borders between datagrams; a record's header has its length (RFC
    6347 4.1), and a record must not be split.
    """
    datagrams: list[bytes] = []
    at = start = 0
    while at + 13 <= len(flight):
        end = at + 13 + int.from_bytes(flight[at + 11 : at + 13], "big")
        if end - start > MTU and at > start:
            datagrams.append(flight[start:at])
            start = at
        at = end
    if start < len(flight):
        datagrams.append(flight[start:])
    return datagrams


def reason_of(error: SSL.Error) -> str:
    """OpenSSL's first reason as a phrase."""
    # ([(library, function, reason), ...],), or for a SysCallError (number, reason)
    found: str | list[tuple[str, str, str]] = error.args[-1] if error.args else ""
    if not isinstance(found, str):
        found = found[0][-1] if found else ""
    return found or type(error).__name__
