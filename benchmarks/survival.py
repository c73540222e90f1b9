"""Bodies that meet the floor, many in one batch: which of them stay finite and gain no energy.

Scenes of a batch share their time step, and are to have the same CFL number with different materials. So each scene is
brought to the time step of the batch by a change of the unit of time: velocities go with it, gravity and stresses with
its square, and every step computes the same numbers.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from benchmarks.cell_lattices import Box, filled
from pcnclaws.evaluation.energy import potential_energy, scene_energy
from pcnclaws.geometry.shapes import spin_velocity
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.base import Elasticity
from pcnclaws.laws.materials import material_named
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.mpm.state import ParticleState
from pcnclaws.simulation.batch import SceneBatch, batch_scenes
from pcnclaws.simulation.physical_states import failing_particles
from pcnclaws.simulation.scenes import SceneStart
from pcnclaws.simulation.simulator import simulator_of
from pcnclaws.simulation.time_step import stability_of

NODES, WALL_CELLS = 20, 2
# A body has so many particles along an edge and is so many cells long: at least. Smaller ones survive larger steps.
EDGE_PARTICLES, EDGE_CELLS = 6, 5
GRAVITY = (0.0, -9.8, 0.0)
# Velocity [m/s] and spin [rad/s] where a body begins to feel the floor: a fall of 0.15 m, and a spinning hop.
MOTIONS = {"dropped": ((0.0, -1.715, 0.0), (0.0, 0.0, 0.0)), "spinning": ((0.3, -1.0, 0.2), (3.0, 1.0, 3.0))}
PRECISIONS = {"float32": torch.float32, "float64": torch.float64}
TIME_STEP = 1e-3
# Kinetic and elastic energy may exceed what there was at the start, with the fall to the floor, by this share.
TOLERANCE = 0.1
# A run covers at least the time in which a wave of CFL number 1 crosses so many cells: all of the contact.
CELLS = 40.0
LOOK_EVERY = 20
STABLE, GAINS_ENERGY, DIVERGED = "s", "e", "d"


class Batch(NamedTuple):
    """What the scenes of one batch have in common.

    flow      the plastic parameter: friction_angle [deg], or yield_stress in units of youngs_modulus; None without
    per_cell  particles along the edge of a grid cell; at 0.5 they are alone on the grid
    """

    material: str
    flow: float | None
    motion: str
    precision: str
    per_cell: float
    cfl: float

    @property
    def name(self) -> str:
        """In words, for the progress and the stored rows."""
        flow = "" if self.flow is None else f" {self.flow:g}"
        return (
            f"{self.material}{flow}, {self.motion}, {self.precision}, {self.per_cell:g} a cell edge, CFL {self.cfl:g}"
        )


def fates(batch: Batch, moduli: list[tuple[float, float]], steps: int, device: torch.device) -> str:
    """What becomes of bodies of these (E [Pa], nu [-]): a letter each.

    steps  at least so many, more where the CFL number is small
    """
    starts = [scene_start(batch, *one) for one in moduli]
    material = material_named(batch.material)
    dtype = PRECISIONS[batch.precision]
    simulator = simulator_of(analytic_laws(material), starts[0].settings).to(device=device, dtype=dtype)
    scenes = batch_scenes(starts, dtype, device)
    watch = _Watch(scenes, simulator.elasticity, starts[0].settings)
    state = scenes.state
    with torch.no_grad():
        for n in range(1, max(steps, math.ceil(CELLS / batch.cfl)) + 1):
            state = simulator(state, scenes.scenes, scenes.parameters)
            watch.step(state)
            if n % LOOK_EVERY == 0 and watch.look(state):
                break
    return watch.letters()


def scene_start(batch: Batch, youngs_modulus: float, poissons_ratio: float) -> SceneStart:
    """A body that begins to feel the floor, in the unit of time in which the batch's step has its CFL number."""
    spacing = 1.0 / NODES
    side = round(max(EDGE_PARTICLES, EDGE_CELLS * batch.per_cell)) / batch.per_cell * spacing
    floor = (WALL_CELLS + 1.5) * spacing
    body = filled(Box((0.5 - 0.5 * side, floor, 0.5 - 0.5 * side), (side, side, side)), spacing / batch.per_cell)
    velocity, spin = MOTIONS[batch.motion]
    velocities = spin_velocity(body.position, np.tile(velocity, (len(body.volume), 1)), spin)
    parameters = {"youngs_modulus": youngs_modulus, "poissons_ratio": poissons_ratio} | _flow(batch, youngs_modulus)
    settings = SimulationSettings(TIME_STEP, spacing, WALL_CELLS * spacing, GRAVITY)
    name = f"E {youngs_modulus:g}, nu {poissons_ratio:g}"
    start = SceneStart(
        name,
        batch.material,
        settings,
        parameters,
        position=body.position,
        velocity=velocities,
        volume=body.volume,
    )
    unit = batch.cfl / stability_of(start).cfl  # the step of this CFL number over the batch's
    stresses = {
        name: unit**2 * value for name, value in parameters.items() if name in ("youngs_modulus", "yield_stress")
    }
    gravity = (0.0, unit**2 * GRAVITY[1], 0.0)
    scaled = SimulationSettings(TIME_STEP, spacing, WALL_CELLS * spacing, gravity)
    return replace(start, settings=scaled, parameters=parameters | stresses, velocity=unit * velocities)


def _flow(batch: Batch, youngs_modulus: float) -> dict[str, float]:
    if batch.flow is None:
        return {}
    if batch.material == "sand":
        return {"friction_angle": batch.flow}
    return {"yield_stress": batch.flow * youngs_modulus}


class _Watch:
    """Looks at the scenes of a batch as they run."""

    def __init__(self, scenes: SceneBatch, elasticity: Elasticity, settings: SimulationSettings) -> None:
        self._scenes, self._elasticity, self._spacing = scenes, elasticity, settings.grid_spacing
        energy = self._energy(scenes.state) + potential_energy(scenes.state, scenes.scenes, settings.floor)
        self._most = (1.0 + TOLERANCE) * energy
        self._failed = torch.zeros_like(scenes.scenes.scene_index, dtype=torch.bool)
        self._gains = torch.zeros_like(energy, dtype=torch.bool)
        self._diverged = self._gains.clone()

    def step(self, state: ParticleState) -> None:
        """Notes the particles that fail in a step."""
        self._failed = self._failed | failing_particles(state)

    def look(self, state: ParticleState) -> bool:
        """Notes the scenes that have diverged or gained energy; whether all have diverged."""
        self._diverged = self._diverged.index_fill(0, self._scenes.scenes.scene_index[self._failed], True)
        self._gains = self._gains | ~(self._energy(state) <= self._most)
        return bool(self._diverged.all())

    def letters(self) -> str:
        return "".join(
            DIVERGED if diverged else GAINS_ENERGY if gains else STABLE
            for diverged, gains in zip(self._diverged.tolist(), self._gains.tolist(), strict=True)
        )

    def _energy(self, state: ParticleState) -> Tensor:
        fields = (self._scenes.scenes, self._scenes.parameters, self._elasticity, self._spacing)
        return scene_energy(state, *fields)
