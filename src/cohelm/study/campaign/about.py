"""Describes each suite, for the report."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from cohelm.robot.model import RobotModel
from cohelm.study.campaign import crowd, heights, movers, rooms

Part = str | tuple[str, ...]
"""A paragraph, or the items of a list."""


def about(suite: str, laws: Sequence[str], robot: RobotModel | None) -> Sequence[Part]:
    """Paragraphs and lists about a suite and the laws that drove it, plain text. robot: drives
    instead of the suite's own."""
    other = () if robot is None else (_OTHER_ROBOT.format(robot.name),)
    said = tuple(f"{law}: {_LAWS.get(law, _OWN)}" for law in laws)
    return (*_ABOUT[suite], *other, "Laws:", said)


_LAWS = {
    "guard": "the safety filter, with the planner that finds ways round what stands and moves;",
    "paper": "the paper's barrier; of walls it knows nothing;",
    "none": "no filter but the wheels' limits;",
    "rvo": "reciprocal velocity obstacles, of ir-sim; of walls it knows nothing;",
    "vo": "velocity obstacles, of ir-sim; of walls it knows nothing;",
}
_OWN = "a law that does not come with cohelm; it is given the true obstacles."


_OTHER_ROBOT = (
    "{} drives here instead of the robot named above. If it is larger than Sally, way and distances"
    " at start and goal are as much larger; if it is slower than the reference, this is slowed down"
    " to four fifths of its top speed, and the time limit grows as much."
)


def html(parts: Sequence[Part]) -> str:
    """The same as HTML."""
    return "\n".join(
        f"<p>{escape(part)}</p>"
        if isinstance(part, str)
        else "<ul>" + "".join(f"<li>{escape(item)}</li>" for item in part) + "</ul>"
        for part in parts
    )


_DENSITIES = ", ".join(f"{n} ({name})" for name, n in movers.DENSITIES.items())

