"""Simulators of scenes: what training, evaluation and estimation ask of a model, and learned ones without laws."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

from torch import Tensor, nn
from torch.utils.data import Dataset

from pcnclaws.laws.analytic import Laws
from pcnclaws.simulation.execution import SINGLE_ON_CPU, Execution
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.simulation.scenes import SceneStart


class SceneSimulator(nn.Module, ABC):
    """Map from initial conditions to motions. What a run folder holds and every command takes; see LawSimulator."""

    @property
    def laws(self) -> Laws | None:
        """The constitutive laws that it simulates with; None: it knows neither stress nor full states."""
        return None

    @property
    def one_step(self) -> "MotionModel | None":
        """The simulator as one that learns from single steps; None where it does not."""
        return None

    @abstractmethod
    def simulate(
        self, starts: Sequence[SceneStart], plan: FramePlan, execution: Execution = SINGLE_ON_CPU
    ) -> list[SceneRecord]:
        """Moves scenes and records them; results in the order of `starts`. The simulator itself stays as it is.

        plan       length of the motions and what is kept of them, in steps of the scenes' own settings
        execution  its progress hears of plan.steps x len(group_by_settings(starts)) steps in all
        raises     SimulationDiverged, naming the scene; UserError for frames that the simulator has no step for
        """


class MotionModel(SceneSimulator):
    """Learned simulator: positions from positions, in steps of its own length and without constitutive laws."""

    parameter_names: tuple[str, ...]

    @property
    def one_step(self) -> "MotionModel":
        return self

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
