"""One row of a campaign driven again, alone, and recorded."""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

from cohelm.core.errors import CohelmError
from cohelm.core.files import check_free, make_folder, write_json, writing
from cohelm.core.trace import Trace
from cohelm.record.file import RECORD
from cohelm.record.write import Recorder
from cohelm.study.campaign import laws
from cohelm.study.campaign.adversary import scripted
from cohelm.study.campaign.episode import Episode, Interventions
from cohelm.study.campaign.result import FAILS, EpisodeResult, fault_of
from cohelm.study.campaign.runner import planned
from cohelm.study.campaign.scoring import arrival, scored
from cohelm.study.campaign.store import read_rows
from cohelm.study.metrics import plain
from cohelm.study.single import scene

ROW, PICTURE, STRIP = "row.json", "episode.png", "evasion.png"
_DIGITS = 12
"""No row's number has so many."""


class Again(NamedTuple):
    """An episode that was driven again."""

    case: Episode
    law: str
    trace: Trace
    row: EpisodeResult
    same: bool
    """Whether the row equals the campaign's, to the last digit."""


def again(folder: Path, which: str, out: Path | None = None) -> tuple[Again, Path]:
    """The episode that `which` names in a campaign's folder, NUMBER or LAW/NUMBER, and the folder
    for `record`: `out`, or one of its own in the campaign's.

    Raises CohelmError where there is no such row, or it fails when it is driven again, or has been
    recorded there already.
    """
    plan = planned(folder)
    law, _, number = which.rpartition("/")
    law = law or plan.laws[0]
    rows = read_rows(folder)
    row = rows.get((law, int(number))) if number.isdecimal() and len(number) < _DIGITS else None
    if row is None:
        raise CohelmError(
            f"--replay {which}: there is no such row; write NUMBER or LAW/NUMBER, of the laws "
            f"{', '.join(plan.laws)} and {len(rows)} rows"
        )
    to = out or folder / "episodes" / f"{law}-{row.episode}"
    mend = "choose another folder with --out"
    check_free(to, (RECORD, ROW, PICTURE, STRIP), "a replay", mend)
    case = plan.prepared().case(row.episode)
    try:
        return drive(case, row), to
    except FAILS as error:
        said = f"{law}/{row.episode} fails when it is driven again: {fault_of(error)}"
        raise CohelmError(said) from error


def drive(case: Episode, row: EpisodeResult) -> Again:
    """A case driven as its row was. row: of the campaign."""
    if row.stick:
        case = scripted(case, row.stick)
    acted = Interventions()
    trace = joined(case, row.law, acted)
    found = scored(case, row.law, iter((trace,)), acted)._replace(stick=row.stick)
    return Again(case, row.law, trace, found, _equal(found, row))


def joined(case: Episode, law: str, acted: Interventions) -> Trace:
    """The whole drive of a case, to its arrival or time limit."""
    done: list[Trace] = []
    for piece in laws.pieces(case, law, acted):
        end = arrival(piece, case.goal)
        if end is not None:
            done.append(piece.until(end + 1))
            break
        done.append(piece)
    return done[0].joined(*done[1:])


def record(found: Again, folder: Path) -> None:
    """Write record, row and picture of an episode to a folder, which is made if need be; and where
    it made way, a strip of that.

    Raises CohelmError where one of them can not be written.
    """
    from cohelm.study.campaign.pictures import picture, strip  # matplotlib takes a second to import

    make_folder(folder)
    setup = found.case.setup
    with writing(folder):
        with Recorder(folder / RECORD, scene(setup)) as recorder:
            recorder.write(found.trace)
        write_json(folder / ROW, plain(found.row._asdict()))
        (folder / PICTURE).write_bytes(picture(found.case, found.trace, found.row))
        if (evasion := strip(found.case, found.trace)) is not None:
            (folder / STRIP).write_bytes(evasion)


def _equal(a: EpisodeResult, b: EpisodeResult) -> bool:
    """Whether two rows are the same, NaN equal to NaN."""

    def same(x: object, y: object) -> bool:
        nans = isinstance(x, float) and isinstance(y, float) and math.isnan(x) and math.isnan(y)
        return nans or x == y

    return all(same(x, y) for x, y in zip(a, b, strict=True))
