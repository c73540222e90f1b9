"""Sand that lies on the floor for twenty thousand steps."""

from dataclasses import replace
from itertools import pairwise

import numpy as np

import pcnclaws as pc
from benchmarks.verification.case import Case, Outcome, Table, violation
from benchmarks.verification.motion_scenes import array

STEPS, EVERY, SPACING, FLOOR = 20_000, 500, 0.05, 0.1
GRAIN = 0.025  # distance of the grains, half a cell
RINGS = (0.0, 0.05, 0.1, 0.15, 0.2, 0.3)


def lying() -> Outcome:
    """How far the middle of sand moves that fills a bin up to two slopes of 1 in 2, 26.6 degrees, over dx."""
    edge = np.arange(FLOOR + GRAIN / 2, 0.4, GRAIN)
    grains = np.stack(np.meshgrid(edge, edge, edge, indexing="ij"), -1).reshape(-1, 3)
    height = 0.05 + 0.5 * np.clip(0.15 - np.abs(grains[:, 0] - 0.25), 0.0, None)
    body = pc.Body.points(grains[grains[:, 1] - FLOOR < height], GRAIN**3)
    bin_of_sand = pc.Settings(grid_spacing=SPACING, wall_distance=FLOOR, domain=((0, 0, 0), (0.5, 0.5, 0.5)))
    scene = pc.Scene(body, pc.analytic_law("sand"), settings=bin_of_sand, friction_angle=28.0)
    return _drift(scene.simulate(STEPS, EVERY))


def heap(friction: float) -> Outcome:
    """How far the middle of a cube of 512 grains that is laid on the floor moves in the last quarter, over dx."""
    body = pc.Body.cube(side=0.2, centre=(0.5, FLOOR + 0.1, 0.5), particles_per_edge=8)
    settings = pc.Settings(grid_spacing=SPACING, wall_distance=FLOOR, friction=friction)
    motion = pc.Scene(body, pc.analytic_law("sand"), settings=settings).simulate(STEPS, EVERY)
    return replace(_drift(motion), table=_rings(motion))


def _drift(motion: pc.Motion) -> Outcome:
    middle = array(motion.position).mean(1)
    quarters = [middle[k * len(middle) // 4 :] for k in range(4)]
    moved = [float(((one - one[0]) ** 2).sum(1).max() ** 0.5) / SPACING for one in quarters]
    rows = [[f"{k * STEPS // 4}", f"{one:.1e}"] for k, one in enumerate(moved)]
    return violation(moved[-1], table=Table(["from step", "moved until the end / dx"], rows))


def _rings(motion: pc.Motion) -> Table:
    """Height and speed at the end by the distance from the axis of the heap."""
    position, velocity = array(motion.position)[-1], array(motion.velocity)[-1]
    distance, speed = np.hypot(position[:, 0] - 0.5, position[:, 2] - 0.5), np.linalg.norm(velocity, axis=1)
    rows = []
    for low, high in pairwise(RINGS):
        ring = (distance >= low) & (distance < high)
        if ring.any():
            above = (position[ring, 1].max() - FLOOR) / SPACING
            rows.append([f"{low:g} to {high:g}", f"{above:.2f}", f"{1e3 * speed[ring].mean():.2g}"])
    return Table(["distance from the axis [m]", "highest grain above the floor / dx", "mean speed [mm/s]"], rows)


CASES = [
    Case(
        "sand_at_rest",
        "motion",
        "Sand with a friction angle of 28 degrees that fills a bin to slopes of 26.6 degrees lies still: in the last "
        "quarter of 20 000 steps its middle moves by at most dx / 1000.",
        "rest",
        1e-3,
        lying,
        slow=True,
    ),
    Case(
        "sand_heap",
        "motion",
        "A heap that a cube of sand has fallen into, on a floor with Coulomb friction 0.6, lies still to the same.",
        "rest",
        1e-3,
        lambda: heap(0.6),
        slow=True,
        why="Its rim is thinner than a cell, which a grid does not resolve: there it goes on creeping outward, ever "
        "slower, and the higher it is the slower it moves, as the table says.",
    ),
    Case(
        "sand_heap_without_friction",
        "motion",
        "The same on the default floor, which has no friction.",
        "rest",
        1e-3,
        lambda: heap(0.0),
        slow=True,
        why="Nothing holds the foot of a heap there: it goes on running out, ever slower, as it should.",
    ),
]
