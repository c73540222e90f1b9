"""Particles as a graph: who is near whom, and the numbers that a graph network sees of it."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int64
from scipy.spatial import KDTree
from torch import Tensor

from pcnclaws.mpm.settings import Domain

# A particle has so many neighbours at most, the nearest ones.
MOST_NEIGHBOURS = 48
# Walls farther than this are not seen [m].
WALL_SIGHT = 0.1


class Graph(NamedTuple):
    """The particles of some scenes as one graph, what they do next left out.

    senders, receivers  ends of the edges, (edges,)
    edges               displacement over the radius (3) and its length, (edges, 4)
    nodes               velocities of the last frames, distances from the walls, parameters, (particles, inputs)
    """

    senders: Int64[Tensor, " edges"]
    receivers: Int64[Tensor, " edges"]
    edges: Float[Tensor, "edges 4"]
    nodes: Float[Tensor, "particles inputs"]


def neighbours(position: Float[np.ndarray, "particles 3"], radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Senders and receivers of the edges between all particles within `radius` [m] of each other, in both directions.

    A particle has at most MOST_NEIGHBOURS edges that end at it.
    """
    count = len(position)
    nearest = min(MOST_NEIGHBOURS + 1, count)
    _, found = KDTree(position).query(position, k=nearest, distance_upper_bound=radius)
    receivers = np.repeat(np.arange(count), nearest)
    senders = found.reshape(-1)
    kept = (senders != count) & (senders != receivers)
    return senders[kept].astype(np.int64), receivers[kept].astype(np.int64)


def wall_distances(position: Float[Tensor, "particles 3"], walls: Domain) -> Float[Tensor, "particles 6"]:
    """Distance from each of the six walls over WALL_SIGHT, 1 where a wall is not seen, or where there is none.

    walls  lower and upper corner of the space between the walls [m], infinite without bounds
    """
    low, high = position - position.new_tensor(walls[0]), position.new_tensor(walls[1]) - position
    return (torch.cat((low, high), dim=1) / WALL_SIGHT).clamp(-1.0, 1.0)


def graph_of(
    history: Float[Tensor, "frames particles 3"],
    walls: Domain,
    parameters: Float[Tensor, " names"],
    unit: Tensor,
    radius: float,
) -> Graph:
    """The graph of one scene.

    history     positions of the last frames, the newest at the end [m], in double precision: differences count
    walls       lower and upper corner of the space between the walls [m]
    parameters  what is known of the material, standardised
    unit        displacement between two frames that counts as one [m]
    radius      within which particles are neighbours [m]
    """
    newest, dtype = history[-1], parameters.dtype
    senders, receivers = (torch.from_numpy(ends).to(newest.device) for ends in neighbours(newest.cpu().numpy(), radius))
    displacement = (newest[senders] - newest[receivers]) / radius
    edges = torch.cat((displacement, displacement.norm(dim=1, keepdim=True)), dim=1)
    velocities = (history.diff(dim=0) / unit).transpose(0, 1).flatten(1)
    nodes = torch.cat((velocities, wall_distances(newest, walls), parameters.expand(len(newest), -1)), dim=1)
    return Graph(senders, receivers, edges.to(dtype), nodes.to(dtype))


def joined(graphs: Sequence[Graph]) -> Graph:
    """Several graphs as one without edges between them."""
    firsts = np.cumsum([0, *(len(graph.nodes) for graph in graphs)]).tolist()
    return Graph(
        torch.cat([graph.senders + first for graph, first in zip(graphs, firsts, strict=False)]),
        torch.cat([graph.receivers + first for graph, first in zip(graphs, firsts, strict=False)]),
        torch.cat([graph.edges for graph in graphs]),
        torch.cat([graph.nodes for graph in graphs]),
    )
