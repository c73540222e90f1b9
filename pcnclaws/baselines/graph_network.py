"""A graph network: encoder, message passing, decoder; sums over neighbours are PyTorch's index_add."""

import torch
from torch import Tensor, nn

from pcnclaws.baselines.graphs import Graph


class GraphNetwork(nn.Module):
    """Encode, process, decode: (particles, inputs) and edges -> (particles, 3).

    Every block of the processor computes a message for each edge from the edge and its two ends, and a change of each
    particle from the sum of its messages; both are added to what was there. The decoder starts at zero: an untrained
    network changes nothing.

    source  Sanchez-Gonzalez et al. 2020, "Learning to simulate complex physics with graph networks", section 3
    """

    def __init__(self, inputs: int, width: int, steps: int) -> None:
        super().__init__()
        self.encode_nodes, self.encode_edges = _mlp(inputs, width), _mlp(4, width)
        self.messages = nn.ModuleList(_Message(width) for _ in range(steps))
        self.updates = nn.ModuleList(_mlp(2 * width, width) for _ in range(steps))
        self.decode = nn.Sequential(nn.Linear(width, width), nn.ReLU(), nn.Linear(width, 3))
        for weight in self.decode[-1].parameters():
            nn.init.zeros_(weight)

    def forward(self, graph: Graph) -> Tensor:
        nodes, edges = self.encode_nodes(graph.nodes), self.encode_edges(graph.edges)
        for message, update in zip(self.messages, self.updates, strict=True):
            edges = edges + message(nodes, edges, graph)
            received = torch.zeros_like(nodes).index_add(0, graph.receivers, edges)
            nodes = nodes + update(torch.cat((nodes, received), dim=1))
        return self.decode(nodes)


class _Message(nn.Module):
    """MLP(edge, sender, receiver). Its first layer is applied to each particle once, not to each of its edges."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.of_edge = nn.Linear(width, width)
        self.of_sender, self.of_receiver = nn.Linear(width, width, bias=False), nn.Linear(width, width, bias=False)
        self.rest = nn.Sequential(nn.ReLU(), nn.Linear(width, width), nn.LayerNorm(width))

    def forward(self, nodes: Tensor, edges: Tensor, graph: Graph) -> Tensor:
        # index_select and not nodes[...], whose derivative is many times slower on the CPU
        sent = self.of_sender(nodes).index_select(0, graph.senders)
        received = self.of_receiver(nodes).index_select(0, graph.receivers)
        return self.rest(self.of_edge(edges) + sent + received)


def _mlp(inputs: int, width: int) -> nn.Sequential:
    return nn.Sequential(nn.Linear(inputs, width), nn.ReLU(), nn.Linear(width, width), nn.LayerNorm(width))
