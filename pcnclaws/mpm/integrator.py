"""The MLS-MPM step. This file is the method; the others of this folder are its vocabulary."""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

import torch
from jaxtyping import Float
from torch import Tensor, nn

from pcnclaws.compiled.calls import kernels_serve
from pcnclaws.compiled.split_step import from_grid, to_grid
from pcnclaws.compiled.step import StepSettings
from pcnclaws.compiled.step import step as compiled_step
from pcnclaws.mpm.boundaries import (
    apply_colliders,
    apply_friction_walls,
    apply_walls,
    axis_walls,
    wall_limits,
    wall_nodes,
)
from pcnclaws.mpm.grid import MOST_WHOLE, Grid, grid_of
from pcnclaws.mpm.loads import load_acceleration
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.mpm.shape_functions import quadratic_stencil
from pcnclaws.mpm.state import ParticleState, Scenes
from pcnclaws.mpm.transfer import Sent, grid_to_particles, node_velocities, sent_to_grid
from pcnclaws.tensors.linalg3 import matmul
from pcnclaws.tensors.tensor_types import Matrices

Impulses = Float[Tensor, "colliders scenes 3"]
TakeImpulses = Callable[[Impulses], None]
# Contacts of walls in the order of the kernels.
WALL_CONTACTS = ("separate", "stick of version 1", "slip", "sticky")


