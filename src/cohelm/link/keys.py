"""Keys and certificates of robots and stations, pinned at both ends.

A robot has one key and a self-signed certificate, and a folder with the certificate of every
station it trusts. A station has, for each robot, a key of its own and that robot's certificate.
Each end accepts exactly the certificates in its folder. There is no certificate authority that
could be stolen, and to revoke a station, its file is deleted.

    KEYS/robot/robot.key, robot.pem         the robot's own
    KEYS/robot/stations/NAME.pem            stations that it trusts
    KEYS/station/ROBOT/station.key, station.pem, robot.pem

KEYS is $COHELM_KEYS, or cohelm/keys in $XDG_CONFIG_HOME (~/.config). Only this user may have access
to it (`key_permissions`). Certificates do not expire: robots without a battery clock start in 1970.
"""

from __future__ import annotations

import datetime
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

from cohelm.core.errors import CohelmError
from cohelm.core.files import read_bytes, whole
from cohelm.link.key_permissions import guarded, make_folder

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,31}")
_PEM = re.compile(rb"-----BEGIN ([A-Z ]+)-----.+?-----END \1-----\n", re.DOTALL)
_LARGEST = 10**6  # [bytes]
_ALWAYS = (datetime.datetime(1970, 1, 1), datetime.datetime(9999, 12, 31, 23, 59, 59))


class Keys(NamedTuple):
    """One end's key and certificate, and the certificates it trusts."""

    name: str
    certificate: bytes
    """PEM."""
    key: bytes
    """PEM; secret."""
    trusted: tuple[bytes, ...]
    """PEM certificates of the other ends."""


def home() -> Path:
    """The folder of the keys. Raises CohelmError for a user without a home."""
    chosen = os.environ.get("COHELM_KEYS")
    if chosen:
        return Path(chosen)
    config = os.environ.get("XDG_CONFIG_HOME")
    try:
        return (Path(config) if config else Path.home() / ".config") / "cohelm" / "keys"
    except RuntimeError as error:
        raise CohelmError(
            "this user has no home folder to keep keys in: name a folder with the variable "
            "COHELM_KEYS"
        ) from error


def made(name: str, role: str) -> tuple[bytes, bytes]:
    """A new certificate and its key, PEM, on curve P-256; role: robot or station."""
    return self_signed(name, role, _ALWAYS)


def self_signed(
    name: str, unit: str, valid: tuple[datetime.datetime, datetime.datetime],
    extensions: Sequence[x509.ExtensionType] = (),
) -> tuple[bytes, bytes]:  # fmt: skip
    """A new self-signed certificate and its key, PEM, on curve P-256. unit: of the organization, or
    empty. valid: from and until when."""
    key = ec.generate_private_key(ec.SECP256R1())
    called = [(NameOID.COMMON_NAME, name), (NameOID.ORGANIZATIONAL_UNIT_NAME, unit)]
    subject = x509.Name([x509.NameAttribute(oid, text) for oid, text in called if text])
    made = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(subject)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(valid[0])
        .not_valid_after(valid[1])
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
    )
    for extension in extensions:
        made = made.add_extension(extension, critical=False)
    pem = serialization.Encoding.PEM
    return made.sign(key, hashes.SHA256()).public_bytes(pem), key.private_bytes(
        pem, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )


def fingerprint(certificate: bytes) -> str:
    """SHA-256 of a PEM certificate, as openssl x509 -fingerprint -sha256 prints it."""
    return _loaded(certificate).fingerprint(hashes.SHA256()).hex(":").upper()


def common_name(certificate: bytes) -> str:
    """The name in a PEM certificate."""
    names = _loaded(certificate).subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    return str(names[0].value) if names else ""


def robot(name: str | None = None) -> Keys:
    """The keys of this machine's robot; made if missing, with `name` or the machine's name."""
    folder = home() / "robot"
    if not ((folder / "robot.key").exists() and (folder / "robot.pem").exists()):
        certificate, key = made(_checked_name(name or _host()), "robot")
        write(folder / "robot.pem", certificate)
        write(folder / "robot.key", key)  # last: it marks the folder as complete
    certificate = _checked(folder / "robot.pem")
    guarded(folder / "stations", within=home())
    stations = tuple(_checked(path) for path in sorted((folder / "stations").glob("*.pem")))
    called = common_name(certificate)
    if name is not None and name != called:
        raise CohelmError(
            f"the robot of {folder} is called {called!r}, not {name!r}: leave the name out, or "
            f"delete that folder to begin anew (every station must be paired again)"
        )
    return Keys(called, certificate, _secret(folder / "robot.key"), stations)


def pair(station: str, to: Path) -> Keys:
    """Make a key for a station, trust it, and write what it must install to the file `to`."""
    own = robot()
    path = home() / "robot" / "stations" / f"{_checked_name(station)}.pem"
    if path.exists():
        raise CohelmError(
            f"a station {station!r} is paired already: choose another name, or remove it first "
            f"with `cohelm pair remove {station}`"
        )
    guarded(path.parent, within=home())  # before a key is written that would be refused
    certificate, key = made(station, "station")
    write(to, own.certificate + certificate + key, fresh=True)
    write(path, certificate)
    return own


