"""A hundred runs of a scenario with varied gains, in parallel; what they came to, as a table."""

import sys
from concurrent.futures import ProcessPoolExecutor
from itertools import product

import cohelm

SCENARIO = "lab-track"


def one(gains: tuple[float, float]) -> tuple[float, float, float, float]:
    """k_x, k_psi, the largest pose error [m, rad], the smallest clearance [m]."""
    k_x, k_psi = gains
    changes = [f"law.tracking.k_x={k_x}", f"law.tracking.k_psi={k_psi}"]
    metrics = cohelm.run(SCENARIO, changes=changes).metrics
    return k_x, k_psi, metrics.max_pose_error, metrics.min_clearance_m


def main(n: int = 10) -> list[tuple[float, float, float, float]]:
    """n x n runs, best first."""
    grid = product([0.3 + 0.2 * i for i in range(n)], [0.5 + 0.3 * i for i in range(n)])
    with ProcessPoolExecutor() as pool:
        rows = sorted(pool.map(one, grid), key=lambda row: row[2])
    print("  k_x  k_psi  max E_P  clearance")
    for row in rows[:5]:
        print("{:5.2f}  {:5.2f}  {:7.3f}  {:9.3f}".format(*row))
    return rows


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 10)
