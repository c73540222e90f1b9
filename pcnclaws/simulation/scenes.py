"""Scenes as the user knows them (particle-first NumPy) and as the simulator runs them (component-first tensors).

The only place where one becomes the other.
"""

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple, TypeVar

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from pcnclaws.errors import UserError
from pcnclaws.laws.analytic import Laws
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.laws.parameters import validate_parameters
from pcnclaws.laws.plasticity import NoPlasticity
from pcnclaws.mpm.integrator import MPMIntegrator
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.mpm.state import ParticleState, Scenes
from pcnclaws.simulation.fast_paths import Skips
from pcnclaws.simulation.placement import require_inside
from pcnclaws.simulation.recording import FramePlan, Trajectory
from pcnclaws.simulation.records import Keyframes, SceneRecord
from pcnclaws.simulation.rollout import simulate_scenes
from pcnclaws.simulation.simulator import Simulator


@dataclass(frozen=True)
class SceneStart:
    """Where a scene starts: everything that a simulation needs but the laws.

    parameters   physical parameters by name
    position     [m], (particles, 3)
    velocity     [m/s], (particles, 3)
    volume       initial volume [m^3], (particles,)
    affine       APIC velocity gradient C [1/s], (particles, 3, 3), None for 0
    deformation  elastic deformation gradient F [-], (particles, 3, 3), None for I
    density      of each particle [kg/m^3], (particles,), None where it is that of the settings
    varying      physical parameters that differ between the particles, by name, each (particles,); what is recorded
                 of the scene does not hold them
    """

    name: str
    material: str
    settings: SimulationSettings
    parameters: Mapping[str, float]
    position: Float[np.ndarray, "particles 3"]
    velocity: Float[np.ndarray, "particles 3"]
    volume: Float[np.ndarray, " particles"]
    affine: Float[np.ndarray, "particles 3 3"] | None = None
    deformation: Float[np.ndarray, "particles 3 3"] | None = None
    density: Float[np.ndarray, " particles"] | None = None
    varying: Mapping[str, Float[np.ndarray, " particles"]] = field(default_factory=dict)

    @property
    def lightest(self) -> SimulationSettings:
        """The settings with the density of the lightest particle, where waves are the fastest."""
        return lightest_settings(self.settings, self.density)

    def of_particles(self) -> dict[str, Float[np.ndarray, " particles"]]:
        """All physical parameters, of each particle, by name."""
        same = {name: np.full(len(self.position), value) for name, value in self.parameters.items()}
        return same | dict(self.varying)


class SceneBatch(NamedTuple):
    """Scenes of the same settings as one flat batch; parameters by name, each (particles,)."""

    state: ParticleState
    scenes: Scenes
    parameters: dict[str, Tensor]
    names: tuple[str, ...]

    @property
    def particle_counts(self) -> list[int]:
        """Number of particles of each scene."""
        return torch.bincount(self.scenes.scene_index, minlength=self.scenes.scene_count).tolist()


def lightest_settings(
    settings: SimulationSettings, density: Float[np.ndarray, " particles"] | None
) -> SimulationSettings:
    """The settings with the smallest of the densities of the particles [kg/m^3]; as they are for None."""
    return settings if density is None else replace(settings, density=float(density.min()))


Scene = TypeVar("Scene", SceneStart, SceneRecord)


def start_of(record: SceneRecord) -> SceneStart:
    """The start of a recorded scene: first frame, initial velocity and its gradient, or the keyframe at step 0.

    raises  UserError when the record does not say how the scene starts, or starts outside the domain
    """
    if record.initial_velocity is None:
        raise UserError(f"{record.label}: has no initial_velocity; a scene cannot start from it")
    if record.material in MATERIALS:
        names = MATERIALS[record.material].parameter_names
        known = {name: value for name, value in record.parameters.items() if name in names}
        validate_parameters(known, names, option=f"{record.label}: parameters")
    # a body that lies on a wall sinks half a cell into its layer, so that a recording may begin there
    require_inside(record.position[0], record.settings, record.label, slack=0.5 * record.settings.grid_spacing)
    start = SceneStart(
        record.name,
        record.material,
        record.settings,
        record.parameters,
        record.position[0],
        record.initial_velocity,
        record.volume,
        record.initial_affine,
        density=record.density,
    )
    keyframes = record.keyframes
    if keyframes is None or keyframes.step[0] != 0:
        return start
    return replace(start, affine=keyframes.affine[0], deformation=keyframes.deformation[0])


