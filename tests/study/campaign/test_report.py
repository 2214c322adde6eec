"""The report says what is to be seen: legend, axes, whole rooms, contacts by their kind."""

import io
import os
import re
import time
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from cohelm.core.errors import CohelmError
from cohelm.core.row import ROW
from cohelm.core.trace import Trace
from cohelm.pilot.behavior import EVADING
from cohelm.sim.judge import FAR
from cohelm.study.campaign.about import about, html
from cohelm.study.campaign.episode import Episode, EpisodeGoal
from cohelm.study.campaign.pictures import drawn, strip
from cohelm.study.campaign.report import by_kind, caption, outcome, table, write, written
from cohelm.study.campaign.result import NOT_DRIVEN
from cohelm.study.campaign.suites import NAMES, suite
from tests.record.runs import lab

CAME = NOT_DRIVEN._replace(
    suite="lab", law="guard", episode=3, kind="mover late", arrived=True, duration_s=31.24,
    tracking_rms=0.1, min_clearance_m=0.0123, min_clearance_moving_m=0.0123,
    min_clearance_at_s=3.0, nearest="cone_1",
)  # fmt: skip


def drive(walls=None):
    setup = lab()
    if walls is not None:
        setup = replace(setup, obstacles=setup.obstacles._replace(walls=walls))
    rows = np.zeros(200, dtype=ROW)
    rows["t"] = 0.02 * np.arange(200)
    rows["x"], rows["clearance"] = 0.01 * np.arange(200), 0.5
    discs = np.zeros((200, 2, 6))
    discs[:, 0, :2], discs[:, 1, 0] = (2.0, 2.0), np.linspace(0.0, 1.0, 200)
    case = Episode("lab", 3, "", setup, EpisodeGoal(5.0, 0.0, 0.1))
    return case, Trace(rows, np.zeros((200, 2)), discs, ("a", "b"), 0.02)


def figure(walls=None):
    return drawn(*drive(walls), CAME)


def test_the_whole_room_is_shown_with_units_at_its_axes_and_a_legend():
    drawing = figure()
    above, below = drawing.axes
    (left, right), (low, high) = above.get_xlim(), above.get_ylim()
    for x1, y1, x2, y2 in lab().obstacles.walls:
        assert left < min(x1, x2)
        assert max(x1, x2) < right
        assert low < min(y1, y2)
        assert max(y1, y2) < high
    assert (above.get_xlabel(), above.get_ylabel()) == ("x [m]", "y [m]")
    assert below.get_xlabel() == "time [s]"
    assert [t.get_text() for t in below.get_legend().get_texts()] == [
        "clearance [m], drawn from −0.5 to 1",
        "speed [m/s]",
    ]
    said = " ".join(text.get_text() for text in drawing.legends[0].get_texts())
    for word in ("path", "least clearance", "reference", "goal", "wall", "at rest", "mover"):
        assert word in said
    drawing.canvas.draw()
    assert drawing.legends[0].get_window_extent().width <= drawing.bbox.width


def test_an_evasion_is_shown_where_it_was_tightest():
    case, trace = drive()
    assert strip(case, trace) is None
    trace.rows["behavior"][100:150], trace.rows["clearance"][110] = EVADING, 0.1
    drawing = strip(case, trace)
    assert drawing is not None
    wide, high = Image.open(io.BytesIO(drawing)).size
    assert wide > 3 * high  # frames in a row, as many as there was time for
    trace.rows["behavior"] = EVADING
    short = trace.until(3)
    assert strip(case, short) is not None


def test_of_a_world_that_is_very_large_the_drive_is_shown():
    above, _ = figure(np.array([[-500.0, 0.0, 500.0, 0.0]])).axes
    assert above.get_xlim()[1] - above.get_xlim()[0] < 10.0


@pytest.mark.parametrize(
    ("moving", "standing", "said"),
    [
        (0, 0, "no contact"),
        (1, 0, "1 moving contact"),
        (0, 2, "2 standing contacts"),
        (2, 1, "2 moving contacts, 1 standing contact"),
    ],
)
def test_a_caption_names_contacts_moving_or_standing(moving, standing, said):
    row = CAME._replace(contacts_moving=moving, contacts_standing=standing)
    assert caption(row) == (
        f"guard/3 (mover late): {said}, arrived, 31.2 s; "
        "least clearance while moving 0.0123 m at 3.0 s (cone_1)"
    )


