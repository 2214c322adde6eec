"""Keys that other users may have read or changed are refused."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from cohelm.core.errors import CohelmError
from cohelm.link import keys
from cohelm.link.key_permissions import guarded, make_folder

OTHERS = 65534
as_root = pytest.mark.skipif(os.geteuid() != 0, reason="gives files away, which root alone may")


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """With a robot that lets a station in, and this station installed."""
    monkeypatch.setenv("COHELM_KEYS", str(tmp_path / "above" / "keys"))
    keys.robot("sally")
    keys.pair("anna", tmp_path / "anna.pair")
    keys.install(tmp_path / "anna.pair")
    return tmp_path / "above" / "keys"


def whom(home: Path, path: str) -> None:
    """What reads this path."""
    keys.station() if path.startswith("station") else keys.robot()


ALL = [
    ".", "robot", "robot/stations", "robot/stations/anna.pem", "robot/robot.key", "robot/robot.pem",
    "station/sally", "station/sally/robot.pem", "station/sally/station.key",
    "station/sally/station.pem",
]  # fmt: skip


@pytest.mark.parametrize("path", ALL)
@pytest.mark.parametrize("who", [0o020, 0o002])
def test_keys_and_stations_where_others_may_write_are_refused(
    home: Path, path: str, who: int
) -> None:
    whom(home, path)
    there = home / path
    there.chmod(stat.S_IMODE(there.stat().st_mode) | who)
    with pytest.raises(CohelmError, match=rf"others may write to the .*chmod go-w {there}"):
        whom(home, path)
    assert [name for name, _ in keys.stations()] == ["anna"]  # it can be looked through


@as_root
@pytest.mark.parametrize("path", ALL)
def test_keys_and_stations_of_another_user_are_refused(home: Path, path: str) -> None:
    there = home / path
    os.chown(there, OTHERS, OTHERS)
    with pytest.raises(CohelmError, match=f"belongs to another user .*chown {os.geteuid()} "):
        whom(home, path)


@pytest.mark.parametrize("path", ALL[1:])
def test_a_symbolic_link_below_the_keys_is_not_followed(
    home: Path, tmp_path: Path, path: str
) -> None:
    there, elsewhere = home / path, tmp_path / "elsewhere"
    there.rename(elsewhere)
    there.symlink_to(elsewhere)
    with pytest.raises(CohelmError, match="is a symbolic link"):
        whom(home, path)


def test_the_key_folder_may_be_a_symbolic_link_and_its_target_is_checked(
    home: Path, tmp_path: Path
) -> None:
    elsewhere = tmp_path / "elsewhere"
    home.rename(elsewhere)
    home.symlink_to(elsewhere)
    assert keys.robot().name == "sally"
    elsewhere.chmod(0o777)
    with pytest.raises(CohelmError, match="others may write"):
        keys.robot()


def test_a_key_folder_that_others_may_replace_is_refused(home: Path) -> None:
    home.parent.chmod(0o777)
    with pytest.raises(CohelmError, match="anybody may rename what is in"):
        keys.robot()
    home.parent.chmod(0o1777)  # as /tmp is
    assert keys.robot().name == "sally"


def test_new_folders_are_private_with_any_umask(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COHELM_KEYS", str(tmp_path / "config" / "cohelm" / "keys"))
    before = os.umask(0)
    try:
        keys.robot("sally")
        keys.pair("anna", tmp_path / "anna.pair")
    finally:
        os.umask(before)
    made = [tmp_path / "config", *(tmp_path / "config").rglob("*"), tmp_path / "anna.pair"]
    assert len(made) == 9
    assert [path for path in made if path.stat().st_mode & 0o077] == []


def test_no_key_is_written_where_others_may_write(home: Path, tmp_path: Path) -> None:
    (home / "robot" / "stations").chmod(0o777)
    with pytest.raises(CohelmError, match="others may write"):
        keys.pair("ben", tmp_path / "ben.pair")
    assert [name for name, _ in keys.stations()] == ["anna"]
    assert not (tmp_path / "ben.pair").exists()
    keys.unpair("anna")  # but whom one did not let in can be shut out


def test_missing_files_and_folders_are_accepted(tmp_path: Path) -> None:
    guarded(tmp_path / "none" / "file", within=tmp_path)
    make_folder(tmp_path)
