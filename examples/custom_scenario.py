"""A scenario built in Python: a door of varying width, and how wide it must be to get through."""

import cohelm


def door(width: float) -> cohelm.Scenario:
    """A straight route through a door of so many metres."""
    half = 0.5 * width
    return cohelm.Scenario.model_validate(
        {
            "name": f"door-{width:.2f}",
            "robot": "sally",
            "reference": {"speed_mps": 0.5, "waypoints_m": [(0, 0), (2, 0), (4, 0)]},
            "walls_m": [(2, half, 2, 3), (2, -half, 2, -3)],
            "simulation": {"step_s": 0.02, "delay_s": 0.06, "duration_s": 15.0},
        }
    )


def main() -> dict[float, bool]:
    """By width [m]: whether Sally, 0.58 m wide, gets through."""
    arrived = {}
    for width in (0.55, 0.70, 0.90):
        result = cohelm.run(door(width))
        arrived[width] = result.arrived
        print(f"{width:.2f} m: {'through' if result.arrived else 'not through'}, "
              f"{result.contacts} contacts, {result.metrics.min_clearance_m:.3f} m")  # fmt: skip
    return arrived


if __name__ == "__main__":
    main()
