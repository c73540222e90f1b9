"""What moves (ParticleState) and what stays the same while it moves (Scenes)."""

from typing import NamedTuple

import torch
from torch import Tensor

from pcnclaws.tensors.tensor_types import InternalValues, Matrices, Scalars, SceneIndex, SceneVectors, Vectors


class _Fields(NamedTuple):
    position: Vectors
    velocity: Vectors
    affine: Matrices
    deformation: Matrices
    internal: InternalValues


class ParticleState(_Fields):
    """State of all particles of all scenes of a batch, concatenated.

    position     [m], (3, particles)
    velocity     [m/s], (3, particles)
    affine       APIC velocity gradient C [1/s], (3, 3, particles), C[i, j] = d velocity_i / d position_j
    deformation  elastic deformation gradient F [-], (3, 3, particles)
    internal     internal variables of the laws, (variables, particles), none unless they are given
    """

    __slots__ = ()

    def __new__(
        cls,
        position: Vectors,
        velocity: Vectors,
        affine: Matrices,
        deformation: Matrices,
        internal: InternalValues | None = None,
    ) -> "ParticleState":
        if internal is None:
            internal = position.new_empty(0, position.shape[-1])
        return super().__new__(cls, position, velocity, affine, deformation, internal)

    @classmethod
    def at_rest_shape(cls, position: Vectors, velocity: Vectors, affine: Matrices | None = None) -> "ParticleState":
        """The undeformed start of a scene: F = I; C = 0, spin living only in the velocities, unless it is given."""
        identity = torch.eye(3, dtype=position.dtype, device=position.device)
        if affine is None:
            affine = position.new_zeros(3, 3, position.shape[1])
        return cls(position, velocity, affine, identity[:, :, None].expand_as(affine).clone())


class Scenes(NamedTuple):
    """The constants of a flat ragged batch of scenes.

    scene_index  the scene that each particle belongs to, (particles,)
    mass         [kg], (particles,)
    volume       initial volume [m^3], (particles,)
    gravity      [m/s^2], (3, scenes)
    load_shares  what each load of the settings gives to each particle (mpm/loads.py), (loads, particles)
    """

    scene_index: SceneIndex
    mass: Scalars
    volume: Scalars
    gravity: SceneVectors
    load_shares: Tensor = torch.zeros(0, 0)

    @property
    def constants(self) -> tuple[Tensor, ...]:
        """What the kernels take beside the scene index: mass, volume, gravity."""
        return self.mass, self.volume, self.gravity

    @property
    def scene_count(self) -> int:
        """Number of scenes of the batch."""
        return self.gravity.shape[1]