def install(file: Path) -> str:
    """Install what `pair` wrote; returns the robot's name."""
    found = list(_PEM.finditer(read(file)))
    if [part[1] for part in found] != [b"CERTIFICATE", b"CERTIFICATE", b"PRIVATE KEY"]:
        raise CohelmError(
            f"{file} does not hold a pairing: make one on the robot with `cohelm pair new NAME`"
        )
    of_robot, own, key = (part[0] for part in found)
    name = _checked_name(common_name(of_robot))
    folder = home() / "station" / name
    if (folder / "robot.pem").exists() and read(folder / "robot.pem") != of_robot:
        raise CohelmError(
            f"another robot called {name!r} is installed in {folder}: if it was set up anew, "
            f"delete that folder and install again; if there are two, give one a name of its own, "
            f"on it: `cohelm pair new NAME --robot OTHER`"
        )
    for file_name, content in (("robot.pem", of_robot), ("station.pem", own), ("station.key", key)):
        write(folder / file_name, content)
    return name


def station(robot_name: str | None = None) -> Keys:
    """This station's keys for a robot; None: the only one."""
    folder = home() / "station"
    known = sorted(path.parent.name for path in folder.glob("*/station.key"))
    if not known:
        raise CohelmError(
            "this station is paired with no robot: run `cohelm pair new NAME` on the robot, bring "
            "the file here and run `cohelm pair install FILE`"
        )
    if robot_name is None and len(known) > 1:
        raise CohelmError(f"several robots are paired: name one of {', '.join(known)}")
    chosen = robot_name or known[0]
    if chosen not in known:
        raise CohelmError(f"no robot {chosen!r} is paired here; paired: {', '.join(known)}")
    return of_station(folder / chosen)


def of_station(folder: Path) -> Keys:
    """A station's keys, from the folder they were written to."""
    certificate = _checked(folder / "station.pem")
    return Keys(
        common_name(certificate), certificate, _secret(folder / "station.key"),
        (_checked(folder / "robot.pem"),),
    )  # fmt: skip


def stations() -> list[tuple[str, str]]:
    """Name and fingerprint of each station that the robot of this machine trusts."""
    folder = home() / "robot" / "stations"
    return [(path.stem, fingerprint(_certificate(path))) for path in sorted(folder.glob("*.pem"))]


def robots() -> list[tuple[str, str]]:
    """Name and fingerprint of each robot this station is paired with."""
    folder = home() / "station"
    paths = sorted(folder.glob("*/robot.pem"))
    return [(path.parent.name, fingerprint(_certificate(path))) for path in paths]


def unpair(name: str) -> None:
    """Revoke a station of this machine's robot (from its next start on)."""
    path = home() / "robot" / "stations" / f"{name}.pem"
    known = [called for called, _ in stations()]
    if name not in known:
        raise CohelmError(f"no station {name!r} is paired; paired: {', '.join(known) or 'none'}")
    path.unlink()


def pair_here(*names: str) -> tuple[Keys, ...]:
    """Keys of a robot, and of each of its stations on this machine: by default one, `local`."""
    of_robot = made("robot", "robot")
    own = {name: made(name, "station") for name in names or ("local",)}
    return (
        Keys("robot", *of_robot, tuple(certificate for certificate, _ in own.values())),
        *(Keys(name, *pair, (of_robot[0],)) for name, pair in own.items()),
    )


def with_local_station(of_robot: Keys, name: str) -> tuple[Keys, Keys]:
    """A robot's keys with one more trusted station, while they are in use, and that station's."""
    certificate, key = made(name, "station")
    return (
        of_robot._replace(trusted=(*of_robot.trusted, certificate)),
        Keys(name, certificate, key, (of_robot.certificate,)),
    )


def _checked_name(name: str) -> str:
    if not _NAME.fullmatch(name):
        raise CohelmError(
            f"{name!r} can not be a name: use 1 to 32 letters, digits, '.', '_' and '-', the "
            f"first a letter or digit"
        )
    return name


def _host() -> str:
    return re.sub(r"[^A-Za-z0-9._-]", "-", os.uname().nodename).lstrip("._-")[:32] or "robot"


def _loaded(certificate: bytes, called: str = "a certificate") -> x509.Certificate:
    try:
        return x509.load_pem_x509_certificate(certificate)
    except ValueError:
        raise CohelmError(f"{called} is damaged: delete it and pair again") from None


def write(path: Path, content: bytes, fresh: bool = False) -> None:
    """Write a file that only its owner may read; atomically, or (`fresh`) only a new one."""
    try:
        make_folder(path.parent)
        if path.is_relative_to(home()):
            guarded(path.parent, within=home())
        if fresh:  # in any folder: by its handle, as another user may put a link in its place
            handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
            with os.fdopen(handle, "wb") as file:
                file.write(content)
        else:
            with whole(path, 0o600) as new:
                new.write_bytes(content)
    except OSError as error:
        if isinstance(error, FileExistsError) and path.exists():
            raise CohelmError(f"{path} is there already: name another file") from None
        kept = path.is_relative_to(home())
        mend = "; name another folder with the variable COHELM_KEYS" if kept else ""
        raise CohelmError(f"{path} can not be written ({error.strerror}){mend}") from None


def read(path: Path) -> bytes:
    """A key, certificate or pairing. CohelmError where it can not be read."""
    try:
        return read_bytes(path, _LARGEST, "a key or certificate")
    except OSError as error:
        raise CohelmError(f"{path} can not be read: {error.strerror}") from None


def _checked(path: Path) -> bytes:
    """A certificate that no other user can have written."""
    guarded(path, within=home())
    return _certificate(path)


def _certificate(path: Path) -> bytes:
    """Content of a file that holds one."""
    content = read(path)
    _loaded(content, f"the certificate {path}")
    return content


def _secret(path: Path) -> bytes:
    """A private key that no other user can have written or read."""
    guarded(path, within=home(), secret=True)
    content = read(path)
    try:
        serialization.load_pem_private_key(content, None)
    except (ValueError, TypeError):
        raise CohelmError(f"the key {path} is damaged: delete it, and pair again") from None
    return content
