"""`reproduce` as a whole: the paper's numbers, and files that say the same every time."""

import json
import math
import re

import numpy as np
import pytest
from PIL import Image

from cohelm.core.errors import CohelmError
from cohelm.record.read import read
from cohelm.study import reproduce as reproducing
from cohelm.study.metrics import measure, wheel_acceleration
from cohelm.study.reproduce import reproduce
from tests.few import first

CONES = ("cone_1", "cone_2", "cone_3")
OBSTACLES = (*CONES, "mover")
FIGURES = (
    "fig06_track_path", "fig07_track_error", "fig08_avoid_path", "fig09_avoid_h",
    "fig10_shared_path", "fig11_shared_authority", "k_cbf_sweep", "overview",
)  # fmt: skip


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    return tmp_path_factory.mktemp("reproduce")


@pytest.fixture(scope="module")
def told():
    return []


@pytest.fixture(scope="module")
def result(out, told):
    return reproduce(out, lambda doing, share: told.append((doing, share)))


@pytest.fixture(scope="module")
def numbers(result):
    return reproducing.numbers(result)


def test_tracking_alone_stays_below_three_centimetres_and_ends_on_the_path(numbers):
    assert numbers["tracking"]["max_pose_error"] <= 0.03
    assert numbers["tracking"]["final_pose_error"] <= 0.001


def test_at_the_labs_own_turns_the_error_settles_within_the_papers_two_seconds(numbers):
    assert numbers["tracking"]["longest_above_settled_s"] < 2.0


def test_a_sudden_heading_error_can_not_settle_faster_than_its_gain_allows(result, numbers):
    # d psi/dt = -sin psi from pi / 2 to 0.02, stepped finely: the heading error by itself
    psi, t = math.pi / 2, 0.0
    while psi > 0.02:
        psi, t = psi - 1e-4 * math.sin(psi), t + 1e-4
    assert numbers["tracking"]["least_settle_s"] == pytest.approx(t, abs=1e-3)
    assert t < numbers["tracking"]["settle_s"] < 20.0
    start = result.recovery.trace.rows[0]
    assert start["e_p"] == pytest.approx(math.pi / 2)


def test_the_barrier_keeps_every_obstacle_at_its_distance(numbers):
    h = numbers["barrier"]["min_h"]
    assert tuple(h) == OBSTACLES
    assert all(h[name] >= 0.14 for name in OBSTACLES)
    assert numbers["barrier"]["min_footprint_clearance_m"] > 0.0


def test_without_the_barrier_the_robot_drives_through_every_cone(numbers):
    h = numbers["barrier"]["min_h_without"]
    assert all(h[name] == pytest.approx(-0.04, abs=1e-3) for name in CONES)
    assert h["mover"] < 0.0


def test_the_barrier_passes_on_the_right_as_its_sign_says(numbers):
    assert set(numbers["barrier"]["passed_on"].values()) == {"right"}


def test_commands_stay_ordinary_with_the_default_k_cbf(numbers):
    v, omega = numbers["barrier"]["max_command"]
    assert v <= 0.8
    assert omega <= 1.5


def test_the_person_leads_where_the_papers_person_did(result, numbers):
    (a, b), (c, d) = numbers["shared"]["human_windows_s"]
    assert (a, b) == (pytest.approx(2.5, abs=1.0), pytest.approx(6.3, abs=1.0))
    assert (c, d) == (pytest.approx(43.2, abs=1.0), pytest.approx(46.6, abs=1.0))
    rows = result.shared.trace.rows
    elsewhere = ~((rows["t"] > a - 0.5) & (rows["t"] < b + 0.5))
    elsewhere &= ~((rows["t"] > c - 0.5) & (rows["t"] < d + 0.5))
    assert (rows["authority_x"][elsewhere] == 1.0).all()
    assert numbers["shared"]["min_auto_authority"] < 0.5


def test_after_the_operator_releases_the_stick_the_robot_returns_to_the_path(result, numbers):
    assert all(t is not None for t in numbers["shared"]["return_s"])
    assert numbers["shared"]["final_pose_error"] < 0.03
    assert numbers["shared"]["min_h"] > 0.1


def test_with_limits_on_no_command_jumps_more_than_the_wheels_can(result):
    wheels = result.wheels
    assert set(result.limited) == {"track", "avoid", "shared", "recovery"}
    for run in result.limited.values():
        jump = wheel_acceleration(run.trace, wheels.track)
        assert jump <= wheels.wheel_acceleration * (1.0 + 1e-9)


def test_the_sweep_shows_where_the_robot_creeps_and_requests_too_much(numbers):
    sweep = {trial["k_cbf"]: trial for trial in numbers["k_cbf_sweep"]}
    assert min(sweep) == 0.25
    assert max(sweep) == 2.0
    assert len(sweep) >= 12
    assert sweep[0.25]["min_h"] < 0.02
    assert sweep[0.25]["longest_stall_s"] > 5.0
    assert sweep[0.25]["max_speed_mps"] > 4.0
    assert sweep[1.0]["min_h"] < 0.03
    assert sweep[1.5]["min_h"] >= 0.14
    assert sweep[1.5]["longest_stall_s"] == 0.0
    assert all(trial["reached"] for trial in numbers["k_cbf_sweep"])


def test_the_json_file_is_what_was_returned(out, numbers):
    text = (out / "reproduce.json").read_text(encoding="utf-8")
    assert json.loads(text) == numbers
    assert "NaN" not in text
    assert "Infinity" not in text


def test_the_table_sets_every_finding_beside_the_paper(result):
    rows = reproducing.table(result)
    assert len(rows) >= 15
    assert all(len(row) == 3 and all(row) for row in rows)


def test_progress_goes_forward_to_the_end(result, told):
    shares = [share for _, share in told]
    assert shares == sorted(shares)
    assert 0.0 <= shares[0]
    assert told[-1] == ("done", 1.0)


@pytest.mark.parametrize("name", first(FIGURES))
def test_every_figure_is_a_picture_and_small(out, result, name):
    png = out / f"{name}.png"
    assert png.stat().st_size < 300_000
    with Image.open(png) as image:
        colours = np.unique(np.asarray(image.convert("RGBA")).view(np.uint32))
    assert len(colours) > 50  # a blank one has one, empty axes a few greys
    svg = (out / f"{name}.svg").read_text(encoding="utf-8")
    assert len(re.findall(r"<text", svg)) > 5  # text stays text
    assert "dc:date" not in svg


def test_the_summary_shows_table_and_pictures(out, result):
    text = (out / "summary.md").read_text(encoding="utf-8")
    for name in re.findall(r"!\[.*?\]\((.*?)\)", text):
        assert (out / name).exists()
    assert all(row[0] in text for row in reproducing.table(result))


def test_a_record_scores_as_the_run_it_came_from(out, result):
    again = measure(read(out / "records" / "shared.mcap"))
    assert again == result.shared.metrics


@pytest.mark.slow
def test_a_second_time_the_same_bytes_are_written(out, result):
    names = ("reproduce.json", "summary.md", "fig08_avoid_path.svg", "fig10_shared_path.png")
    before = {name: (out / name).read_bytes() for name in names}
    reproduce(out)
    assert {name: (out / name).read_bytes() for name in names} == before


def test_a_folder_that_can_not_be_made_is_reported_in_one_sentence(tmp_path):
    taken = tmp_path / "a-file"
    taken.write_text("in the way")
    with pytest.raises(CohelmError, match=r"can not be made \(.*\): choose another with --out"):
        reproduce(taken / "out")
