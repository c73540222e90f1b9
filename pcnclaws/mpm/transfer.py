"""Particle to grid and back: MLS-MPM with affine velocities, as vectorised scatter-add and gather.

APIC loses in each step what velocities and gradients of particles do not hold of those of the grid, so that many short
steps damp more than few long ones. Affine XPIC gives most of it back. With v_0 the velocities of the nodes by APIC,
and A their way to the particles and back to the grid, which leaves affine motions as they are and makes none larger,

    v* = v_0 + (I - A) v_0 + ... + (I - A)^(m-1) v_0

Where APIC loses a share e of a motion in a step, this loses e^m. Linear and angular momentum are those of APIC in every
order m, since the terms after the first have none.

source  Hammerquist and Nairn 2017, "A new method for material point method particle updates that reduces noise and
        enhances stability": XPIC(m), with velocities of particles alone in the place of velocities and gradients
"""

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from pcnclaws.mpm.shape_functions import Stencil
from pcnclaws.tensors.tensor_types import Matrices, Scalars, Vectors

# The 27 stencil nodes as 3 x 3 x 3, and the position of a node relative to the middle one in units of dx.
STENCIL_SHAPE = (3, 3, 3)


class Sent(NamedTuple):
    """What particles give to the grid.

    mass      [kg], (particles,)
    velocity  v [m/s], (3, particles)
    affine    C [1/s], (3, 3, particles)
    pull      what their stress takes from their affine momentum in the step, dt V 4/dx^2 tau [kg/s], (3, 3, particles)
    """

    mass: Scalars
    velocity: Vectors
    affine: Matrices
    pull: Matrices


def sent_to_grid(stencil: Stencil, sent: Sent, order: int, spacing: float, grid_size: int) -> Float[Tensor, "4 nodes"]:
    """Momentum (3 rows) and mass (last row) of every grid node, by affine XPIC.

    The stress acts once, as in APIC: forces are those of the mass of the nodes.

    order    m, 1 for APIC
    returns  [kg m/s] and [kg], (4, nodes)
    """
    mass = sent.mass
    own = mass * sent.affine
    if order == 1:
        return particles_to_grid(stencil, mass, mass * sent.velocity, own - sent.pull, spacing, grid_size)
    nodes = particles_to_grid(stencil, mass, mass * sent.velocity, own, spacing, grid_size)
    momentum, part = nodes[:3], nodes
    for left in range(order - 1, 0, -1):
        velocity, affine = grid_to_particles(stencil, node_velocities(part), spacing)
        back = mass * affine if left > 1 else mass * affine + sent.pull
        part = part - particles_to_grid(stencil, mass, mass * velocity, back, spacing, grid_size)
        momentum, part = momentum + part[:3], torch.cat((part[:3], nodes[3:]))
    return torch.cat((momentum, nodes[3:]))


def node_velocities(nodes: Float[Tensor, "4 nodes"]) -> Float[Tensor, "3 nodes"]:
    """Momentum over mass wherever there is mass [m/s], (3, nodes).

    Masses so small that dividing by them could overflow in the backward pass count as none: such a node
    has a weight below 1e-30 in everything it gives back.
    """
    momentum, mass = nodes[:3], nodes[3]
    occupied = mass > torch.finfo(mass.dtype).tiny * 1e3
    return torch.where(occupied, momentum / torch.where(occupied, mass, 1.0), 0.0)


def particles_to_grid(
    stencil: Stencil, mass: Scalars, momentum: Vectors, affine_momentum: Matrices, spacing: float, grid_size: int
) -> Float[Tensor, "4 nodes"]:
    """Momentum (3 rows) and mass (last row) of every grid node.

        m_i = sum_p w_ip m_p,    (m v)_i = sum_p w_ip (m_p v_p + A_p (x_i - x_p))

    mass             [kg], (particles,)
    momentum         m v [kg m/s], (3, particles)
    affine_momentum  A = m C - dt V 4/dx^2 tau [kg/s], (3, 3, particles)
    spacing          dx [m]
    grid_size        number of nodes of all grids of the batch
    returns          [kg m/s] and [kg], (4, nodes)
    source           Hu et al. 2018, "A moving least squares material point method", eq. 16 and 29
    """
    # momentum at node (i, j, k) of the stencil is q + i A_x + j A_y + k A_z: 27 outputs from 4 vectors
    step = affine_momentum * spacing
    at_middle = momentum - (step * stencil.from_middle).sum(1)
    along_x, along_y, along_z = (_from_middle_node(step[:, axis]) for axis in range(3))
    at_xy = (at_middle[:, None] + along_x)[:, :, None] + along_y[:, None]
    at_node = (at_xy[:, :, :, None] + along_z[:, None, None]).flatten(1, 3)

    contribution = torch.cat((at_node, mass.expand(1, 27, -1))) * stencil.weight
    grid = mass.new_zeros(4, grid_size)
    return grid.index_add(1, stencil.node.flatten(), contribution.flatten(1))


def grid_to_particles(
    stencil: Stencil, grid_velocity: Float[Tensor, "3 nodes"], spacing: float
) -> tuple[Vectors, Matrices]:
    """Velocity and affine velocity gradient of every particle.

        v_p = sum_i w_ip v_i,    C_p = 4/dx^2 sum_i w_ip v_i (x_i - x_p)^T

    grid_velocity  [m/s], (3, nodes)
    spacing        dx [m]
    returns        velocity [m/s], (3, particles), and C [1/s], (3, 3, particles)
    source         Jiang et al. 2015, "The affine particle-in-cell method", eq. 10 (quadratic kernels: D = dx^2/4 I)
    """
    particles = stencil.weight.shape[1]
    gathered = grid_velocity.index_select(1, stencil.node.flatten()).unflatten(1, (27, particles))
    weighted = (gathered * stencil.weight).unflatten(1, STENCIL_SHAPE)

    by_xy = weighted.sum(3)
    by_x, by_y, by_z = by_xy.sum(2), by_xy.sum(1), weighted.sum((1, 2))
    velocity = by_x.sum(1)
    # sum_i w v_i (x_i - x_p)^T: first moment about the middle node, shifted to the particle
    moment = torch.stack([by_axis[:, 2] - by_axis[:, 0] for by_axis in (by_x, by_y, by_z)], dim=1)
    affine = (moment - velocity[:, None] * stencil.from_middle) * (4.0 / spacing)
    return velocity, affine


def _from_middle_node(per_cell: Vectors) -> Tensor:
    """The values -a, 0, a at the three nodes of an axis, (3, 3 nodes, particles)."""
    return torch.stack((-per_cell, torch.zeros_like(per_cell), per_cell), dim=1)