def group_by_settings(scenes: Sequence[Scene]) -> list[list[Scene]]:
    """The scenes in groups that can run as one batch, in the order of their first members."""
    groups: dict[SimulationSettings, list[Scene]] = {}
    for scene in scenes:
        groups.setdefault(_shared(scene.settings), []).append(scene)
    return list(groups.values())


def batch_scenes(
    starts: Sequence[SceneStart], dtype: torch.dtype = torch.float32, device: str | torch.device = "cpu"
) -> SceneBatch:
    """Scenes as one flat batch. Gravity and density may differ between them, the other settings may not.

    raises  ValueError when the scenes cannot share a batch
    """
    if not starts or len(group_by_settings(starts)) != 1:
        raise ValueError("a batch needs one or more scenes with the same settings")
    of_particles = [start.of_particles() for start in starts]
    names = set(of_particles[0])
    if any(set(values) != names for values in of_particles):
        raise ValueError("the scenes of a batch need the same parameters")

    def tensor(values: np.ndarray) -> Tensor:
        return torch.tensor(values, dtype=dtype, device=device)

    counts = [len(start.position) for start in starts]
    index = np.repeat(np.arange(len(starts)), counts)
    volume = np.concatenate([start.volume for start in starts]).astype(np.float64)
    density = np.concatenate(
        [
            np.full(count, start.settings.density) if start.density is None else start.density.astype(np.float64)
            for start, count in zip(starts, counts, strict=True)
        ]
    )
    state = ParticleState(
        tensor(vectors_first(np.concatenate([start.position for start in starts]))),
        tensor(vectors_first(np.concatenate([start.velocity for start in starts]))),
        tensor(_matrices_first(starts, "affine", np.zeros((3, 3)))),
        tensor(_matrices_first(starts, "deformation", np.eye(3))),
    )
    gravity = tensor(np.array([start.settings.gravity for start in starts]).T)
    scene_index = torch.tensor(index, dtype=torch.int64, device=device)
    scenes = Scenes(scene_index, tensor(density * volume), tensor(volume), gravity)
    parameters = {name: tensor(np.concatenate([values[name] for values in of_particles])) for name in sorted(names)}
    return SceneBatch(state, scenes, parameters, tuple(start.name for start in starts))


def simulate_records(
    starts: Sequence[SceneStart],
    laws: Laws,
    steps: int,
    every: int,
    keyframe_every: int = 0,
    dtype: torch.dtype = torch.float32,
    device: str | torch.device = "cpu",
    progress: Callable[[int], None] | None = None,
    skips: Skips | None = None,
    velocities: bool = False,
) -> list[SceneRecord]:
    """Simulates scenes, those of the same settings as one batch, and records them; results in the order of `starts`.

    every           steps between frames
    keyframe_every  steps between keyframes, 0 for none
    dtype           of the simulation and of the records
    progress        called with the number of steps just done, of steps x len(group_by_settings(starts)) in all
    skips           what is left out, everything that can be by default
    velocities      record the velocities at the frames, too
    raises          SimulationDiverged, naming scene, step and particle
    """
    skips = skips or Skips()
    plan = FramePlan(steps, every, keyframe_every, velocities)
    done: dict[int, SceneRecord] = {}
    for group in group_by_settings(starts):
        simulator = copy.deepcopy(simulator_of(laws, group[0].settings, skips)).to(device=device, dtype=dtype)
        batch = batch_scenes(group, dtype, device)
        if not skips.graph:  # as if somebody wanted to differentiate
            for tensor in (*simulator.parameters(), *batch.parameters.values()):
                tensor.requires_grad_()
        fields = (batch.state, batch.scenes, batch.parameters)
        trajectory = simulate_scenes(simulator, *fields, plan, batch.names, progress, skips)
        done |= {id(start): record for start, record in zip(group, _records(group, batch, trajectory), strict=True)}
    return [done[id(start)] for start in starts]


