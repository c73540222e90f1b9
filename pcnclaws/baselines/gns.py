"""GNS, a graph network that simulates: positions of the last frames to positions of the next one."""

import copy
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import Dataset

from pcnclaws.baselines.graph_network import GraphNetwork
from pcnclaws.baselines.graphs import graph_of
from pcnclaws.baselines.windows import FRAMES, WindowDataset, Windows, before_start, recorded_motion, walls_alone
from pcnclaws.errors import SimulationDiverged, UserError
from pcnclaws.laws.materials import Material
from pcnclaws.simulation.execution import SINGLE_ON_CPU, Execution, Progress
from pcnclaws.simulation.motion import MotionModel
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.records import TIME_TOLERANCE, SceneRecord
from pcnclaws.simulation.scenes import SceneStart, group_by_settings

# Velocities of five frames, and the distances from six walls.
INPUTS = 3 * (FRAMES - 1) + 6
LARGEST_WIDTH, MOST_STEPS = 512, 20


class GraphNetworkSimulator(MotionModel):
    """x_(n+1) = 2 x_n - x_(n-1) + a, the change of velocity a by a graph network, a frame of the training data a step.

    The physical parameters are further inputs, standardised by the ranges of the material. Units of velocity and of its
    change are their root mean squares in the training data, with the noise, kept with the weights.

    source  Sanchez-Gonzalez et al. 2020, "Learning to simulate complex physics with graph networks"
    """

    frame_time: Tensor
    velocity_unit: Tensor
    change_unit: Tensor

    def __init__(self, material: Material, width: int, message_passing_steps: int, radius: float) -> None:
        super().__init__()
        self.radius = radius
        self.parameter_names, self.ranges = material.parameter_names, dict(material.ranges)
        self.network = GraphNetwork(INPUTS + len(self.parameter_names), width, message_passing_steps)
        for name in ("frame_time", "velocity_unit", "change_unit"):
            self.register_buffer(name, torch.ones((), dtype=torch.float64))

    def simulate(
        self, starts: Sequence[SceneStart], plan: FramePlan, execution: Execution = SINGLE_ON_CPU
    ) -> list[SceneRecord]:
        placed = copy.deepcopy(self).to(execution.device, execution.dtype)
        motions = placed._motions(starts, plan, execution.progress)
        return [_record(start, motion, plan.every) for start, motion in zip(starts, motions, strict=True)]

    def windows(self, records: Sequence[SceneRecord], count: int, batch: int, noise: float, seed: int) -> Dataset[Any]:
        times = np.concatenate([np.diff(record.time) for record in records])
        if times.max() - times.min() > 1e-3 * times.max():
            raise UserError("the frames of the training scenes are not equally far apart; model=gns needs them so")
        self.frame_time.fill_(float(np.median(times)))
        motions = [
            recorded_motion(record, self._standardised(record.parameters), self.frame_time.item()) for record in records
        ]
        velocity = np.concatenate([np.diff(motion.position, axis=0).ravel() for motion in motions])
        change = np.concatenate([np.diff(motion.position, n=2, axis=0).ravel() for motion in motions])
        self.velocity_unit.fill_(math.hypot(_root_mean_square(velocity), noise))
        self.change_unit.fill_(math.hypot(_root_mean_square(change), noise))
        return WindowDataset(motions, count, batch, noise=noise, seed=seed, unit=self.velocity_unit, radius=self.radius)

    def loss(self, batch: Windows) -> tuple[Tensor, Tensor]:
        error = self.network(batch.graph) - batch.change / self.change_unit.to(batch.change.dtype)
        squared = error.square().mean()
        return squared, squared.detach() * self.change_unit.square()

    def _motions(self, starts: Sequence[SceneStart], plan: FramePlan, progress: Progress | None) -> list[Tensor]:
        """Positions of the frames of every scene [m], each (frames, particles, 3), in the precision of the weights."""
        every, groups = plan.every, len(group_by_settings(starts))
        own_steps = [self._own_steps(start, every) for start in starts]
        pasts = [
            np.concatenate((before_start(start, self.frame_time.item()), start.position[None])) for start in starts
        ]
        histories = [torch.as_tensor(past, dtype=torch.float64, device=self.frame_time.device) for past in pasts]
        frames = [[history[-1]] for history in histories]
        with torch.no_grad():
            for _ in range(plan.steps // every):
                for k, start in enumerate(starts):
                    for _ in range(own_steps[k]):
                        histories[k] = self._advanced(histories[k], start)
                    frames[k].append(histories[k][-1])
                if progress:
                    progress(every * groups)
        dtype = next(self.parameters()).dtype
        return [torch.stack(of_scene).to(dtype) for of_scene in frames]

    def _own_steps(self, start: SceneStart, every: int) -> int:
        """Steps of this simulator from one frame to the next."""
        spacing, own = every * start.settings.time_step, self.frame_time.item()
        count = round(spacing / own)
        if count < 1 or abs(spacing / own - count) > TIME_TOLERANCE:
            raise UserError(
                f"scene '{start.name}': frames {spacing:g} s apart are not accepted by this model=gns; "
                f"accepted: multiples of {own:g} s, the distance of the frames that it was trained on"
            )
        return count

    def _history(self, start: SceneStart) -> Tensor:
        """The last FRAMES positions at the start [m], (FRAMES, particles, 3), double precision."""
        position = np.concatenate((before_start(start, self.frame_time.item()), start.position[None]))
        return torch.as_tensor(position, dtype=torch.float64, device=self.frame_time.device)

    def _advanced(self, history: Tensor, start: SceneStart) -> Tensor:
        """The last FRAMES positions one frame later; double precision, since their differences count."""
        if not bool(torch.isfinite(history[-1]).all()):
            raise SimulationDiverged(f"scene '{start.name}' diverged: positions of the graph network are not finite")
        parameters = self._standardised(start.parameters).to(next(self.parameters()))
        walls = walls_alone(start.settings, f"scene '{start.name}'")
        graph = graph_of(history, walls, parameters, self.velocity_unit, self.radius)
        change = self.network(graph).double() * self.change_unit
        return torch.cat((history[1:], (2.0 * history[-1] - history[-2] + change)[None]))

    def _standardised(self, parameters: Mapping[str, float]) -> Tensor:
        """The physical parameters scaled to [-1, 1] over the ranges of the material, (names,)."""
        lower, upper = torch.tensor([self.ranges[name] for name in self.parameter_names]).T
        values = torch.tensor([parameters[name] for name in self.parameter_names])
        return (2.0 * values - lower - upper) / (upper - lower)


def gns(material: Material, fields: Mapping[str, object]) -> GraphNetworkSimulator:
    """An untrained simulator from the plain fields of a `model` config: width, message_passing_steps and radius."""
    found = []
    for option, most in (("width", LARGEST_WIDTH), ("message_passing_steps", MOST_STEPS)):
        value = fields.get(option)
        if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= most:
            raise UserError(f"model.{option}={value} is not accepted; accepted: a whole number from 1 to {most}")
        found.append(value)
    radius = fields.get("radius")
    if isinstance(radius, bool) or not isinstance(radius, (int, float)) or not 0.0 < radius <= 1.0:
        raise UserError(f"model.radius={radius} is not accepted; accepted: a number above 0 and at most 1 [m]")
    width, steps = found
    return GraphNetworkSimulator(material, width, steps, float(radius))


def _record(start: SceneStart, frames: Tensor, every: int) -> SceneRecord:
    position = frames.cpu().numpy()
    time = start.settings.time_step * every * np.arange(len(position))
    return SceneRecord(
        start.name,
        start.material,
        start.settings,
        start.parameters,
        time=time,
        position=position,
        volume=start.volume.astype(position.dtype),
        initial_velocity=start.velocity.astype(position.dtype),
    )


def _root_mean_square(values: np.ndarray) -> float:
    return float(np.sqrt(np.square(values).mean()))
