"""Checks of a training run: whole rollouts beside the recorded motions."""

import math
from collections.abc import Mapping
from typing import NamedTuple

from pcnclaws.metrics import Positions, position_mse
from pcnclaws.simulation.records import SceneRecord


class Check(NamedTuple):
    """Rollouts of recorded scenes with the model as it was.

    true       the records
    predicted  positions at the frames of each [m]; none at all where a rollout has diverged
    """

    true: tuple[SceneRecord, ...]
    predicted: tuple[Positions, ...]

    @property
    def errors(self) -> Mapping[str, float]:
        """Position MSE [m^2] by the name of the scene; empty where a rollout has diverged."""
        pairs = zip(self.true, self.predicted, strict=False)
        return {record.name: position_mse(position, record.position) for record, position in pairs}

    @property
    def mse(self) -> float:
        """Mean position MSE [m^2]; infinite where a rollout has diverged."""
        pairs = zip(self.true, self.predicted, strict=False)
        errors = [position_mse(position, record.position) for record, position in pairs]
        return sum(errors) / len(errors) if errors else math.inf
