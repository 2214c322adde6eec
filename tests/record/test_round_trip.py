"""Records are read back bit for bit."""

from pathlib import Path
from tempfile import TemporaryDirectory

from hypothesis import given, settings, strategies as st

from cohelm.core.trace import Trace
from cohelm.record import period
from cohelm.record.read import read
from cohelm.record.write import Recorder
from tests.record.runs import bits, lab, parts, recorded, traces


@given(trace=traces(), cuts=st.lists(st.integers(0, 20), max_size=4))
@settings(max_examples=15, deadline=None)
def test_any_run_in_any_pieces_is_read_back_to_the_last_bit(trace: Trace, cuts: list[int]) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "run.mcap"
        with Recorder(path) as recorder:
            for piece in parts(trace, [min(cut, len(trace)) for cut in cuts]):
                recorder.write(piece)
        assert bits(read(path)) == bits(trace)


def test_a_run_in_the_lab_is_read_back_to_the_last_bit(tmp_path: Path) -> None:
    written = recorded(tmp_path / "lab.mcap", lab(duration=20.0))  # the mover sets out at 15 s
    assert len(written) == 2001
    assert bits(read(tmp_path / "lab.mcap")) == bits(written)


def test_the_same_run_makes_the_same_file(tmp_path: Path) -> None:
    for name in ("a", "b"):
        recorded(tmp_path / name, lab(duration=5.0))
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_every_field_of_a_step_is_explained_in_the_file() -> None:
    for line in period.DEFINITION.splitlines()[1:]:
        assert "=" in line.split("#")[0] or line.split("# ")[1], line
