"""Estimation as a Lightning module: the laws are frozen, the physical parameters of a scene are what is optimised."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from lightning.pytorch import LightningModule
from torch import Tensor, nn

from pcnclaws.errors import SimulationDiverged, UserError, unknown_name
from pcnclaws.estimation.levenberg_marquardt import LevenbergMarquardt
from pcnclaws.estimation.problem import EstimationProblem, Linearisation

ESTIMATORS = ("gauss_newton", "adam", "sgd")
# The optimiser sees the loss times this: squared metres are tiny numbers.
LOSS_SCALE = 1e4
# A step of gradient descent that makes the simulation diverge is halved so often, and then given up.
MOST_HALVINGS = 8


@dataclass(frozen=True)
class EstimatorSettings:
    """How the unknowns are searched.

    name           gauss_newton: Levenberg-Marquardt with exact Jacobians; adam and sgd: the paper's way
    iterations     at most
    learning_rate  of adam and sgd, in coordinates
    """

    name: str = "gauss_newton"
    iterations: int = 30
    learning_rate: float = 0.1

    def __post_init__(self) -> None:
        if self.name not in ESTIMATORS:
            raise unknown_name("estimator", self.name, ESTIMATORS)
        if not self.learning_rate > 0.0:
            raise UserError(f"estimator.learning_rate={self.learning_rate} is not accepted; accepted: above 0")


class InverseModule(LightningModule):
    """Optimises the unknowns of an observation; each training step is one iteration.

    problem    the observation, with laws whose weights stay as they are
    start      coordinates where the search begins, (unknowns,)
    estimator  see EstimatorSettings

    `history` holds the numbers (unknowns,) and the mean squared error [m^2] of every iteration, the start first.
    """

    coordinates: nn.Parameter

    def __init__(
        self, problem: EstimationProblem, start: Float[np.ndarray, " unknowns"], estimator: EstimatorSettings
    ) -> None:
        super().__init__()
        self.problem, self.estimator = problem, estimator
        self.coordinates = nn.Parameter(torch.tensor(start, dtype=torch.float64))
        self.automatic_optimization = estimator.name != "gauss_newton"
        self.search = LevenbergMarquardt()
        self.history: list[tuple[list[float], float]] = []
        self._at: Linearisation | None = None
        # the last coordinates of gradient descent with a finite gradient
        self._good: Tensor | None = None

    @property
    def u(self) -> Float[np.ndarray, " unknowns"]:
        """The coordinates now."""
        return self.coordinates.detach().numpy().copy()

    @property
    def iterations(self) -> int:
        """How many were done; the history of Gauss-Newton holds its start, too."""
        return max(len(self.history) - (not self.automatic_optimization), 0)

    def linearisation(self) -> Linearisation:
        """The motion around the coordinates now."""
        if self._at is None:
            self._at = self.problem.linearise(self.u)
        return self._at

    def training_step(self, batch: Any, batch_idx: int) -> Tensor | None:
        return self._differentiated() if self.automatic_optimization else self._gauss_newton()

    def configure_optimizers(self) -> Any:
        if not self.automatic_optimization:
            return None
        kinds = {"adam": torch.optim.Adam, "sgd": torch.optim.SGD}
        return kinds[self.estimator.name]([self.coordinates], lr=self.estimator.learning_rate)

    def on_before_optimizer_step(self, optimizer: torch.optim.Optimizer) -> None:
        """Goes halfway back where the gradient is not finite though the simulation is: a step would end the search."""
        gradient = self.coordinates.grad
        if gradient is None or bool(torch.isfinite(gradient).all()):
            self._good = self.coordinates.detach().clone()
            return
        self.coordinates.grad = None  # the optimiser leaves the coordinates alone
        if self._good is not None:
            with torch.no_grad():
                self.coordinates.lerp_(self._good, 0.5)

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        checkpoint["search"] = [self.search.damping, self.search.done]
        checkpoint["history"] = [[list(values), mse] for values, mse in self.history]

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        self.search = LevenbergMarquardt(*checkpoint["search"])
        self.history = [(list(values), mse) for values, mse in checkpoint["history"]]
        self._at = None

    def _gauss_newton(self) -> None:
        here = self.linearisation()
        if not self.history:
            self._note(self.u, here.mse)
        if not np.isfinite(here.mse):
            raise SimulationDiverged(
                "the simulation of the initial guess diverges; choose a softer initial_guess or screening above 0"
            )
        step = self.search.step(here, self.problem.unknowns.reach(self.u))
        there = self.problem.linearise(self.u + step)
        if self.search.judge(here.mse, there.mse, step):
            with torch.no_grad():
                self.coordinates.add_(torch.as_tensor(step))
            self._at = there
        self._note(self.u, self.linearisation().mse)
        self.trainer.should_stop = self.search.done

    def _differentiated(self) -> Tensor:
        loss = self.problem.loss(self.coordinates)
        for _ in range(MOST_HALVINGS):
            if bool(torch.isfinite(loss)) or self._good is None:
                break
            with torch.no_grad():
                self.coordinates.lerp_(self._good, 0.5)
            loss = self.problem.loss(self.coordinates)
        if not bool(torch.isfinite(loss)):
            raise SimulationDiverged(
                f"the simulation diverges at iteration {len(self.history)}; lower estimator.learning_rate or choose "
                "estimator=gauss_newton"
            )
        self._note(self.u, float(loss.detach()))
        self._at = None
        return LOSS_SCALE * loss

    def _note(self, u: Float[np.ndarray, " unknowns"], mse: float) -> None:
        """Keeps an iteration, and shows it in TensorBoard."""
        values = self.problem.unknowns.values(u)
        self.history.append((values.tolist(), mse))
        self.log("mse", mse, batch_size=1)
        for unknown, value in zip(self.problem.unknowns.sought, values.tolist(), strict=True):
            self.log(unknown.label, value, batch_size=1)
