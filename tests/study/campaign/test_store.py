"""A campaign's folder: parts are whole or not there, rows are there once, folders are one's own."""

import json
import os

import pytest

from cohelm.core.errors import CohelmError
from cohelm.study.campaign import store
from cohelm.study.campaign.result import NOT_DRIVEN
from cohelm.study.campaign.store import Store, read_rows

PLAN = {"suite": "random", "laws": ["guard"], "seed": 1, "n": 9, "data": None, "code": "a"}


def row(episode, law="guard", **changes):
    return NOT_DRIVEN._replace(suite="random", law=law, episode=episode, **changes)


def numbers(folder):
    return sorted(k for _, k in read_rows(folder))


def test_rows_come_back_as_they_went_in(tmp_path):
    rows = [row(0, arrived=True, stick=[0.1, -1.0 / 3.0], min_clearance_m=0.1 + 0.2), row(1)]
    with Store(tmp_path, PLAN) as s:
        s.add(rows)
    back = read_rows(tmp_path)
    assert back["guard", 0]._replace(**dict.fromkeys(("score",), 0.0))[:6] == rows[0][:6]
    assert back["guard", 0].stick == rows[0].stick
    assert back["guard", 0].min_clearance_m == rows[0].min_clearance_m
    assert repr(back["guard", 1]) == repr(rows[1])


def test_a_row_that_is_there_is_not_written_or_counted_again(tmp_path):
    with Store(tmp_path, PLAN) as s:
        s.add([row(0), row(1)])
        s.add([row(1, arrived=True), row(2)])
    assert numbers(tmp_path) == [0, 1, 2]
    assert not read_rows(tmp_path)["guard", 1].arrived
    with Store(tmp_path, PLAN) as s:
        s.add([row(2), row(0)])
    assert len(list((tmp_path / "rows").iterdir())) == 2


def test_the_same_episode_under_two_laws_is_two_rows(tmp_path):
    with Store(tmp_path, PLAN) as s:
        s.add([row(0), row(0, "paper")])
    assert sorted(read_rows(tmp_path)) == [("guard", 0), ("paper", 0)]


def test_half_a_part_is_no_part_and_is_swept_away(tmp_path):
    with Store(tmp_path, PLAN) as s:
        s.add([row(0)])
    (tmp_path / "rows" / "part-000002.parquet.part").write_bytes(b"PAR1 half")
    with Store(tmp_path, PLAN) as s:
        assert sorted(s.rows) == [("guard", 0)]
        s.add([row(1)])
    assert sorted(p.name for p in (tmp_path / "rows").iterdir()) == [
        "part-000001.parquet", "part-000002.parquet"]  # fmt: skip


def test_a_copy_of_a_part_beside_it_changes_nothing(tmp_path):
    with Store(tmp_path, PLAN) as s:
        s.add([row(0)])
    part = tmp_path / "rows" / "part-000001.parquet"
    part.with_name("part-000001 (copy).parquet").write_bytes(part.read_bytes())
    with Store(tmp_path, PLAN) as s:
        s.add([row(1)])
    assert numbers(tmp_path) == [0, 1]
    assert (tmp_path / "rows" / "part-000002.parquet").exists()


def test_a_full_disk_is_reported_and_leaves_what_was_written(tmp_path, monkeypatch):
    def full(_):
        raise OSError(28, "No space left on device")

    with Store(tmp_path, PLAN) as s:
        s.add([row(0)])
        monkeypatch.setattr(os, "fsync", full)
        with pytest.raises(CohelmError, match=r"No space left.*free some space"):
            s.add([row(1)])
    monkeypatch.undo()
    assert numbers(tmp_path) == [0]
    with Store(tmp_path, PLAN) as s:
        s.add([row(1)])
    assert numbers(tmp_path) == [0, 1]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"seed": 2}, r"seed 1 \(requested: 2\)"),
        ({"laws": ["paper", "none"]}, r"laws guard \(requested: paper, none\)"),
        ({"n": 10, "seed": 3}, "seed 1 .*n 9|n 9 .*seed 1"),
        ({"code": "b"}, "another version of this code"),
        ({"own": {"my:law": "b"}}, "another version of your law"),
        ({"code": "b", "own": {"my:law": "b"}}, "another version of this code"),
    ],
)
def test_a_folder_of_another_campaign_is_refused_with_what_differs(tmp_path, change, words):
    with Store(tmp_path, PLAN) as s:
        s.add([row(0)])
    with pytest.raises(CohelmError, match=words) as said, Store(tmp_path, {**PLAN, **change}):
        pass
    assert "--out" in str(said.value)
    assert numbers(tmp_path) == [0]


def test_another_day_or_commit_continues_and_the_folder_says_when_it_began(tmp_path):
    first = PLAN | {"version": "1", "commit": "a", "began": "2026-11-28T07:08:12Z", "own": {}}
    with Store(tmp_path, first):
        pass
    with Store(tmp_path, first | {"version": "2", "commit": "b", "began": "2026-11-29T00:00:00Z"}):
        pass
    made = store.origin(tmp_path)
    assert made == {name: first[name] for name in ("version", "commit", "began", "code", "own")}


def test_two_campaigns_at_once_in_one_folder_are_refused(tmp_path):
    with (
        Store(tmp_path, PLAN),
        pytest.raises(CohelmError, match="another campaign is at work"),
        Store(tmp_path, PLAN),
    ):
        pass


def test_rows_without_a_plan_are_refused(tmp_path):
    with Store(tmp_path, PLAN) as s:
        s.add([row(0)])
    (tmp_path / store.PLAN).unlink()
    with pytest.raises(CohelmError, match=r"no campaign\.json"), Store(tmp_path, PLAN):
        pass


@pytest.mark.parametrize("text", ["[]", "{", "", "[" * 100_000], ids=len)
def test_an_invalid_plan_is_reported(tmp_path, text):
    (tmp_path / store.PLAN).write_text(text)
    with pytest.raises(CohelmError, match="not a campaign's plan"), Store(tmp_path, PLAN):
        pass


def test_a_damaged_part_file_is_named(tmp_path):
    with Store(tmp_path, PLAN) as s:
        s.add([row(0)])
    part = tmp_path / "rows" / "part-000001.parquet"
    table = store.pq.read_table(part)
    no_text = store.pa.array([b"\xff"], store.pa.binary()).view(store.pa.string())
    spoiled = table.set_column(0, table.schema.names[0], no_text)
    for damage in (lambda: store.pq.write_table(spoiled, part),
                   lambda: part.write_bytes(part.read_bytes()[:-20])):  # fmt: skip
        damage()
        with pytest.raises(CohelmError, match=r"part-000001\.parquet: is not a whole Parquet"):
            read_rows(tmp_path)


def test_a_file_in_place_of_the_folder_is_reported(tmp_path):
    (tmp_path / "x").write_text("")
    with pytest.raises(CohelmError, match="can not be made"), Store(tmp_path / "x", PLAN):
        pass


def test_the_plan_is_kept_as_it_was_asked_for(tmp_path):
    with Store(tmp_path, PLAN):
        pass
    assert json.loads((tmp_path / store.PLAN).read_text()) == PLAN
