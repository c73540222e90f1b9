"""The MLS-MPM step. This file is the method; the others of this folder are its vocabulary."""

import torch
from torch import Tensor, nn

from pcnclaws.compiled.calls import kernels_serve
from pcnclaws.compiled.step import StepSettings
from pcnclaws.compiled.step import step as compiled_step
from pcnclaws.linalg3 import matmul
from pcnclaws.mpm.boundaries import apply_walls, axis_walls, wall_nodes
from pcnclaws.mpm.grid import Grid
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.mpm.shape_functions import quadratic_stencil
from pcnclaws.mpm.state import ParticleState, Scenes
from pcnclaws.mpm.transfer import grid_to_particles, particles_to_grid
from pcnclaws.tensor_types import Matrices


class MPMIntegrator(nn.Module):
    """One explicit MLS-MPM step with APIC velocities, quadratic B-splines and symplectic Euler.

    source  Hu et al. 2018, "A moving least squares material point method with displacement discontinuity
            and two-way rigid body coupling"
    """

    stencil_offsets: Tensor
    walls: Tensor

    def __init__(self, settings: SimulationSettings, window: bool = True) -> None:
        """window: let the compiled step compute only the part of the grid that particles touch."""
        super().__init__()
        self.settings = settings
        self.grid = Grid(settings.grid_nodes)
        self.kernel_settings = StepSettings(
            settings.time_step,
            settings.grid_nodes,
            settings.boundary == "stick",
            window,
            axis_walls(self.grid, settings.wall_distance),
        )
        self.register_buffer("stencil_offsets", self.grid.stencil_offsets(), persistent=False)
        self.register_buffer("walls", wall_nodes(self.grid, settings.wall_distance), persistent=False)

    def forward(self, state: ParticleState, stress: Matrices, scenes: Scenes) -> ParticleState:
        """The state one time step later, with the *trial* deformation (before plastic flow).

        stress  Kirchhoff stress tau [Pa] of state.deformation, (3, 3, particles)
        """
        constants = (scenes.mass, scenes.volume, scenes.gravity)
        if kernels_serve(state.position, (*state[1:], stress), constants):
            bodies = (scenes.scene_index, *constants)
            return ParticleState(*compiled_step(self.kernel_settings, bodies, (*state, stress)))

        dt, dx = self.settings.time_step, self.grid.spacing
        stencil = quadratic_stencil(state.position, scenes.scene_index, self.grid, self.stencil_offsets)

        # particles to grid: the stress acts on the initial volume and joins the affine momentum
        affine_momentum = scenes.mass * state.affine - (dt * 4.0 / dx**2) * scenes.volume * stress
        nodes = particles_to_grid(
            stencil, scenes.mass, scenes.mass * state.velocity, affine_momentum, dx, scenes.scene_count * self.grid.size
        )

        # on the grid: gravity and walls
        velocity = self._velocity(nodes).unflatten(1, (scenes.scene_count, self.grid.size))
        velocity = apply_walls(velocity + dt * scenes.gravity[:, :, None], self.walls, self.settings.boundary)

        # grid to particles: move with the grid, deform with its gradient
        velocity, affine = grid_to_particles(stencil, velocity.flatten(1), dx)
        position = state.position + dt * velocity
        deformation = state.deformation + dt * matmul(affine, state.deformation)
        return ParticleState(position, velocity, affine, deformation)

    @staticmethod
    def _velocity(nodes: Tensor) -> Tensor:
        """Momentum over mass wherever there is mass, (3, nodes).

        Masses so small that dividing by them could overflow in the backward pass count as none: such a node
        has a weight below 1e-30 in everything it gives back.
        """
        momentum, mass = nodes[:3], nodes[3]
        occupied = mass > torch.finfo(mass.dtype).tiny * 1e3
        return torch.where(occupied, momentum / torch.where(occupied, mass, 1.0), 0.0)