def test_the_clearance_in_a_caption_is_that_of_its_moment():
    walked_into = CAME._replace(contacts_standing=1, min_clearance_m=-0.4, kind="")
    assert caption(walked_into) == (
        "guard/3: 1 standing contact, arrived, 31.2 s; "
        "least clearance while moving 0.0123 m at 3.0 s (cone_1)"
    )
    stood = CAME._replace(
        min_clearance_moving_m=FAR, min_clearance_m=-0.02, tracking_rms=float("nan"), nearest=""
    )
    assert caption(stood).endswith(": no contact, 31.2 s; least clearance -0.0200 m at 3.0 s")


def test_a_full_disk_leaves_no_half_of_a_report(tmp_path, monkeypatch):
    def full(_):
        raise OSError(28, "No space left on device")

    found = outcome(suite("random", 1, None), ("guard",), [CAME._replace(fault="broken")], {})
    page = write(found, tmp_path, lambda *_: None)
    whole = page.read_text()
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(CohelmError, match=r"No space left.*free some space"):
        write(found, tmp_path, lambda *_: None)
    assert page.read_text() == whole
    assert sorted(file.name for file in tmp_path.iterdir()) == ["report.html", "summary.json"]


def test_a_report_is_made_again_only_where_rows_are_newer(tmp_path):
    assert written(tmp_path) is None
    found = outcome(suite("random", 1, None), ("guard",), [CAME._replace(fault="broken")], {})
    (tmp_path / "rows").mkdir()
    (tmp_path / "rows" / "part-000001.parquet").touch()
    page = write(found, tmp_path, lambda *_: None)
    assert written(tmp_path) == page
    os.utime(tmp_path / "rows" / "part-000001.parquet", (later := time.time() + 9.0, later))
    assert written(tmp_path) is None


def test_ends_of_a_spread_are_told_apart_where_they_are_negative():
    rows = [CAME._replace(closest_mover_m=far) for far in (-0.5, 0.2, 1.0)]
    _, lines = table(outcome(suite("random", 1, None), ("guard",), rows, {}))
    assert dict(lines)["closest to a mover [m]"] == "0.20 (-0.50 to 1.00)"


def test_where_nothing_was_near_no_clearance_is_said_that_was_not_measured():
    """As of a robot that never moved."""
    rows = [CAME._replace(min_clearance_moving_m=FAR, min_clearance_m=-0.2)]
    found = outcome(suite("random", 1, None), ("guard",), rows, {})
    assert dict(table(found)[1])["smallest clearance while moving [m]"] == "2 or more"
    assert by_kind(found)[1][0][-1] == "2 or more"
    assert dict(table(found)[1])["closest: smallest clearance of all [m]"] == "-0.2000"


def test_how_often_each_kind_stayed_untouched_is_told():
    rows = [
        CAME._replace(kind="easy", contacts_standing=0),
        CAME._replace(kind="easy", contacts_moving=1, contacts_standing=2, episode=1),
        CAME._replace(kind="hard", contacts_standing=1, episode=2),
    ]
    headings, lines = by_kind(outcome(suite("movers", 1, None), ("guard",), rows, {}))
    at = headings.index("untouched")
    assert {line[0]: line[at] for line in lines} == {"easy": "1", "hard": "0"}


@pytest.mark.parametrize("faulty", [True, False])
def test_a_report_has_pictures_or_does_not_speak_of_them(tmp_path, monkeypatch, faulty):
    monkeypatch.setattr("cohelm.study.campaign.report._figure", lambda *_: "<figure></figure>")
    rows = [CAME._replace(fault="broken" if faulty else "")]
    found = outcome(suite("random", 1, None), ("guard",), rows, {})
    page = write(found, tmp_path, lambda *_: None).read_text()
    assert ("Worst episodes" in page) is ("<figure>" in page) is not faulty


@pytest.mark.parametrize("commit", ["0123456789ab-dirty", None])
def test_a_report_says_by_which_code_it_was_driven_and_when(tmp_path, commit):
    origin = {
        "version": "1.2.3", "commit": commit, "began": "2026-11-28T07:08:12Z", "code": "c0de",
        "own": {"my:law": "0b5e"},
    }  # fmt: skip
    rows = [CAME._replace(fault="broken")]
    found = outcome(suite("random", 1, None), ("guard", "my:law"), rows, origin)
    assert found.as_dict().items() >= origin.items()
    page = write(found, tmp_path, lambda *_: None).read_text()
    for word in ("2026-11-28T07:08:12Z", "cohelm 1.2.3", "c0de", "my:law: code 0b5e"):
        assert word in page
    assert (f"commit {commit}" in page) == (commit is not None)


@pytest.mark.parametrize("name", NAMES)
def test_every_suite_is_described_in_sentences_and_not_by_its_code(name):
    said = html(about(name, ("guard", "my.package:law"), None))
    assert said.startswith("<p>")
    assert not re.search(r"`|\*|\b[A-Z]{5,}\b|\n- ", said)
