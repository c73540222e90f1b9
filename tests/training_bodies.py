"""Small scenes and laws for the tests of training: a body of 64 particles that lands within a few dozen steps."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from torch import nn

from pcnclaws.laws.analytic import Laws
from pcnclaws.laws.base import Elasticity
from pcnclaws.laws.elasticity import FixedCorotated
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.simulation.scenes import SceneStart
from pcnclaws.tensors.tensor_types import Matrices, Parameters

SETTINGS = SimulationSettings(time_step=1e-3, grid_spacing=1 / 12)
STEPS, EVERY, KEYFRAME_EVERY = 40, 5, 10


class Scaled(Elasticity):
    """Fixed corotated with a trainable factor: the smallest law that can learn."""

    parameter_names = ("youngs_modulus", "poissons_ratio")

    def __init__(self, factor: float = 0.7) -> None:
        super().__init__()
        self.factor = nn.Parameter(torch.tensor(factor))
        self.law = FixedCorotated()

    def kirchhoff_stress(self, deformation: Matrices, parameters: Parameters) -> Matrices:
        return self.factor * self.law(deformation, parameters)


def starts(count: int, settings: SimulationSettings = SETTINGS) -> list[SceneStart]:
    """Cubes of 4 x 4 x 4 particles just above the floor, moving down, of different parameters."""
    axis = np.linspace(0.0, 0.25, 4)
    lattice = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    position = lattice + np.array([0.375, 0.2, 0.375])
    velocity = np.tile([0.3, -1.5, 0.0], (64, 1))
    return [
        SceneStart(
            f"body_{k}",
            "elasticity",
            settings,
            {"youngs_modulus": 2e4 * (1.0 + 0.3 * k), "poissons_ratio": 0.2 + 0.03 * k},
            position,
            velocity,
            np.full(64, 0.25**3 / 64),
        )
        for k in range(count)
    ]


def lifted(start: SceneStart, height: float) -> SceneStart:
    """The same start so much higher up [m]."""
    return replace(start, position=start.position + np.array([0.0, height, 0.0]))


def recorded(count: int, elasticity: Elasticity | None = None, keyframes: bool = True) -> list[SceneRecord]:
    """Recorded motions of these bodies."""
    laws = Laws(elasticity or FixedCorotated(), None)
    return simulate_records(starts(count), laws, FramePlan(STEPS, EVERY, KEYFRAME_EVERY if keyframes else 0))


def hidden(records: Sequence[SceneRecord], frame: int, particle: int) -> list[SceneRecord]:
    """The same records with one particle unobserved from a frame on."""
    changed = []
    for record in records:
        position = record.position.copy()
        position[frame:, particle] = np.nan
        changed.append(replace(record, position=position))
    return changed
