"""Copies of an observed scene in one batch: each with numbers of its own, and with the derivative of one of them."""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd import forward_ad

from pcnclaws.data.observation import Observation
from pcnclaws.estimation.marker_weights import weights_of_growth
from pcnclaws.estimation.surroundings import displacement, gravity_of, size_of
from pcnclaws.estimation.unknowns import SIZE, Unknowns
from pcnclaws.mpm.state import ParticleState, Scenes
from pcnclaws.simulation.batch import SceneBatch
from pcnclaws.tensors.layout import matrices_first, vectors_first

# The unknown whose derivative a copy carries, and its slope; None for none.
Carried: TypeAlias = tuple[int, float] | None


class SceneCopies:
    """The body of an observation, and what the unknowns make of its start.

    Walls that are displaced are a body that is displaced the other way: grid and walls stay where they are. A body of
    another size is stretched about its centre; the markers keep their places.
    """

    def __init__(self, observation: Observation, unknowns: Unknowns, dtype: torch.dtype) -> None:
        self.observation, self.unknowns, self.dtype = observation, unknowns, dtype
        self._position = self.tensor(vectors_first(observation.position))
        self._volume = self.tensor(observation.volume)
        self._weight = self.tensor(observation.weight)
        self._of_growth = self.tensor(weights_of_growth(observation)) if unknowns.index(SIZE) else None
        self._density = None if observation.density is None else self.tensor(observation.density)
        self._rigid = {k: vectors_first(self._rigid_motion(k)) for k in unknowns.motion}
        self._gradient = {k: self._rigid_gradient(k) for k in unknowns.motion if observation.spins_have_gradient}

    @property
    def particles(self) -> int:
        """Of one copy."""
        return self._position.shape[1]

    def batch(self, values: Sequence[np.ndarray], carried: Sequence[Carried]) -> SceneBatch:
        """One copy of the scene for each entry; within a dual level where derivatives are carried."""
        copies, particles = len(values), self.particles
        of_copies = [self.unknowns.parameters(one) for one in values]
        names = sorted(of_copies[0])
        parameters = {name: self.tensor(np.concatenate([one[name] for one in of_copies])) for name in names}
        velocity = torch.cat([self.velocity(one) for one in values], dim=1)
        affine = torch.cat([self.affine(one) for one in values], dim=2)
        rates = {name: np.zeros(copies * particles) for name in names}
        velocity_rate, affine_rate = np.zeros((3, copies * particles)), np.zeros((3, 3, copies * particles))
        moving = set()
        for copy, carry in enumerate(carried):
            if carry is None:
                continue
            k, slope = carry
            unknown, where = self.unknowns.sought[k], slice(copy * particles, (copy + 1) * particles)
            if unknown.is_motion:
                far = size_of(self.unknowns, values[copy]) if unknown.name.startswith("spin") else 1.0
                velocity_rate[:, where] = slope * far * self._rigid[k]
                moving.add("velocity")
                if k in self._gradient:
                    affine_rate[:, :, where] = slope * self._gradient[k]
            elif unknown.component is not None:
                rates[unknown.name][where] = slope * unknown.component.share
                moving.add(unknown.name)
        for name in moving & set(names):
            parameters[name] = forward_ad.make_dual(parameters[name], self.tensor(rates[name]))
        if "velocity" in moving:
            velocity = forward_ad.make_dual(velocity, self.tensor(velocity_rate))
        if affine_rate.any():
            affine = forward_ad.make_dual(affine, self.tensor(affine_rate))
        position = torch.cat([self.position(one) for one in values], dim=1)
        state = ParticleState.at_rest_shape(position, velocity, affine)
        return SceneBatch(state, self._scenes(values), parameters)

    def differentiable(self, values: np.ndarray, free: Float[Tensor, " unknowns"]) -> SceneBatch:
        """The scene as a function of numbers that carry gradients.

        values  the same numbers
        """
        parameters = {name: self.tensor(known) for name, known in self.unknowns.fixed.items()}
        velocity, affine = self.velocity(values), self.affine(values)
        for k, unknown in enumerate(self.unknowns.sought):
            if unknown.is_motion:
                change = (free[k] - values[k]).to(self.dtype)
                velocity = velocity + change * self.tensor(self._rigid[k])
                if k in self._gradient:
                    affine = affine + change * self.tensor(self._gradient[k])
            elif unknown.component is not None:
                share = self.tensor(unknown.component.share)
                parameters[unknown.name] = parameters.get(unknown.name, 0.0) + free[k].to(self.dtype) * share
        state = ParticleState.at_rest_shape(self.position(values), velocity, affine)
        return SceneBatch(state, self._scenes([values]), parameters)

    def position(self, values: np.ndarray) -> Float[Tensor, "3 particles"]:
        """Of the particles at the start [m], on the grid."""
        away, size, position = displacement(self.unknowns, values), size_of(self.unknowns, values), self._position
        if size != 1.0:
            centre = position.mean(1, keepdim=True)
            position = centre + size * (position - centre)
        return position - self.tensor(away)[:, None] if away.any() else position

    def volume(self, values: np.ndarray) -> Float[Tensor, " particles"]:
        """Of the particles at the start [m^3]."""
        return size_of(self.unknowns, values) ** 3 * self._volume

    def weights(self, values: Sequence[np.ndarray]) -> Float[Tensor, "copies markers followed"]:
        """Of the particles that each marker follows [-]: others on a body of another size."""
        weight = self._weight.expand(len(values), -1, -1)
        if self._of_growth is None:
            return weight
        growth = self.tensor(np.array([1.0 / size_of(self.unknowns, one) - 1.0 for one in values]))
        return weight + growth[:, None, None] * self._of_growth

    def velocity(self, values: np.ndarray) -> Float[Tensor, "3 particles"]:
        """Of the particles at the start [m/s]."""
        known = self.observation.initial_velocity
        start = np.zeros_like(self.observation.position) if known is None else known
        velocity = vectors_first(start.astype(np.float64))
        size = size_of(self.unknowns, values)
        for k in self.unknowns.motion:
            far = size if self.unknowns.sought[k].name.startswith("spin") else 1.0
            velocity = velocity + far * values[k] * self._rigid[k]
        return self.tensor(velocity)

    def affine(self, values: np.ndarray) -> Float[Tensor, "3 3 particles"]:
        """C of the particles at the start [1/s]."""
        known = self.observation.initial_affine
        affine = np.zeros((3, 3, len(self.observation.position))) if known is None else matrices_first(known)
        for k, gradient in self._gradient.items():
            affine = affine + values[k] * gradient
        return self.tensor(affine)

    def tensor(self, values: np.ndarray) -> Tensor:
        """Numbers in the precision of the simulation."""
        return torch.as_tensor(np.ascontiguousarray(values), dtype=self.dtype)

    def _scenes(self, values: Sequence[np.ndarray]) -> Scenes:
        settings, copies = self.observation.settings, len(values)
        index = torch.arange(copies).repeat_interleave(self.particles)
        volume = torch.cat([self.volume(one) for one in values])
        along = np.array([gravity_of(self.unknowns, one, settings.gravity) for one in values]).T
        density = settings.density if self._density is None else self._density.repeat(copies)
        return Scenes(index, density * volume, volume, self.tensor(along))

    def _rigid_motion(self, k: int) -> Float[np.ndarray, "particles 3"]:
        """Velocities that a unit of a start velocity or a spin gives to its body."""
        unknown, position = self.unknowns.sought[k], self.observation.position
        share = unknown.component.share if unknown.component else np.ones(len(position))
        return share[:, None] * unknown.rigid_velocity(position, position)

    def _rigid_gradient(self, k: int) -> Float[np.ndarray, "3 3 particles"]:
        """Velocity gradients that a unit of a start velocity or a spin gives to its body."""
        unknown = self.unknowns.sought[k]
        share = unknown.component.share if unknown.component else np.ones(len(self.observation.position))
        return unknown.velocity_gradient()[:, :, None] * share
