"""Credentials for a stick on this machine: private, and removed after the drive."""

import stat

import pytest

from cohelm.core.errors import CohelmError
from cohelm.link.keys import home, pair_here
from cohelm.link.local_credentials import credentials_of_drive, shared_credentials


@pytest.fixture(autouse=True)
def place(tmp_path, monkeypatch):
    monkeypatch.setenv("COHELM_KEYS", str(tmp_path / "keys"))


def test_local_credentials_are_complete_and_removed_afterwards():
    _, _, stick = pair_here("station", "stick")
    with shared_credentials(stick, "127.0.0.1", 41000):
        assert credentials_of_drive() == (stick, ("127.0.0.1", 41000))
        for path in (home() / "drive").rglob("*"):
            assert stat.S_IMODE(path.stat().st_mode) & 0o077 == 0
    with pytest.raises(CohelmError, match="no `cohelm drive` runs"):
        credentials_of_drive()


def test_of_several_drives_one_must_be_named():
    _, stick = pair_here("stick")
    _, other = pair_here("stick")
    with (
        shared_credentials(stick, "127.0.0.1", 41000),
        shared_credentials(other, "127.0.0.1", 41001),
    ):
        with pytest.raises(
            CohelmError, match=r"several drives run here.*41000, 127\.0\.0\.1:41001"
        ):
            credentials_of_drive()
        assert credentials_of_drive("127.0.0.1:41001") == (other, ("127.0.0.1", 41001))
        with pytest.raises(CohelmError, match=r"no drive '127\.0\.0\.1:1' runs here"):
            credentials_of_drive("127.0.0.1:1")


def test_credentials_of_a_killed_drive_are_not_used_and_the_next_drive_removes_them():
    _, stick = pair_here("stick")
    with shared_credentials(stick, "127.0.0.1", 41000):
        left = home() / "drive" / "40000"
        left.mkdir()
        (left / "address").write_text("127.0.0.1:40000")
        assert credentials_of_drive()[1][1] == 41000
        with shared_credentials(stick, "127.0.0.1", 41001):
            assert not left.exists()


def test_credentials_that_another_user_may_have_written_are_refused():
    _, stick = pair_here("stick")
    with shared_credentials(stick, "127.0.0.1", 41000):
        for path, mode in [
            (home() / "drive", 0o777), (home() / "drive" / "41000", 0o770),
            (home() / "drive" / "41000" / "address", 0o622),
            (home() / "drive" / "41000" / "robot.pem", 0o666), (home(), 0o777),
        ]:  # fmt: skip
            before = stat.S_IMODE(path.stat().st_mode)
            path.chmod(mode)
            with pytest.raises(CohelmError, match=rf"others may write.*chmod go-w {path}"):
                credentials_of_drive()
            path.chmod(before)
        assert credentials_of_drive()[1][1] == 41000


def test_no_credentials_are_written_to_a_folder_that_others_may_write():
    _, stick = pair_here("stick")
    (home() / "drive").mkdir(parents=True)
    (home() / "drive").chmod(0o777)
    with (
        pytest.raises(CohelmError, match="others may write"),
        shared_credentials(stick, "127.0.0.1", 41000),
    ):
        pass
