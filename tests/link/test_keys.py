"""Pairing: keys, certificates, and what is refused."""

from __future__ import annotations

import stat

import pytest

from cohelm.core.errors import CohelmError
from cohelm.link import keys
from cohelm.link.dtls import Channel, HandshakeRefused, context


@pytest.fixture(autouse=True)
def home(tmp_path, monkeypatch):
    monkeypatch.setenv("COHELM_KEYS", str(tmp_path / "keys"))
    return tmp_path / "keys"


@pytest.fixture
def moved(tmp_path, monkeypatch):
    """From the robot's machine to the station's."""

    def move() -> None:
        monkeypatch.setenv("COHELM_KEYS", str(tmp_path / "station keys"))

    return move


def shaken(robot: keys.Keys, station: keys.Keys) -> tuple[Channel, Channel]:
    """Both ends of a connection, or Refused."""
    server = Channel(context(robot, server=True), server=True)
    client = Channel(context(station, server=False), server=False)
    client.start()
    greeted = False
    for _ in range(10):
        for datagram in client.waiting():
            if greeted:
                server.take(datagram)
            elif server.greeted(datagram, ("there", 1)):
                greeted = True
                server.start()
        for datagram in server.waiting():
            client.take(datagram)
    assert server.up
    assert client.up
    return server, client


def test_a_user_without_a_home_is_told_how_to_name_a_folder(monkeypatch):
    def homeless():
        raise RuntimeError("Could not determine home directory.")

    for variable in ("COHELM_KEYS", "XDG_CONFIG_HOME"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setattr(keys.Path, "home", homeless)
    with pytest.raises(CohelmError, match="name a folder with the variable COHELM_KEYS"):
        keys.home()


def test_a_paired_station_is_accepted_and_both_ends_are_authenticated(tmp_path, moved):
    keys.robot("sally")
    keys.pair("anna", tmp_path / "anna.pair")
    robot = keys.robot()
    moved()
    assert keys.install(tmp_path / "anna.pair") == "sally"
    server, client = shaken(robot, keys.station())
    assert (server.name, client.name) == ("anna", "sally")
    assert server.peer == keys.fingerprint(keys.station("sally").certificate)
    assert client.seal(b"hello")
    assert server.take(client.seal(b"x" * 1150)[0]) == [b"x" * 1150]


def test_a_removed_station_is_refused(tmp_path, moved):
    keys.pair("anna", tmp_path / "anna.pair")
    keys.pair("ben", tmp_path / "ben.pair")
    keys.unpair("anna")
    assert [name for name, _ in keys.stations()] == ["ben"]
    robot = keys.robot()
    moved()
    keys.install(tmp_path / "anna.pair")
    with pytest.raises(HandshakeRefused, match="certificate"):
        shaken(robot, keys.station())


def test_a_station_accepts_no_other_robot_even_with_its_stolen_certificate():
    robot, station = keys.pair_here()
    impostor, _ = keys.pair_here()
    with pytest.raises(HandshakeRefused, match="certificate"):
        shaken(impostor._replace(trusted=robot.trusted), station)
    with pytest.raises(
        HandshakeRefused, match="certificate"
    ):  # a station does not pass for a robot
        shaken(station._replace(trusted=(station.certificate,)), station)


def test_a_certificate_signed_by_a_paired_station_is_refused():
    """Pinned is pinned: a station can not let others in."""
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization

    robot, station = keys.pair_here()
    stranger = keys.made("stranger", "station")
    inner = x509.load_pem_x509_certificate(stranger[0])
    issuer = x509.load_pem_x509_certificate(station.certificate)
    key = serialization.load_pem_private_key(station.key, None)
    signed = (
        x509.CertificateBuilder().subject_name(inner.subject).issuer_name(issuer.subject)
        .public_key(inner.public_key()).serial_number(7)
        .not_valid_before(inner.not_valid_before_utc).not_valid_after(inner.not_valid_after_utc)
        .sign(key, hashes.SHA256())
    )  # fmt: skip
    pem = signed.public_bytes(serialization.Encoding.PEM)
    with pytest.raises(HandshakeRefused, match="certificate"):
        shaken(robot, station._replace(certificate=pem, key=stranger[1]))


def test_only_the_owner_can_read_secret_files(tmp_path, home, moved):
    keys.pair("anna", tmp_path / "anna.pair")
    secret = [tmp_path / "anna.pair", home / "robot" / "robot.key"]
    moved()
    keys.install(tmp_path / "anna.pair")
    secret += (tmp_path / "station keys").rglob("*.key")
    assert len(secret) == 3
    for path in secret:
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
    secret[-1].chmod(0o644)
    with pytest.raises(CohelmError, match="chmod 600"):
        keys.station()


def test_a_pairing_that_fails_is_reported_with_the_cure(tmp_path, moved):
    with pytest.raises(CohelmError, match="cohelm pair new"):
        keys.station()
    for name in ("", "../x", "a b", "x" * 33, ".hidden"):
        with pytest.raises(CohelmError, match="can not be a name"):
            keys.pair(name, tmp_path / "x.pair")
    keys.pair("anna", tmp_path / "anna.pair")
    with pytest.raises(CohelmError, match="pair remove anna"):
        keys.pair("anna", tmp_path / "again.pair")
    with pytest.raises(CohelmError, match="name another file"):
        keys.pair("ben", tmp_path / "anna.pair")
    assert [name for name, _ in keys.stations()] == ["anna"]
    with pytest.raises(CohelmError, match="is called"):
        keys.robot("other")
    with pytest.raises(CohelmError, match="paired: anna"):
        keys.unpair("ben")
    (tmp_path / "bad.pair").write_bytes(b"-----BEGIN nonsense")
    with pytest.raises(CohelmError, match="does not hold a pairing"):
        keys.install(tmp_path / "bad.pair")
    with pytest.raises(CohelmError, match="can not be read"):
        keys.install(tmp_path / "none.pair")
    moved()
    keys.install(tmp_path / "anna.pair")
    with pytest.raises(CohelmError, match="no robot 'x'"):
        keys.station("x")


def test_a_reinstalled_robot_must_be_paired_again(tmp_path, monkeypatch, moved):
    for where in ("one", "two"):
        monkeypatch.setenv("COHELM_KEYS", str(tmp_path / where))
        keys.robot("sally")
        keys.pair("anna", tmp_path / f"{where}.pair")
    moved()
    keys.install(tmp_path / "one.pair")
    with pytest.raises(CohelmError, match=r"another robot called 'sally'.* --robot OTHER`"):
        keys.install(tmp_path / "two.pair")
    assert keys.install(tmp_path / "one.pair") == "sally"


@pytest.mark.parametrize("name", ["robot.pem", "robot.key", "stations/anna.pem"])
@pytest.mark.parametrize("left", ["damaged", ""])
def test_a_damaged_file_is_named_and_what_is_said_to_mend_it_does(tmp_path, home, name, left):
    """As by a power cut; empty, too."""
    keys.pair("anna", tmp_path / "anna.pair")
    file = home / "robot" / name
    file.write_text(left)
    with pytest.raises(CohelmError, match=rf"{file} is damaged: delete it,? and pair again"):
        keys.robot()
    file.unlink()
    keys.robot()
    keys.pair("bert", tmp_path / "bert.pair")
    assert "bert" in [name for name, _ in keys.stations()]


def test_an_unwritable_key_folder_is_reported_with_the_cure(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("COHELM_KEYS", str(tmp_path / "file" / "keys"))
    with pytest.raises(CohelmError, match="name another folder with the variable COHELM_KEYS"):
        keys.robot("sally")
