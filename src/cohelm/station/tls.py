"""Makes a self-signed certificate for the web page: for tablets on the same network.

A browser warns once, and must show the fingerprint that is printed at the start. The certificate is
kept, so that a browser that accepted it does not warn again.
"""

from __future__ import annotations

import datetime
import ipaddress
import os
import socket
import ssl
from pathlib import Path

from cryptography import x509
from cryptography.x509.oid import ExtendedKeyUsageOID

from cohelm.core.errors import CohelmError
from cohelm.core.files import check_regular
from cohelm.link.key_permissions import guarded, make_folder
from cohelm.link.keys import fingerprint, read, self_signed

DAYS = 397
"""Validity; browsers refuse certificates that are valid for longer."""
_RENEW = datetime.timedelta(days=30)


def certificate(folder: Path, host: str) -> tuple[Path, Path, str]:
    """Files of certificate and key for `host`, and the fingerprint; made if there are none.

    Raises CohelmError if the folder can not be written.
    """
    path, key = folder / "station-web.pem", folder / "station-web.key"
    names = _names(host)
    try:
        if not _valid(path, key, names):
            make_folder(folder)
            _make(path, key, names)
        guarded(key, within=folder, secret=True)
        return path, key, fingerprint(path.read_bytes())
    except OSError as error:
        raise CohelmError(
            f"{folder}: no certificate can be kept there ({error.strerror}); name another folder "
            f"with the variable COHELM_KEYS"
        ) from None


def certified(path: Path) -> frozenset[str]:
    """The host names in a certificate file. Raises CohelmError if it holds no certificate."""
    try:
        kept = x509.load_pem_x509_certificate(read(path))
        there = kept.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return frozenset()
    except ValueError:
        raise CohelmError(f"{path} holds no certificate: name a file in PEM") from None
    return frozenset(name.lower() for name in there.get_values_for_type(x509.DNSName))


def over_since(path: Path) -> str:
    """The day until which a certificate was valid; empty: it still is, by this machine's clock."""
    until = x509.load_pem_x509_certificate(read(path)).not_valid_after_utc
    return f"{until:%Y-%m-%d}" if until < datetime.datetime.now(datetime.UTC) else ""


def own(path: Path, key: Path) -> tuple[Path, Path]:
    """Check the user's own certificate and key before they are used.

    Raises CohelmError if a browser could not be served with them.
    """
    certified(path)
    check_regular(key)
    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(path, key, password="")
    except ssl.SSLError:
        raise CohelmError(
            f"{key} is not the key of the certificate {path}, or needs a password: name its key, "
            f"in PEM and without one"
        ) from None
    except OSError as error:
        raise CohelmError(f"{key} can not be read: {error.strerror}") from None
    guarded(key, secret=True)
    return path, key


def _names(host: str) -> list[x509.GeneralName]:
    """The names and addresses that a browser may use for this machine."""
    names = {"localhost", socket.gethostname()}
    addresses = {"127.0.0.1", "::1"}
    try:
        addresses.add(str(ipaddress.ip_address(host)))
    except ValueError:
        names.add(host)
    if host in ("0.0.0.0", "::"):
        addresses.discard(host)
        addresses.update(_own_addresses())
    return [
        *(x509.DNSName(name) for name in sorted(names)),
        *(x509.IPAddress(ipaddress.ip_address(a)) for a in sorted(addresses)),
    ]


def _own_addresses() -> set[str]:
    try:
        found = socket.getaddrinfo(socket.gethostname(), None)
    except OSError:
        return set()
    return {str(entry[4][0]).partition("%")[0] for entry in found}


def _valid(path: Path, key: Path, names: list[x509.GeneralName]) -> bool:
    """Whether the files hold a certificate that is valid for all these names."""
    if not (path.exists() and key.exists()):
        return False
    try:
        kept = x509.load_pem_x509_certificate(path.read_bytes())
        there = kept.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except (ValueError, x509.ExtensionNotFound):
        return False
    now = datetime.datetime.now(datetime.UTC)
    lasts = kept.not_valid_before_utc <= now < kept.not_valid_after_utc - _RENEW
    return lasts and set(names) <= set(there)


def _make(path: Path, key_path: Path, names: list[x509.GeneralName]) -> None:
    begins = datetime.datetime.now(datetime.UTC) - datetime.timedelta(days=1)
    usage = x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH])
    certificate, key = self_signed(
        "cohelm station", "", (begins, begins + datetime.timedelta(days=DAYS)),
        (x509.SubjectAlternativeName(names), usage),
    )  # fmt: skip
    key_path.unlink(missing_ok=True)
    with os.fdopen(os.open(key_path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
        file.write(key)
    path.write_bytes(certificate)