_ABOUT: dict[str, Sequence[Part]] = {
    "lab": (
        "The paper's lab, with the robot's real outline and wheels, without an operator. Both "
        "doors, the corridor and the pass between the two cones are on the way.",
        "Episode 0 is the shipped scenario lab-guard. In the others the robot starts up to 0.1 m "
        "and 0.2 rad off, and the moving obstacle sets off between 0 and 40 s at 0.1 to 0.4 m/s.",
        "Arrived: within 0.1 m of the end of the reference, within twice its time.",
    ),
    "random": (
        "Rooms with obstacles that rest and people who walk, from one wall to the opposite one:",
        (
            "a room of 10 to 13 m by 6 to 8 m with four walls; Sally drives from 1.2 m off the "
            "west wall to 1.2 m off the east wall, both anywhere across; the reference is a "
            "straight line at 0.5 m/s that ignores obstacles;",
            "6 to 14 round obstacles at rest, radius 0.1 to 0.5 m, 0.9 m clear of start and goal;"
            f" a way {rooms.WAY:g} m wide leads from start to goal in every room;",
            "2 to 5 walkers of radius 0.2 to 0.3 m on curves through random points, at a mean "
            f"speed of 0.2 to 0.8 m/s, never faster than {rooms.FASTEST:g} m/s nor with more than "
            f"{rooms.MAX_ACCELERATION:g} m/s², at first 2 m from the robot; they walk all the "
            "time, through resting obstacles too, and avoid nobody.",
        ),
        "Arrived: within 0.3 m of the goal, within 120 s.",
    ),
    "movers": (
        "Fields of big, fast discs on key frames, in the manner of DynaBARN:",
        (
            f"a hall of {movers.LENGTH:g} by {movers.WIDTH:g} m with four walls; Sally drives from "
            "0.8 m off the west wall to 0.8 m off the east wall, 1.5 m off the other two at least; "
            "the reference is a straight line at 0.8 m/s;",
            f"{_DENSITIES} discs of radius 0.25 to 0.5 m, the densities in turns;",
            "each moves straight from key frame to key frame, at least 2 m apart, from rest to "
            f"rest, on each way at another speed of 0.4 to {movers.FASTEST:g} m/s, and with "
            f"{movers.MAX_ACCELERATION:g} m/s²; it stays {movers.APRON:g} m off the west and the "
            "east wall. Discs move all the time, through each other too, and avoid nobody.",
        ),
        "Arrived: within 0.3 m of the goal, within 90 s.",
    ),
    "barn": (
        "The worlds of the BARN challenge, judged by its rules: Jackal with 720 beams over 270 "
        "degrees, 30 scans a second, 1 cm of noise, and the given reference path. It sees the"
        " cylinders by its scans alone. The score is the challenge's since 2026.",
        "Episode k is world k modulo their number; every further round has another seed of the "
        "sensor's noise. Not the challenge's own simulation: no Gazebo, no physics, and the pose "
        "is known exactly. The paper's law has no sensor in it: it is given the cylinders as they"
        " are.",
        "Arrived: within 1 m of the goal, within 100 s.",
    ),
    "crowd": (
        "Recorded pedestrians walk where Sally crosses the middle of the scene: 8 m straight on "
        "at 0.8 m/s, in any direction, at moments spread over the recording. They avoid nobody. At"
        " first nobody is within 1.5 m.",
        "The recordings give a place every 0.4 s. Between and around the samples people walk on "
        "smoothing splines, within some 0.2 m of them; before the first and after the last sample"
        " they walk straight on for 10 s, so that none appears beside the robot. Left out "
        f"and listed are those then faster than {crowd.FASTEST:g} m/s or with more than "
        f"{crowd.MAX_ACCELERATION:g} m/s², those seen only "
        "once, and those that would even so "
        f"appear during a crossing within {crowd.REACH:g} m of the middle of the scene. "
        "Episode k is scene k modulo their number.",
        "Arrived: within 0.3 m of the goal, within 60 s.",
    ),
    "adversary": (
        "An operator tries to bring about a contact, alone with the filter. Sally or "
        "Jackal in turns, at rest at the origin of a field of 6 m, with 4 to 9 resting obstacles,"
        " 2 to 4 walls of 1 to 4 m and 10 stray points, none nearer than 5 cm; in every second "
        "episode also 1 to 3 walkers, 2 to 5 m away at first, with up to 1 m/s² and 1.3 m/s, half"
        " of the time straight at the robot.",
        "For ten seconds the stick is deflected by one of these:",
        (
            "ram: at the nearest obstacle, with fits of bang in between;",
            "bang: full deflections at random;",
            "spin: full turns and lunges, starting beside a wall;",
            "human: a recorded operator, signs flipped on one axis or on both (where recordings are"
            " given);",
            "search: every 500th episode, CMA-ES over sequences of 20 deflections for the "
            "smallest clearance; 2000 sequences are driven, and the worst is the episode.",
        ),
        "There is no goal.",
    ),
    "hands": (
        "Recorded operators, whose stick was meant for another room, drive in the paper's lab. "
        "Every recording is played into the scenario lab-guard: first each from its beginning, "
        "then from anywhere in it. The controller leads whenever the stick is released.",
        "Arrived: within 0.1 m of the end of the reference, within three times its time; a "
        "stick held for long may well prevent that.",
    ),
    "heights": (
        "Halls of 8 to 10 m by 6 to 7 m with stairs down, pits, lower ground and docks, table tops,"
        " hanging shelves and things lower than the LiDAR's plane, two to five of them. The robot, "
        f"{heights.ROBOT}, has a planar LiDAR at 20 cm and a depth camera that watches the floor "
        "ahead; what its pictures show comes to it as the bytes of ROS 2's images.",
        (
            f"none is nearer than {heights.CLEAR:g} m to start or goal, and a way {heights.WAY:g} m"
            " wide leads from one to the other, wider with a load that is;",
            "brakes and delay are the worst that the robot's file states, or better, by the load, "
            "which changes within every second episode; in every third one it is wider or longer "
            "than the robot, and its footprint is stated so;",
            "the operator, in turns: none; one that pushes at the nearest edge while the "
            "controller drives; one alone for 15 s: at the nearest edge ahead or tail first, "
            "spins, lunges, fits.",
        ),
        "Fallen: one of six points where it stands on the floor (wheels, castors) is above lower "
        "ground. An episode ends with the first fall or contact. Arrived: within 0.4 m of the goal,"
        " within 60 s; of those that have one. Nothing but the robot moves: standing contacts there"
        " are none.",
    ),
}
