"""`cohelm station`: address, TLS, certificates."""

import datetime
import http.client
import ipaddress
import signal
import ssl
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

from cohelm.link import keys
from cohelm.station.serve import Server
from tests.cli.test_bad_input import refused

NAME = "station.example.org"


def _usage(signs: bool) -> x509.KeyUsage:
    """Of an authority's key, or of a server's."""
    return x509.KeyUsage(not signs, False, False, False, False, signs, signs, False, False)


def signed(folder: Path, password: bytes | None = None, days: int = 1) -> tuple[Path, Path, Path]:
    """An authority's certificate, and a certificate and key it signed for `NAME` and loopback; with
    all that RFC 5280 requires, as Python 3.13 checks by default. days: until they end."""
    now = datetime.datetime.now(datetime.UTC)
    day = datetime.timedelta(days=1)
    begin, end = now - 9 * day, now + days * day

    def made(name: str, issuer: str, key, by, names) -> bytes:
        builder = (
            x509.CertificateBuilder()
            .subject_name(x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)]))
            .issuer_name(x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, issuer)]))
            .public_key(key).serial_number(x509.random_serial_number())
            .not_valid_before(begin).not_valid_after(end)
            .add_extension(x509.BasicConstraints(ca=not names, path_length=None), critical=True)
            .add_extension(x509.SubjectKeyIdentifier.from_public_key(key), critical=False)
            .add_extension(
                x509.AuthorityKeyIdentifier.from_issuer_public_key(by.public_key()), critical=False
            )
            .add_extension(_usage(not names), critical=True)
        )  # fmt: skip
        if names:
            builder = builder.add_extension(x509.SubjectAlternativeName(names), critical=False)
        return builder.sign(by, hashes.SHA256()).public_bytes(serialization.Encoding.PEM)

    authority, key = (ec.generate_private_key(ec.SECP256R1()) for _ in range(2))
    paths = folder / "ca.pem", folder / "own.pem", folder / "own.key"
    paths[0].write_bytes(made("ca", "ca", authority.public_key(), authority, []))
    local = [x509.DNSName(NAME), x509.IPAddress(ipaddress.ip_address("127.0.0.1"))]
    paths[1].write_bytes(made(NAME, "ca", key.public_key(), authority, local))
    plain = serialization.NoEncryption()
    how = serialization.BestAvailableEncryption(password) if password else plain
    pem = key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, how)
    paths[2].write_bytes(pem)
    paths[2].chmod(0o600)
    return paths


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Path:
    from cohelm.scenario import build, load
    from cohelm.study import single

    folder = tmp_path_factory.mktemp("run")
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("cohelm.study.figures.draw_run", lambda run, folder, name: None)
        single.recorded(build.setup(load.scenario("minimal")), folder, lambda what, share: None)
    return folder / single.RECORD


@contextmanager
def station(record: Path, *options: object) -> Iterator[str]:
    """The command, as a process; its address."""
    command = [sys.executable, "-m", "cohelm", "station", "--replay", record, "--port", "0"]
    with subprocess.Popen(
        [*map(str, command), *map(str, options)], stdout=subprocess.PIPE, text=True
    ) as process:
        try:
            assert process.stdout is not None
            yield process.stdout.readline().strip()
        finally:
            process.terminate()
            process.wait(30.0)


@pytest.mark.parametrize("command", [("station", "--replay", "x.mcap"), ("drive", "lab-guard")])
@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.0.2.1", "robot.local"])
def test_the_token_is_sent_unencrypted_only_on_request(cohelm, command, host):
    refused(cohelm(*command, "--host", host), "in clear", "add --tls", "--without-tls")


def test_unencrypted_mode_prints_a_warning(cohelm, monkeypatch):
    from cohelm.cli import station as told

    monkeypatch.setattr(told, "_recorded", lambda path: None)
    monkeypatch.setattr(told, "serve", lambda *_, **__: None)
    said = cohelm("station", "--replay", "x.mcap", "--host", "0.0.0.0", "--without-tls")
    assert said.code == 0
    assert "in clear: whoever can listen on this network can take the token and watch" in said.err
    for quiet in (["--host", "127.0.0.1"], ["--host", "::1"], []):
        assert "in clear" not in cohelm("station", "--replay", "x.mcap", *quiet).err


@pytest.mark.parametrize(
    ("options", "where"),
    [
        (["--host", "[::1]"], ("::1", 8765)), (["--host", "[::1]:8080"], ("::1", 8080)),
        (["--host", "localhost:8080"], ("localhost", 8080)),
        (["--host", "[::1]", "--port", "0"], ("::1", 0)),
    ],
)  # fmt: skip
@pytest.mark.parametrize(
    "command", [["station", "--replay", "x.mcap"], ["station", "--robot", "a"]]
)
def test_the_page_is_served_where_the_host_says(cohelm, monkeypatch, command, options, where):
    from cohelm.cli import station as told

    served: list[object] = []
    monkeypatch.setattr(told, "_recorded", lambda path: None)
    monkeypatch.setattr(told, "_linked", lambda robot, name: None)
    monkeypatch.setattr(told, "serve", lambda _, *at, can: served.append((*at[:2], can)))
    assert cohelm(*command, *options).code == 0
    assert served == [(*where, "watch" if "--replay" in command else "drive")]


