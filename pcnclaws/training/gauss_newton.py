"""Gauss-Newton for laws whose weights are amounts of known functions: the last digits, which Adam does not find."""

import copy
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol, cast

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.autograd import forward_ad

from pcnclaws.data.dataset import SegmentBatch
from pcnclaws.errors import UserError
from pcnclaws.laws.analytic import Laws
from pcnclaws.laws.networks import ConditionedAmounts
from pcnclaws.simulation.rollout import differentiable_rollout
from pcnclaws.simulation.simulator import Simulator
from pcnclaws.training.losses import position_loss, relative_units, unstressed_positions
from pcnclaws.training.multi_scene import MultiSceneModule

# What keeps amounts that no segment shows at zero.
RIDGE = 1e-2
# Squared error of a segment, relative to its motion by stress, that is the rounding of recorded states.
ROUNDING = 1e-7


class GaussNewtonModule(MultiSceneModule):
    """Least squares over all segments so far, each linearised where the weights were when it came.

        (sum_s f_s J_s^T J_s + RIDGE I) w = sum_s f_s J_s^T (J_s w_s - r_s),   f_s = 1/(|r_s|^2 + ROUNDING)

    with the residuals r_s of segment s, positions relative to its motion by stress, and their derivatives J_s by the
    weights. The factors f_s are those of least logarithms of the errors: what the law explains to its rounding says
    more than what no law of this form explains, or than a segment that came early. As a segment sees the amounts of its
    own scene alone, J_s = (derivatives by the amounts) x (features of the scene's parameters): one rollout in forward
    mode for each amount, whatever the features.

    In double precision, whatever the run's: the residuals end at the rounding of recorded states. See training_step
    for why Lightning sees an optimiser.
    """

    information: Tensor
    moment: Tensor

    def __init__(self, laws: Laws, *arguments: object, **options: object) -> None:
        self.check(laws)
        # whatever acts beside the elasticity acts here, too: it has no weights
        others = (law if law is None else copy.deepcopy(law).double() for law in laws[1:])
        super().__init__(Laws(copy.deepcopy(laws.elasticity).double(), *others), *arguments, **options)  # type: ignore[arg-type]
        count = self._amounts.weight.numel()
        self.register_buffer("information", torch.zeros(count, count, dtype=torch.float64))
        self.register_buffer("moment", torch.zeros(count, dtype=torch.float64))

    @staticmethod
    def check(laws: Laws) -> None:
        """Refuses laws that this method does not serve."""
        check_linear(laws)

    @property
    def _law(self) -> "_LinearLaw":
        return cast(_LinearLaw, self.laws.elasticity)

    @property
    def _amounts(self) -> ConditionedAmounts:
        return self._law.amounts

    def training_step(self, batch: SegmentBatch, batch_idx: int) -> Tensor:
        """A loss whose gradient is the way to the new weights, backwards: gradient descent with step 1 goes there.

        So all that watches gradients, keeps the best weights and goes on from checkpoints serves this module, too.
        """
        weight = self._amounts.weight
        predicted, derivatives = self._linearised(batch)
        self.log("loss", position_loss(predicted, batch.target), batch_size=1)
        self.log("segment_length", float(batch.steps), batch_size=1)
        residual, derivatives = self._relative(batch, predicted, derivatives)
        information, gradient = self._normal_equations(batch, residual, derivatives)

        now = weight.detach().flatten()
        moment = information @ now - gradient
        if bool(torch.isfinite(moment).all()):
            self.information, self.moment = self.information + information, self.moment + moment
            ridge = RIDGE * torch.eye(len(now), dtype=now.dtype, device=now.device)
            wanted = torch.linalg.solve(self.information + ridge, self.moment)
        else:  # a diverged segment: the iteration is skipped
            wanted = torch.full_like(now, torch.nan)
        return ((now - wanted).view_as(weight) * weight).sum()

    def configure_optimizers(self) -> torch.optim.Optimizer:
        return torch.optim.SGD([self._amounts.weight], lr=1.0)

    @contextmanager
    def _unbounded(self) -> Iterator[None]:
        """Without the bounds of the law, which would make one step of least squares wrong wherever one is reached."""
        self._law.is_bounded = False
        try:
            yield
        finally:
            self._law.is_bounded = True

    def _linearised(self, batch: SegmentBatch) -> tuple[Tensor, Float[Tensor, "amounts frames 3 particles"]]:
        """Positions, and their derivatives by the amounts of each particle."""
        rollout = _Rollout(cast(Simulator, self.simulators[batch.group]).starting_at(batch.start_time))
        weight = self._amounts.weight
        names = [name for name, one in rollout.named_parameters(remove_duplicate=False) if one is weight]
        value, columns = weight.detach(), []
        found = torch.empty(0)
        with torch.no_grad(), forward_ad.dual_level(), self._unbounded():
            for k in range(len(value)):
                along = torch.zeros_like(value)
                along[k, 0] = 1.0
                dual = forward_ad.make_dual(value, along)
                position = torch.func.functional_call(rollout, dict.fromkeys(names, dual), (batch,))
                found, column = forward_ad.unpack_dual(position)
                columns.append(torch.zeros_like(found) if column is None else column)
        return found, torch.stack(columns)

    def _relative(self, batch: SegmentBatch, predicted: Tensor, derivatives: Tensor) -> tuple[Tensor, Tensor]:
        """Residuals and derivatives in units of each segment's motion by stress; 0 where nothing was observed."""
        state, scenes = batch.start.state, batch.start.scenes
        time_step = cast(Simulator, self.simulators[batch.group]).integrator.settings.time_step
        times = range(batch.every, batch.steps + 1, batch.every)
        unstressed = unstressed_positions(state, scenes, time_step, times)
        unit = relative_units(batch.target, unstressed, scenes.scene_index, scenes.scene_count)
        observed = ~torch.isnan(batch.target)
        residual = torch.where(observed, predicted - torch.where(observed, batch.target, 0.0), 0.0) * unit
        return residual, torch.where(observed, derivatives, 0.0) * unit

    def _normal_equations(self, batch: SegmentBatch, residual: Tensor, derivatives: Tensor) -> tuple[Tensor, Tensor]:
        """f J^T J and f J^T r of a batch by the flat weights, summed over its segments."""
        scenes, amounts = batch.start.scenes, len(derivatives)
        features = self._amounts.features(batch.start.parameters)
        information, gradient = 0.0, 0.0
        for scene in range(scenes.scene_count):
            particles = (scenes.scene_index == scene).nonzero()[:, 0]
            columns = derivatives[..., particles].reshape(amounts, -1)
            feature = features[:, particles[0]]
            of_scene = residual[..., particles].reshape(-1)
            factor = 1.0 / (of_scene @ of_scene + ROUNDING)
            information = information + factor * torch.kron(columns @ columns.T, torch.outer(feature, feature))
            gradient = gradient + factor * torch.kron(columns @ of_scene, feature)
        return cast(Tensor, information), cast(Tensor, gradient)


class _LinearLaw(Protocol):
    """A law that is linear in the weights of its amounts, as long as it holds no bounds."""

    amounts: ConditionedAmounts
    is_bounded: bool


class _Rollout(nn.Module):
    """The positions of a batch as a function of the simulator's weights."""

    def __init__(self, simulator: Simulator) -> None:
        super().__init__()
        self.simulator = simulator

    def forward(self, batch: SegmentBatch) -> Tensor:
        return differentiable_rollout(self.simulator, batch.start, batch.steps, batch.every, recompute=False)


def check_linear(laws: Laws) -> None:
    """Refuses laws that are not linear in all of their weights."""
    weights = [weight for law in laws if law is not None for weight in law.parameters()]
    amounts = getattr(laws.elasticity, "amounts", None)
    if not isinstance(amounts, ConditionedAmounts) or any(weight is not amounts.weight for weight in weights):
        raise UserError(
            "training.method=gauss_newton needs a law that is linear in its weights; accepted: "
            "model=pcnclaws_energy with a purely elastic material, or training.method=adam"
        )