class MPMIntegrator(nn.Module):
    """One explicit MLS-MPM step with APIC or affine XPIC velocities, quadratic B-splines and symplectic Euler.

    source  Hu et al. 2018, "A moving least squares material point method with displacement discontinuity
            and two-way rigid body coupling"
    """

    def __init__(self, settings: SimulationSettings, window: bool = True) -> None:
        """window: let the compiled step compute only the part of the grid that particles touch."""
        super().__init__()
        self.settings, self.window = settings, window
        self.grid = grid_of(settings)
        # what the walls do without friction, kernels do
        self._on_grid = bool(settings.colliders) or settings.friction > 0.0
        self._plain = replace(settings, colliders=(), loads=())
        self._walls = b"" if settings.domain is None else axis_walls(self.grid, settings)
        self._of_whole_grid = self._kernel_settings(self.grid)

    def forward(
        self,
        state: ParticleState,
        stress: Matrices,
        scenes: Scenes,
        step: int = 0,
        take_impulses: TakeImpulses | None = None,
    ) -> ParticleState:
        """The state one time step later, with the *trial* deformation (before plastic flow).

        stress         Kirchhoff stress tau [Pa] of state.deformation, (3, 3, particles)
        step           number of steps since the start, which says where colliders are and which loads act
        take_impulses  is given the impulses of the colliders [N s]
        """
        state = self._loaded(state, scenes, step)
        served = kernels_serve(state.position, (*state[1:4], stress), scenes.constants)
        bodies = (scenes.scene_index, *scenes.constants)
        if served and not self._on_grid:
            grid = self._grid(state, by_kernel=True)
            moved = compiled_step(self.kernel_settings(grid), bodies, (*state[:4], stress))
            return ParticleState(*moved, internal=state.internal)

        grid = self._grid(state)
        if served:
            kernel = self.kernel_settings(grid)
            nodes = to_grid(kernel, bodies, (*state[:4], stress)).T.contiguous()
            velocity = self._moved(nodes, grid, scenes, step, take_impulses)
            moved = from_grid(kernel, bodies, velocity, state.position, state.deformation)
            return ParticleState(*moved, internal=state.internal)

        dt, dx = self.settings.time_step, grid.spacing
        stencil = quadratic_stencil(state.position, scenes.scene_index, grid, _offsets(grid, state.position.device))

        # particles to grid: the stress acts on the initial volume and joins the affine momentum
        sent = Sent(scenes.mass, state.velocity, state.affine, (dt * 4.0 / dx**2) * scenes.volume * stress)
        nodes = sent_to_grid(stencil, sent, self.settings.transfer_order, dx, scenes.scene_count * grid.size)
        velocity = self._moved(nodes, grid, scenes, step, take_impulses)

        # grid to particles: move with the grid, deform with its gradient
        velocity, affine = grid_to_particles(stencil, velocity, dx)
        position = state.position + dt * velocity
        deformation = state.deformation + dt * matmul(affine, state.deformation)
        return ParticleState(position, velocity, affine, deformation, state.internal)

    @property
    def is_recordable(self) -> bool:
        """Whether steps are the same work at all times, on arrays of the same sizes."""
        return not self._on_grid and not self.settings.loads and self.grid.size <= MOST_WHOLE

    def kernel_settings(self, grid: Grid) -> StepSettings:
        """What the kernels need to know of a step on this part of the grid."""
        return self._of_whole_grid if grid is self.grid else self._kernel_settings(grid)

    def _kernel_settings(self, grid: Grid) -> StepSettings:
        walls = tuple(
            self._walls[begin + low - first : begin + high - first + 1]
            for begin, first, low, high in zip(self._begins(), self.grid.low, grid.low, grid.high, strict=True)
        )
        return StepSettings(
            self.settings.time_step,
            grid.origin,
            grid.per_metre,
            (*grid.low, *grid.high),
            WALL_CONTACTS.index(self.settings.boundary),
            self.window,
            b"".join(walls),
            self.settings.transfer_order,
        )

    def _begins(self) -> tuple[int, int, int]:
        """Where the walls of each axis begin."""
        x, y, _ = self.grid.edges
        return 0, x, x + y

    def _grid(self, state: ParticleState, by_kernel: bool = False) -> Grid:
        """The part of the grid that a step is computed on.

        by_kernel  on a CPU the kernel finds the part that each scene touches itself, within a bounded domain
        """
        finds = by_kernel and not state.position.is_cuda and self.settings.domain is not None
        if finds or (self.grid.size <= MOST_WHOLE and not self._on_grid):
            return self.grid
        return self.grid.window(state.position)

    def _loaded(self, state: ParticleState, scenes: Scenes, step: int) -> ParticleState:
        """The state with the velocity that loads add in the step."""
        if not self.settings.loads:
            return state
        acceleration = load_acceleration(self.settings.loads, scenes.load_shares, self.settings.time_at(step))
        if acceleration is None:
            return state
        return state._replace(velocity=state.velocity + self.settings.time_step * acceleration)

    def _moved(
        self, nodes: Tensor, grid: Grid, scenes: Scenes, step: int, take_impulses: TakeImpulses | None
    ) -> Float[Tensor, "3 nodes"]:
        """Velocity of the nodes after gravity, walls and colliders [m/s], from their momentum and mass."""
        settings = self.settings
        velocity = node_velocities(nodes).unflatten(1, (scenes.scene_count, grid.size))
        velocity = velocity + settings.time_step * scenes.gravity[:, :, None]
        if settings.domain is not None:
            walls = _walls_of(grid, self._plain, nodes.device)
            if settings.friction > 0.0:
                velocity = apply_friction_walls(velocity, walls, settings.friction)
            else:
                limits = _limits_of(grid, self._plain, nodes.device, nodes.dtype)
                velocity = apply_walls(velocity, walls, settings.boundary, limits)
        if settings.colliders:
            mass, time = nodes[3].unflatten(0, (scenes.scene_count, grid.size)), settings.time_at(step)
            velocity, impulses = apply_colliders(velocity, mass, grid, settings.colliders, time)
            if take_impulses is not None:
                take_impulses(impulses)
        return velocity.flatten(1)


@lru_cache(maxsize=16)
def _offsets(grid: Grid, device: torch.device) -> Tensor:
    return grid.stencil_offsets().to(device)


@lru_cache(maxsize=16)
def _limits_of(grid: Grid, settings: SimulationSettings, device: torch.device, dtype: torch.dtype) -> Tensor:
    with torch.inference_mode(False):
        return wall_limits(_walls_of(grid, settings, device), dtype)


@lru_cache(maxsize=16)
def _walls_of(grid: Grid, settings: SimulationSettings, device: torch.device) -> Tensor:
    return wall_nodes(grid, settings).to(device)
