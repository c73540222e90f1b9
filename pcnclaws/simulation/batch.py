"""Flat ragged batch: the particles of all scenes concatenated, component-first, with the scene of each."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from pcnclaws.laws.internal_variables import InternalVariable
from pcnclaws.mpm.loads import load_shares
from pcnclaws.mpm.state import ParticleState, Scenes
from pcnclaws.simulation.scenes import SceneStart, group_by_settings
from pcnclaws.tensors.layout import matrices_first, vectors_first


class SceneBatch(NamedTuple):
    """Scenes of the same settings as one flat batch; parameters by name, each (particles,).

    names  of the scenes, for error messages; none: their numbers
    """

    state: ParticleState
    scenes: Scenes
    parameters: dict[str, Tensor]
    names: tuple[str, ...] = ()

    def on(self, device: torch.device) -> "SceneBatch":
        """The same on a device, with its derivatives."""
        state = ParticleState(*(field.to(device) for field in self.state))
        scenes = Scenes(*(field.to(device) for field in self.scenes))
        return SceneBatch(state, scenes, {name: one.to(device) for name, one in self.parameters.items()}, self.names)

    @property
    def particle_counts(self) -> list[int]:
        """Number of particles of each scene."""
        return torch.bincount(self.scenes.scene_index, minlength=self.scenes.scene_count).tolist()


def batch_scenes(
    starts: Sequence[SceneStart],
    dtype: torch.dtype = torch.float32,
    device: str | torch.device = "cpu",
    internal_variables: Sequence[InternalVariable] = (),
) -> SceneBatch:
    """Scenes as one flat batch. Gravity and density may differ between them, the other settings may not.

    internal_variables  of the laws, for scenes that start with values of theirs; without them the state has none, and
                        is that of undeformed bodies
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
        tensor(np.stack(rows)) if (rows := [_row(starts, one) for one in internal_variables]) else None,
    )
    gravity = tensor(vectors_first(np.array([start.settings.gravity for start in starts])))
    scene_index = torch.tensor(index, dtype=torch.int64, device=device)
    mass = tensor(density * volume)
    chosen_at = [start.position if start.loaded_at is None else start.loaded_at for start in starts]
    shares = load_shares(starts[0].settings.loads, tensor(vectors_first(np.concatenate(chosen_at))), mass, scene_index)
    scenes = Scenes(scene_index, mass, tensor(volume), gravity, shares)
    parameters = {name: tensor(np.concatenate([values[name] for values in of_particles])) for name in sorted(names)}
    return SceneBatch(state, scenes, parameters, tuple(start.name for start in starts))


def _row(starts: Sequence[SceneStart], variable: InternalVariable) -> np.ndarray:
    """The values of an internal variable, (particles,)."""
    fresh = [np.full(len(start.position), variable.start) for start in starts]
    return np.concatenate(
        [start.internal.get(variable.name, values) for start, values in zip(starts, fresh, strict=True)]
    )


def _matrices_first(starts: Sequence[SceneStart], name: str, missing: np.ndarray) -> np.ndarray:
    values = [getattr(start, name) for start in starts]
    filled = [
        np.broadcast_to(missing, (len(start.position), 3, 3)) if value is None else value
        for start, value in zip(starts, values, strict=True)
    ]
    return matrices_first(np.concatenate(filled))