@pytest.mark.parametrize("host", ["[::1", ":80", "[::1]:99999", "a/b", "http://localhost"])
def test_a_host_that_can_not_be_one_is_refused_as_that(cohelm, host):
    refused(cohelm("station", "--robot", "a", "--host", host), "is no HOST[:PORT]")


def test_a_port_is_named_once(cohelm):
    said = cohelm("station", "--robot", "a", "--host", "[::1]:8080", "--port", "9")
    refused(said, "--host [::1]:8080 and --port 9 each name a port: leave one of them out")


def test_a_robot_that_is_not_found_is_said_on_the_terminal_too(cohelm, monkeypatch, tmp_path):
    from cohelm.cli import station as told
    from cohelm.link import udp

    def look_up_ends(*_: object, can: str) -> None:
        for thread in threading.enumerate():
            if thread.name == "look-up":
                thread.join(30.0)

    def unknown(*_: object, **__: object) -> None:
        raise OSError("Name or service not known")

    monkeypatch.setenv("COHELM_KEYS", str(tmp_path))
    keys.robot("sally")
    keys.pair("desk", tmp_path / "desk.pair")
    keys.install(tmp_path / "desk.pair")
    monkeypatch.setattr(told, "serve", look_up_ends)
    assert cohelm("station", "--robot", "127.0.0.1").err == ""
    monkeypatch.setattr(udp.socket, "getaddrinfo", unknown)
    said = cohelm("station", "--robot", "sally.example")
    assert "the host 'sally.example' can not be found: check its name" in said.err
    assert "looked up again for each page" in said.err
    assert said.code == 0  # it may be there later


@pytest.mark.slow  # that of TLS has it as well: below
def test_the_printed_address_has_the_token(record):
    with station(record) as address:
        origin, _, token = address.partition("/#token=")
        assert len(token) >= 22  # 128 bits
        link = http.client.HTTPConnection(origin.removeprefix("http://"))
        link.request("POST", "/session", token, {"Origin": origin})
        assert link.getresponse().status == 200
        link.close()


def test_a_custom_certificate_and_its_host_name_are_used(record, tmp_path, cohelm, monkeypatch):
    from cohelm.cli import station as told

    authority, certificate, key = signed(tmp_path)
    with station(record, "--tls-cert", certificate, "--tls-key", key) as address:
        origin, _, token = address.partition("/#token=")
        assert origin.startswith("https://127.0.0.1:")
        assert len(token) >= 22  # 128 bits
        port = int(origin.rpartition(":")[2])
        trusting = ssl.create_default_context(cafile=authority)
        trusting.verify_flags |= ssl.VERIFY_X509_STRICT  # by default from Python 3.13 on
        for name, status in ((NAME, 200), ("127.0.0.1", 200), ("evil.example.org", 421)):
            link = http.client.HTTPSConnection("127.0.0.1", port, context=trusting)
            shown = {"Host": f"{name}:{port}", "Origin": f"https://{name}:{port}"}
            link.request("POST", "/session", token, shown)
            assert link.getresponse().status == status, name
            link.close()
    seen = []
    monkeypatch.setattr(told, "_recorded", lambda path: None)
    monkeypatch.setattr(told, "serve", lambda *all_of_it, can: seen.append(all_of_it))
    replay = ("station", "--replay", "x.mcap", "--port", "0", "--host", "0.0.0.0")
    assert cohelm(*replay, "--tls-cert", certificate, "--tls-key", key).code == 0
    (given,) = seen
    there = Server(*given)
    assert there.address.startswith(f"https://{NAME}:")
    there._listener.close()


def test_errors_in_a_certificate_are_reported_before_anything_starts(cohelm, tmp_path):
    _, certificate, key = signed(tmp_path)
    replay = ("station", "--replay", "x.mcap")
    other = tmp_path / "other"
    other.mkdir()
    _, _, wrong = signed(other, b"secret")
    refused(cohelm(*replay, "--tls-cert", certificate, "--tls-key", wrong), "password")
    refused(cohelm(*replay, "--tls-cert", certificate), "not the key of the certificate")
    refused(cohelm(*replay, "--tls-cert", key, "--tls-key", key), "holds no certificate")
    refused(cohelm(*replay, "--tls-cert", "none.pem"), "No such file")
    refused(cohelm(*replay, "--tls-key", key), "--tls-cert FILE")
    refused(cohelm(*replay, "--tls", "--without-tls"), "leave one of them out")
    key.chmod(0o644)
    refused(cohelm(*replay, "--tls-cert", certificate, "--tls-key", key), "chmod 600")


@pytest.mark.parametrize("days", [-3, 3])
def test_a_certificate_that_is_over_is_said_to_be(cohelm, monkeypatch, tmp_path, days):
    from cohelm.cli import station as told

    monkeypatch.setattr(told, "_recorded", lambda path: None)
    monkeypatch.setattr(told, "serve", lambda *_, **__: None)
    _, certificate, key = signed(tmp_path, days=days)
    said = cohelm(
        "station", "--replay", "x.mcap", "--tls-cert", certificate, "--tls-key", key
    )  # fmt: skip
    assert said.code == 0, said.err
    assert ("was valid until" in said.err) is (days < 0)


def test_a_second_ctrl_c_has_no_further_effect():
    """uvicorn would break its end off, which shows as a traceback."""
    server = Server(lambda _: None, port=0)
    server._server.handle_exit(signal.SIGINT, None)
    server._server.handle_exit(signal.SIGINT, None)
    assert server._server.should_exit
    assert not server._server.force_exit
    server._listener.close()
