"""Motions of bodies whose stiffness differs from part to part: python -m benchmarks.parts outputs/estimation.

Writes several_bodies.h5, three cubes of different stiffness, and graded_body.h5, a bar that is soft at one end and
stiff at the other. `make estimation` estimates all of their parameters at once (docs/estimation_results.md).
"""

import sys
from pathlib import Path

import numpy as np

from benchmarks.pages.estimates import TRUTHS
from pcnclaws.data.hdf5 import write_scenes
from pcnclaws.geometry.shapes import particles, spin_velocity
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.scenes import SceneStart


def several_bodies() -> SceneStart:
    """Three cubes that fall side by side, each with a stiffness and a Poisson's ratio of its own."""
    cubes = [particles("cube", (x, 0.3, 0.5), 0.16, 6) for x in (0.24, 0.5, 0.76)]
    position, volume = (np.concatenate(parts) for parts in zip(*((c.position, c.volume) for c in cubes), strict=True))
    body = np.repeat(range(3), [len(cube.position) for cube in cubes])
    velocity = np.concatenate([spin_velocity(c.position, np.array((0.0, -2.0, 0.0)), [0.0, 2.0, 4.0]) for c in cubes])
    truth = TRUTHS["several_bodies"]
    varying = {
        name: np.array([truth[f"{name}[body_{k}]"] for k in range(3)])[body]
        for name in ("youngs_modulus", "poissons_ratio")
    }
    settings = SimulationSettings(grid_spacing=1 / 25, time_step=4e-4)
    return SceneStart("several_bodies", "elasticity", settings, {}, position, velocity, volume, varying=varying)


def graded_body() -> SceneStart:
    """A bar that falls flat on the floor, its stiffness rising along x."""
    cubes = [particles("cube", (x, 0.3, 0.5), 0.2, 6) for x in (0.3, 0.5, 0.7)]
    position, volume = (np.concatenate(parts) for parts in zip(*((c.position, c.volume) for c in cubes), strict=True))
    position, kept = np.unique(position.round(6), axis=0, return_index=True)  # cubes that touch share a face
    share = (position[:, 0] - position[:, 0].min()) / np.ptp(position[:, 0])
    truth = TRUTHS["graded_body"]
    low, high = truth["youngs_modulus[low_x]"], truth["youngs_modulus[high_x]"]
    varying = {"youngs_modulus": low + (high - low) * share}
    velocity = np.tile((0.0, -2.0, 0.0), (len(position), 1))
    settings = SimulationSettings(grid_spacing=1 / 25, time_step=4e-4)
    same = {"poissons_ratio": truth["poissons_ratio[low_x]"]}
    return SceneStart("graded_body", "elasticity", settings, same, position, velocity, volume[kept], varying=varying)


if __name__ == "__main__":
    for start in (several_bodies(), graded_body()):
        path = Path(sys.argv[1]) / f"{start.name}.h5"
        plan = FramePlan(steps=400, every=5, velocities=True)
        write_scenes(path, simulate_records([start], analytic_laws(MATERIALS["elasticity"]), plan))
        print(f"wrote {path}")
