"""Many robots at once are many runs, whatever the number of threads."""

import dataclasses

import numpy as np
import pytest

from cohelm.core.errors import CohelmError
from cohelm.core.types import Pose
from cohelm.law.barrier import HEADING, SHAPED
from cohelm.law.gains import Gains
from cohelm.robot.limits import unlimited
from cohelm.sim.batch import LANES, WORTH_IT, Batch, run_batch
from cohelm.sim.hand import Operator, replay
from cohelm.sim.run import run
from cohelm.sim.world import world
from tests.oracle import lab
from tests.sim.runs import LAB, SALLY, WALLS, bodies, lab_run

N = 8
SCENES = [(bodies()[: i % 5], WALLS[: i % 4]) for i in range(N)]
HANDS = [
    (np.array([1.0, 3.0 + i]), np.array([0.1 * i, 0.0]), np.array([0.05 * i, 0.0]))
    for i in range(N)
]
GAINS = [
    Gains(k_cbf=1.2 + 0.1 * i, joint=i % 2 == 0, true_sign=i % 3 > 0, barrier=i != 5)
    for i in range(N)
]
OPERATORS = [Operator(active=i % 2 == 1, tremor=0.02 * i) for i in range(N)]
SEEDS = np.arange(N) + 11


def starts():
    rng = np.random.default_rng(5)
    return np.array(lab.START) + rng.uniform(-0.2, 0.2, (N, 3))


def batch(**changes):
    given = Batch(
        starts=starts(), reference=LAB, outline=lab.SALLY, limits=SALLY, gains=GAINS,
        worlds=world(*SCENES), hands=replay(*HANDS), operators=OPERATORS, seeds=SEEDS,
        delay=0.05, duration=20.0,
    )  # fmt: skip
    return dataclasses.replace(given, **changes)


def alone(i, duration=20.0):
    """The run of robot i of `batch()`."""
    return run(lab_run(
        start=Pose(*starts()[i]), gains=GAINS[i], around=world(SCENES[i]), limits=SALLY,
        hands=replay(HANDS[i]), operator=OPERATORS[i], seed=int(SEEDS[i]), delay=0.05,
        duration=duration, names=lab.NAMES[: i % 5],
    ))  # fmt: skip


def test_each_robot_of_a_batch_does_what_it_does_alone():
    scored = run_batch(batch())
    for i, out in enumerate(scored):
        trace = alone(i)
        rows = trace.rows
        h = trace.h.min() if trace.h.size and GAINS[i].barrier else np.inf
        told = {
            "e_p_max": rows["e_p"].max(), "e_p_end": rows["e_p"][-1],
            "h_min": h,
            "clearance_min": rows["clearance"].min(),
            "v_max": np.abs(rows["v"]).max(), "omega_max": np.abs(rows["omega"]).max(),
        }  # fmt: skip
        for name, value in told.items():
            assert out[name] == value, (i, name)
        sums = {
            "e_p_rms": np.sqrt(np.mean(rows["e_p"] ** 2)),
            "path": np.abs(rows["applied_v"]).sum() * 0.01,
            "human": np.mean(1.0 - rows["authority_x"]),
        }
        for name, value in sums.items():  # numpy adds up in another order
            assert out[name] == pytest.approx(value, rel=1e-12), (i, name)
        assert out["saturated"] == rows["saturated"].sum()
        assert out["shaped"] == (rows["verdict"] == SHAPED).sum()
        headed = (rows["verdict"] == SHAPED) & (rows["culprit"] == HEADING)
        assert out["heading"] == headed.sum()
        assert out["invalid"] == 0


def test_a_robot_of_a_batch_ends_where_it_ends_alone():
    scored = run_batch(batch())
    for i, out in enumerate(scored):
        last = alone(i, duration=20.01).rows[-1]  # where the step before it led
        assert (out["x"], out["y"], out["psi"]) == (last["x"], last["y"], last["psi"])


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_the_number_of_threads_and_neighbours_changes_nothing(threads):
    few, times = run_batch(batch(duration=5.0)), 2 * LANES // N + 1  # more than two groups
    many = batch(
        starts=np.tile(starts(), (times, 1)), gains=GAINS * times, worlds=world(*SCENES * times),
        hands=replay(*HANDS * times), operators=OPERATORS * times, seeds=np.tile(SEEDS, times),
        duration=5.0,
    )  # fmt: skip
    assert run_batch(many, threads).tobytes() == np.tile(few, times).tobytes()


@pytest.mark.parametrize("few", [1, WORTH_IT - 1, WORTH_IT])
def test_a_few_robots_do_what_they_do_among_many(few):
    alone = batch(
        starts=starts()[:few], gains=GAINS[:few], worlds=world(*SCENES[:few]),
        hands=replay(*HANDS[:few]), operators=OPERATORS[:few], seeds=SEEDS[:few],
    )  # fmt: skip
    assert run_batch(alone).tobytes() == run_batch(batch())[:few].tobytes()


def test_the_order_of_the_robots_changes_nothing():
    back = slice(None, None, -1)
    turned_round = batch(
        starts=starts()[back], gains=GAINS[back], worlds=world(*SCENES[back]),
        hands=replay(*HANDS[back]), operators=OPERATORS[back], seeds=SEEDS[back],
    )  # fmt: skip
    assert run_batch(turned_round)[back].tobytes() == run_batch(batch()).tobytes()


def test_what_is_given_once_is_shared_by_all():
    shared = batch(
        starts=np.tile(lab.START, (3, 1)), gains=GAINS[:1], worlds=world(SCENES[4]),
        hands=replay(), operators=[Operator()], seeds=np.zeros(1, dtype=np.int64),
        limits=unlimited(lab.TRACK),
    )  # fmt: skip
    a, b, c = run_batch(shared)
    assert a.tobytes() == b.tobytes() == c.tobytes()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"gains": GAINS[:3]}, "8 robots needs 1 or 8 gains, got 3"),
        ({"seeds": np.arange(9)}, "1 or 8 seeds, got 9"),
        ({"worlds": world(*SCENES[:2])}, "1 or 8 worlds, got 2"),
        ({"hands": replay(*HANDS[:7])}, "1 or 8 hands, got 7"),
        ({"operators": []}, "1 or 8 operators, got 0"),
    ],
)
def test_a_batch_with_numbers_of_rows_that_disagree_is_refused(changes, words):
    with pytest.raises(CohelmError, match=words):
        run_batch(batch(**changes))
