"""Another user of the same machine gets only the empty page; tested as uid 65534."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from cohelm.core.errors import CohelmError
from cohelm.link.local_credentials import credentials_of_drive, shared_credentials
from cohelm.station.serve import Server
from tests.link.ends import clients
from tests.station.bare import Bare
from tests.station.servers import served
from tests.station.visitor import session

NOBODY = 65534
pytestmark = [
    pytest.mark.xdist_group("realtime"),
    pytest.mark.skipif(os.geteuid() != 0, reason="becomes another user, which root alone may"),
]
TRIES = """
import encodings.idna, glob, http.client, json, os, pathlib, socket, sys, time
from cohelm.core.errors import CohelmError
from cohelm.core.types import Stick
from cohelm.link import local_credentials
from cohelm.link.keys import pair_here
from cohelm.link.messages import Command, RequestKind, Device
from cohelm.link.station_bulk import StationBulk
from cohelm.link.station_end import StationEnd
own = pair_here("nobody")[1]
os.setgroups([])
os.setgid(65534)
os.setuid(65534)  # with it goes every capability; what is imported stays
web, link, keys, pid = (int(a) if a.isdigit() else a for a in sys.argv[1:])
got = {"uid": os.geteuid()}

def status(method, path, body=None, **headers):
    to = http.client.HTTPConnection("127.0.0.1", web, timeout=30)
    headers = {"Origin": f"http://127.0.0.1:{web}", **headers}
    to.request(method, path, body, headers)
    answer = to.getresponse()
    answer.read()
    return answer.status

guess = {"Authorization": "Bearer " + "A" * 43, "Cookie": "cohelm=" + "A" * 43}
socket_asked = {"Connection": "Upgrade", "Upgrade": "websocket", "Sec-WebSocket-Version": "13",
                "Sec-WebSocket-Key": "AAAAAAAAAAAAAAAAAAAAAA=="}
got["page"] = status("GET", "/")
got["socket"] = status("GET", "/ws", **socket_asked)
got["guessed socket"] = status(
    "GET", "/ws", **socket_asked, **{"Sec-WebSocket-Protocol": "cohelm, " + "A" * 43})
got["session"] = status("GET", "/session", **guess)
got["token"] = [status("POST", "/session", "guess") for _ in range(20)][-1]
got["record"] = status("GET", "/records/run.mcap", **guess)
got["ticket"] = status("POST", "/records/run.mcap", **guess)
got["guessed ticket"] = status("GET", "/records/run.mcap?ticket=" + "A" * 43)

def read(*paths):
    found = []
    for path in paths:
        try:
            found.append(pathlib.Path(path).read_bytes())
        except OSError:
            pass
    return found

here = glob.glob(f"{keys}/**", recursive=True)
got["keys"] = len(read(f"{keys}/drive/{link}/station.key", *here))
seen = read(f"/proc/{pid}/cmdline", f"/proc/{pid}/environ", f"/proc/{pid}/mem")
seen += read(*glob.glob(f"/proc/{pid}/fd/*"), *glob.glob("/tmp/*.txt"))
got["seen"] = b"\\n".join(seen).decode(errors="replace")

os.environ["COHELM_KEYS"] = keys
try:
    local_credentials.credentials_of_drive()
    got["borrowed"] = True
except (CohelmError, PermissionError) as error:
    got["borrowed"] = False
end = StationEnd(own, "127.0.0.1", link)
with end, StationBulk(own, "127.0.0.1", link, end.session) as bulk:
    end.ask(RequestKind.TAKE)
    until = time.monotonic() + 2.0
    while time.monotonic() < until:
        end.steer(Command(Stick(1.0, 0.0), True, True, Device.SCRIPT, 1.0))
        time.sleep(0.05)
    got["link"] = end.status() is not None or end.state().connected
    got["bulk"] = bulk.connected
with socket.create_connection(("127.0.0.1", link)) as plain:
    plain.sendall(b"GET / HTTP/1.0\\r\\n\\r\\n")
    plain.settimeout(5.0)
    try:
        got["plain"] = len(plain.recv(100))
    except OSError:
        got["plain"] = 0
print(json.dumps(got))
"""


@pytest.fixture
def bare(tmp_path: Path) -> Iterator[Bare]:
    (tmp_path / "run.mcap").write_bytes(b"x")
    with Bare(tmp_path) as made:
        yield made


@pytest.fixture
def server(bare: Bare) -> Iterator[Server]:
    with served(bare.connect) as made:
        yield made


def as_nobody(*arguments: object) -> dict[str, object]:
    """What somebody else got, trying all he can."""
    done = subprocess.run(
        [sys.executable, "-c", TRIES, *map(str, arguments)], cwd="/", env={}, capture_output=True,
        text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_another_user_of_this_machine_gets_nothing_but_the_empty_page(
    bare: Bare, server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for above in (tmp_path, *tmp_path.parents[:2]):
        above.chmod(0o755)  # the folder of the tests would keep him out by itself
    monkeypatch.setenv("COHELM_KEYS", str(tmp_path / "keys"))
    shown = session(server)
    stick = bare.keys
    with shared_credentials(stick, "127.0.0.1", bare.port):
        got = as_nobody(server.port, bare.port, tmp_path / "keys", os.getpid())
    assert got.pop("uid") == NOBODY
    seen = str(got.pop("seen"))
    assert server.token not in seen
    assert shown not in seen
    assert got == {
        "page": 200, "socket": 403, "guessed socket": 403, "session": 401, "token": 429,
        "record": 401, "ticket": 401, "guessed ticket": 401, "keys": 0, "borrowed": False,
        "link": False, "bulk": False, "plain": 0,
    }  # fmt: skip
    assert bare.end.driver == 0
    assert clients(bare.end) == {}
    assert not server.station.operators


def test_drive_keys_of_another_user_are_refused(
    bare: Bare, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A folder of his own making, or his files in one of ours, and he drives our stick."""
    monkeypatch.setenv("COHELM_KEYS", str(tmp_path / "keys"))
    with shared_credentials(bare.keys, "127.0.0.1", bare.port):
        for path in (tmp_path / "keys", tmp_path / "keys" / "drive" / str(bare.port) / "address"):
            os.chown(path, NOBODY, NOBODY)
            with pytest.raises(CohelmError, match="belongs to another user"):
                credentials_of_drive()
            os.chown(path, 0, 0)
