"""A law of one's own in a campaign, beside the guard: the same rooms, wheels and judge.

    cohelm campaign random --n 20 --compare guard,own_law:potential_field,own_law:filtered

Run as it is, it drives at a wall with and without the filter around the same law.
"""

import math

import cohelm


def potential_field(robot: cohelm.RobotModel, period: float):
    """Makes the controller: drawn to the goal, pushed off by what is near (Khatib 1986)."""

    def law(now: cohelm.Observation) -> cohelm.Twist:
        x, y, psi = now.pose
        far = math.hypot(now.goal[0] - x, now.goal[1] - y)
        fx, fy = (now.goal[0] - x) / far, (now.goal[1] - y) / far
        for cx, cy, _, _, radius, _ in now.obstacles.discs:
            away = math.hypot(x - cx, y - cy)
            gap = max(away - radius - robot.reach, 0.05)
            if gap < 1.0:
                push = 0.1 * (1.0 / gap - 1.0) / gap
                fx, fy = fx + push * (x - cx) / away, fy + push * (y - cy) / away
        turn = math.remainder(math.atan2(fy, fx) - psi, 2.0 * math.pi)
        return cohelm.Twist(0.5 * max(math.cos(turn), 0.0) * min(far, 1.0), 2.0 * turn)

    return law


def filtered(robot: cohelm.RobotModel, period: float):
    """The same with the safety filter around it: five lines."""
    safe = cohelm.SafetyFilter(robot, period)
    law = potential_field(robot, period)

    def guarded(now: cohelm.Observation) -> cohelm.Twist:
        return safe(now.pose, now.twist, law(now), now.obstacles).twist

    return guarded


def main() -> None:
    """A wall between start and goal, of which the field knows nothing."""
    robot, wall = cohelm.load_robot("jackal"), "walls_m=[[7, -2, 7, 3]]"
    for make in (potential_field, filtered):
        result = cohelm.run("minimal", make(robot, 0.01), changes=[wall, "stick={kind: none}"])
        nearest = result.metrics.min_clearance_m
        print(f"{make.__name__}: {result.contacts} contacts, {nearest:.3f} m at the nearest")


if __name__ == "__main__":
    main()