def simulator_of(laws: Laws, settings: SimulationSettings, skips: Skips | None = None) -> Simulator:
    """The simulator of these laws, with the parts that the switches leave."""
    skips = skips or Skips()
    plasticity = laws.plasticity or (None if skips.plasticity else NoPlasticity())
    return Simulator(laws.elasticity, plasticity, MPMIntegrator(settings, skips.grid_window))


def vectors_first(vectors: np.ndarray) -> np.ndarray:
    """(..., particles, 3) to (..., 3, particles)."""
    return np.ascontiguousarray(np.swapaxes(vectors, -1, -2))


def split_vectors(vectors: Float[Tensor, "frames 3 particles"], counts: Sequence[int]) -> list[np.ndarray]:
    """A field of a batch by scenes, each (frames, particles, 3), in the precision of the field.

    counts  SceneBatch.particle_counts
    """
    parts = vectors.detach().cpu().split(list(counts), dim=-1)
    return [np.ascontiguousarray(np.swapaxes(part.numpy(), -1, -2)) for part in parts]


def split_matrices(matrices: Float[Tensor, "frames 3 3 particles"], counts: Sequence[int]) -> list[np.ndarray]:
    """A field of a batch by scenes, each (frames, particles, 3, 3), in the precision of the field."""
    parts = matrices.detach().cpu().split(list(counts), dim=-1)
    return [np.ascontiguousarray(np.moveaxis(part.numpy(), -1, -3)) for part in parts]


def join_positions(
    positions: Sequence[np.ndarray], dtype: torch.dtype = torch.float32, device: str | torch.device = "cpu"
) -> Float[Tensor, "frames 3 particles"]:
    """Positions of scenes, each (frames, particles, 3), as one field of their batch."""
    return torch.tensor(vectors_first(np.concatenate(positions, axis=1)), dtype=dtype, device=device)


def _records(starts: Sequence[SceneStart], batch: SceneBatch, trajectory: Trajectory) -> list[SceneRecord]:
    counts = batch.particle_counts
    step, keyframe_step = trajectory.step.numpy(), trajectory.keyframe_step.numpy()
    fields = zip(
        starts,
        split_vectors(trajectory.position, counts),
        split_vectors(trajectory.velocity, counts),
        split_vectors(trajectory.keyframe_velocity, counts),
        split_matrices(trajectory.affine, counts),
        split_matrices(trajectory.deformation, counts),
        strict=True,
    )
    records = []
    for start, position, velocity, *full_states in fields:
        parameters = {name: value for name, value in start.parameters.items() if name not in start.varying}
        at = np.searchsorted(step, keyframe_step)
        records.append(
            SceneRecord(
                start.name,
                start.material,
                start.settings,
                parameters,
                step * start.settings.time_step,
                position,
                start.volume.astype(position.dtype),
                start.velocity.astype(position.dtype),
                velocity if len(velocity) else None,
                Keyframes(keyframe_step, position[at], *full_states) if len(at) else None,
                initial_affine=None
                if start.affine is None or not start.affine.any()
                else start.affine.astype(position.dtype),
                density=None if start.density is None else start.density.astype(position.dtype),
            )
        )
    return records


def _shared(settings: SimulationSettings) -> SimulationSettings:
    """The settings but for what may differ within a batch."""
    return replace(settings, gravity=(0.0, 0.0, 0.0), density=1.0)


def _matrices_first(starts: Sequence[SceneStart], name: str, missing: np.ndarray) -> np.ndarray:
    values = [getattr(start, name) for start in starts]
    filled = [
        np.broadcast_to(missing, (len(start.position), 3, 3)) if value is None else value
        for start, value in zip(starts, values, strict=True)
    ]
    return np.ascontiguousarray(np.moveaxis(np.concatenate(filled), 0, -1))
