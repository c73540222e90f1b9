"""Learned simulators: models without constitutive laws, which move scenes by themselves."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, TypeAlias

from torch import Tensor, nn
from torch.utils.data import Dataset

from pcnclaws.laws.analytic import Laws
from pcnclaws.simulation.execution import Progress
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.simulation.scenes import SceneStart


class MotionModel(nn.Module, ABC):
    """Positions from positions. It knows neither stress nor deformation, and takes steps of its own length."""

    parameter_names: tuple[str, ...]

    @abstractmethod
    def simulate(
        self, starts: Sequence[SceneStart], plan: FramePlan, progress: Progress | None = None
    ) -> list[SceneRecord]:
        """Moves scenes and records their positions; results in the order of `starts`.

        plan      length of the motion and distance of its frames, in steps of the scenes' own settings
        progress  called with the number of steps just done, of `plan.steps` in all
        raises    SimulationDiverged, naming the scene; UserError for frames that the model has no step for
        """

    @abstractmethod
    def windows(self, records: Sequence[SceneRecord], count: int, batch: int, noise: float, seed: int) -> Dataset[Any]:
        """The batches of a training: short pieces of recorded motions with what came next; sets the model's units.

        count  number of batches; batch i depends on (seed, i) alone
        batch  pieces of a batch
        noise  standard deviation of the noise on the last input position [m]
        """

    @abstractmethod
    def loss(self, batch: Any) -> tuple[Tensor, Tensor]:
        """What training minimises [-], and the squared error of the next positions [m^2]."""


# What a run folder holds: the laws of a simulator that we have, or a simulator.
Model: TypeAlias = Laws | MotionModel
