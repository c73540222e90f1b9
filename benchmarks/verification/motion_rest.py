"""Sand that lies on the floor for twenty thousand steps."""

import pcnclaws as pc
from benchmarks.verification.case import Case, Outcome, Table, violation
from benchmarks.verification.motion_scenes import array

STEPS, EVERY, SPACING, FLOOR = 20_000, 500, 0.05, 0.1


def drift(friction: float) -> Outcome:
    """How far the middle of a cube of 512 grains that is laid on the floor moves in the last quarter, over dx."""
    body = pc.Body.cube(side=0.2, centre=(0.5, FLOOR + 0.1, 0.5), particles_per_edge=8)
    settings = pc.Settings(grid_spacing=SPACING, wall_distance=FLOOR, friction=friction)
    motion = pc.Scene(body, pc.analytic_law("sand"), settings=settings).simulate(STEPS, EVERY)
    middle = array(motion.position).mean(1)
    quarters = [middle[k * len(middle) // 4 :] for k in range(4)]
    moved = [float(((one - one[0]) ** 2).sum(1).max() ** 0.5) / SPACING for one in quarters]
    rows = [[f"{k * STEPS // 4}", f"{one:.1e}"] for k, one in enumerate(moved)]
    return violation(moved[-1], table=Table(["from step", "moved until the end / dx"], rows))


CASES = [
    Case(
        "sand_at_rest",
        "motion",
        "A heap of sand on a floor with Coulomb friction 0.6 lies still: in the last quarter of 20 000 steps its "
        "middle moves by at most dx / 1000.",
        "rest",
        1e-3,
        lambda: drift(0.6),
        slow=True,
        why="The cube falls into a heap that goes on creeping, ever slower, in each quarter of the run about a third "
        "as far as in the one before, and has not stopped after 20 000 steps. The cause has not been isolated.",
    ),
    Case(
        "sand_at_rest_without_friction",
        "motion",
        "The same on the default floor, which has no friction.",
        "rest",
        1e-3,
        lambda: drift(0.0),
        slow=True,
        why="Nothing holds the foot of a heap there: it goes on running out, ever slower, as it should.",
    ),
]
