"""Every run of recorded hands is found, whatever its number, and none is dropped in silence."""

import pytest

from cohelm.core.errors import CohelmError
from cohelm.study.campaign import hands

HEAD = "run,t,joy_v,joy_w\n"


def rows(run, n=20):
    return "".join(f"{run},{0.1 * k:.1f},0.5,0.1\n" for k in range(n))


@pytest.mark.parametrize("runs", [("0", "1", "2"), ("1", "2", "3"), ("4", "7", "9"), ("a", "b")])
def test_runs_are_read_by_the_names_the_file_gives_them(tmp_path, runs):
    (tmp_path / "log.csv").write_text(HEAD + "".join(rows(run) for run in runs))
    found = hands.read(tmp_path)
    assert found.names == tuple(f"log.csv#{run}" for run in runs)
    assert len(found.recordings) == len(runs)
    assert found.left_out == ()


def test_a_run_that_can_not_be_read_is_named_and_the_others_are_kept(tmp_path):
    (tmp_path / "log.csv").write_text(HEAD + rows(0) + "1,0.0,7.5,0\n" + rows(2))
    found = hands.read(tmp_path)
    assert found.names == ("log.csv#0", "log.csv#2")
    (said,) = found.left_out
    assert "7.5" in said


def test_too_many_runs_are_reported_and_not_cut_silently(tmp_path):
    (tmp_path / "log.csv").write_text(HEAD + "".join(rows(k, 2) for k in range(101)))
    with pytest.raises(CohelmError, match="no stick file in it can be read"):
        hands.read(tmp_path)
