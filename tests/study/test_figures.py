"""The picture of any one run, with and without obstacles, walls or a person."""

import math

import pytest
from PIL import Image

from cohelm.scenario import build, load
from cohelm.sim.run import run
from cohelm.study.controlled import RunResult
from cohelm.study.figures import draw_run, figure_run
from tests.few import first


def made(name, *changes):
    setup = build.setup(load.scenario(name, ["simulation.duration_s=6", *changes]))
    return RunResult(setup, run(setup))


@pytest.mark.parametrize(
    ("name", "changes"),
    first(
        [
            ("lab-shared", ()),
            ("lab-avoid", ("obstacles=[]", "walls_m=[]")),
            ("lab-track", ("walls_m=[]",)),
            ("minimal", ()),
        ],
        1,
    ),
)
def test_any_run_has_its_picture(tmp_path, name, changes):
    png, svg = draw_run(made(name, *changes), tmp_path, name)
    with Image.open(png) as image:
        assert image.convert("RGB").getcolors(50) is None  # there are more
    assert "E_P" in svg.read_text(encoding="utf-8")


def said(figure):
    return " ".join(text.get_text() for text in figure.texts)


def test_a_collision_is_named_in_the_title():
    run_over = made("lab-avoid", "law.filter=none", "obstacles.0.center_m=[0, 0.2]")
    assert run_over.metrics.contact
    assert "IN CONTACT" in said(figure_run(run_over))


def test_the_title_has_the_clearance_to_the_millimetre_that_is_kept():
    run = made("lab-avoid")
    kept = math.floor(1000.0 * run.metrics.min_clearance_m)
    assert kept % 10
    assert f"outline 0.{kept:03d} m clear" in said(figure_run(run))


def test_a_run_that_does_not_reach_the_end_of_its_reference_is_reported_so():
    beside = made("lab-track", "start.y_m=-2.5", "simulation.duration_s=0.2")
    assert "DOES NOT END where" in said(figure_run(beside))
    assert "DOES NOT END where" in said(figure_run(made("lab-track")))  # cut short, on its way
    whole = made("lab-track", "simulation.duration_s=null")
    assert "ends where its reference ends" in said(figure_run(whole))
