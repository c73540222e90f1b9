"""A pulled plate with a round hole of a fifth of its width: stresses at the hole, of nu 0."""

import math
from functools import cache, partial
from typing import Any

import numpy as np
import torch

import pcnclaws as pc
from benchmarks.verification.case import Case, Curve, Line, Outcome, Table, one_number
from benchmarks.verification.motion_column import ELASTIC
from benchmarks.verification.motion_scenes import NO_GRAVITY, array, box, deformation_of

SOURCE = "Howland 1930; CB-Geo, mpm-doc, plate with a hole, has 3.13 and -1.08"
RADIUS, HALF_WIDTH, HALF_LENGTH, TRACTION, DENSITY = 0.2, 1.0, 1.6, 100.0, 2000.0
# Cells in a metre; four in the radius.
CELLS = 20
# The traction is raised in steps over the first part of the time; stresses are means over the last [s].
RAISED, AVERAGED, LOADS = 0.4, 0.4, 30


@cache
def stresses() -> tuple[np.ndarray, np.ndarray]:
    """Places [m], and mean Kirchhoff stresses over the traction [-], of the particles of a layer."""
    dx = 1.0 / CELLS
    sides = (2.0 * HALF_LENGTH, 2.0 * HALF_WIDTH, dx)
    whole = box((-HALF_LENGTH, -HALF_WIDTH, 0.0), sides, [round(2.0 * side / dx) for side in sides])
    position = array(whole.position)
    body = pc.Body.points(position[np.hypot(position[:, 0], position[:, 1]) >= RADIUS], float(whole.volume[0]))
    force = TRACTION * sides[1] * sides[2] / LOADS
    ends = ((-HALF_LENGTH, dx - HALF_LENGTH, -force), (HALF_LENGTH - dx, HALF_LENGTH, force))
    loads = [
        pc.Load(low=(low, -2, -1), high=(high, 2, 1), force=(pull, 0, 0), start=RAISED * k / LOADS)
        for k in range(LOADS)
        for low, high, pull in ends
    ]
    settings = pc.Settings(domain=None, grid_spacing=dx, gravity=NO_GRAVITY, density=DENSITY, time_step="auto")
    law, parameters = pc.analytic_law(ELASTIC.material), dict[str, Any](ELASTIC.parameters)
    scene = pc.Scene(body, law, settings=settings, loads=loads, **parameters)
    every = math.ceil((RAISED + AVERAGED) / scene.time_step / 100.0)
    motion = scene.simulate(100 * every, every, dtype=torch.float64, deformation=True)
    late = deformation_of(motion)[motion.time > RAISED]
    return array(body.position), array(law.stress(late, **parameters).mean(0)) / TRACTION


def along(axis: int) -> Line:
    """The stress around the hole along the x axis (0) or the y axis (1), beside Kirsch's of an endless plate.

    On the y axis it is the one along the pull, on the x axis the one across it.
    """
    position, stress = stresses()
    near = (np.abs(position[:, 1 - axis]) < 0.5 / CELLS) & (position[:, axis] > 0.0)
    places, group = np.unique(position[near, axis].round(6), return_inverse=True)
    component = stress[near, 1 - axis, 1 - axis]
    mean = np.array([component[group == k].mean() for k in range(len(places))])
    r = RADIUS / places
    kirsch = 0.5 * (2.0 + r**2 + 3.0 * r**4) if axis == 1 else 0.5 * (r**2 - 3.0 * r**4)
    return Line("across the pull" if axis == 1 else "along the pull", places / RADIUS, mean, kirsch)


def edge(axis: int, howland: float) -> Outcome:
    """The stress at the edge: that of the nearest particles, carried on to the edge by Kirsch's formula."""
    line = along(axis)
    at_edge = 3.0 if axis == 1 else -1.0
    ours = float(line.ours[0] / line.theirs[0]) * at_edge
    rows = [[f"{line.x[0]:.3f}", f"{line.ours[0]:.3f}", f"{line.theirs[0]:.3f}"]]
    table = Table(["nearest particles [radii]", "ours / traction", "Kirsch there, endless plate"], rows)
    curve = Curve("distance from the middle / radius [-]", "stress around the hole / traction [-]", [line])
    return one_number(ours, howland, "of the traction", curve=curve, table=table)


CASES = [
    Case(
        "hole_tension",
        "motion",
        "A pulled plate has 3.14 times the traction at the edge of a hole of a fifth of its width, on four cells in "
        "its radius.",
        SOURCE,
        0.1,
        partial(edge, 1, 3.14),
        slow=True,
    ),
    Case(
        "hole_compression",
        "motion",
        "At the edge of the hole that faces the pull the stress is -1.11 times the traction.",
        SOURCE,
        0.1,
        partial(edge, 0, -1.11),
        slow=True,
    ),
]
