"""Training on measured stress: Levenberg-Marquardt on the weights of one law and on what tells its specimens apart.

Least squares of this kind are ill-conditioned: first-order optimisers stop far from the minimum.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor
from torch.func import functional_call, jacrev

from pcnclaws.laws.stretch_energy import SHAPES, WIDEST, StretchEnergyNet
from pcnclaws.training.principal_paths import PrincipalPaths, Response, with_free_sides

# Damping of the search, and what it is multiplied with after a step that helped, and after one that did not.
FIRST, LEAST, MOST, BETTER, WORSE = 1e-2, 1e-9, 1e9, 0.2, 4.0
LONGEST_STEP, SMALLEST_GAIN = 2.0, 1e-6
# How strongly unknowns are held at 0: logarithms of scales, shapes, weights, and the last biases, which are what all
# specimens have in common (for each of them).
HELD_SCALE, HELD_SHAPE, HELD_WEIGHTS, HELD_IN_COMMON = 1e-2, 1e-2, 3e-4, 1e-5
# The reach of a law over that of its points, and the shortest one.
MARGIN, CLOSEST = 1.25, 0.1
# Spread of the shapes that a search starts from.
START_SPREAD = 0.3


class Specimen(NamedTuple):
    """What training found of a specimen.

    youngs_modulus  at rest [Pa]
    scale           logarithm of the scale of strain
    shape           (SHAPES,)
    """

    name: str
    youngs_modulus: float
    scale: float
    shape: tuple[float, ...]


@dataclass(frozen=True)
class StressFit:
    """A finished search.

    predicted  what the law gives in the place of PrincipalPaths.measured
    history    the loss of each iteration: sum of weighted squared relative errors
    reach      strains over the scale between which each specimen was trained, (2, specimens)
    weights    of the network of amounts
    unknowns   all of them, as StressProblem has them
    """

    specimens: Sequence[Specimen]
    predicted: Float[Tensor, " numbers"]
    history: Sequence[float]
    reach: Float[Tensor, "2 specimens"]
    weights: Mapping[str, Tensor]
    unknowns: Float[Tensor, " unknowns"]

    @torch.no_grad()
    def put_into(self, law: StretchEnergyNet, specimen: int) -> None:
        """Gives a law the weights, and the shape, the scale and the reach of one of the specimens."""
        law.amounts.load_state_dict(dict(self.weights))
        law.shape.copy_(torch.tensor(self.specimens[specimen].shape)[:, None])
        law.scale.fill_(self.specimens[specimen].scale)
        law.reach.copy_(self.reach[:, specimen])


class StressProblem:
    """Unknowns and residuals of a training on measured stress.

    The unknowns, in one vector: of each specimen the logarithms of its stiffness [Pa] and scale and its shape, then the
    weights of the network.

    reach  strains over the scale beyond which the stiffness stays what it is there
    """

    def __init__(self, law: StretchEnergyNet, paths: PrincipalPaths, names: Sequence[str], poissons_ratio: float):
        self.law, self.paths, self.names, self.poissons_ratio = law, paths, names, poissons_ratio
        self.reach = torch.tensor([-WIDEST, WIDEST]).double()[:, None].repeat(1, len(names))
        self._weights = {name: one.detach().double() for name, one in law.amounts.named_parameters()}
        self.trained = paths.weight > 0.0

    def start(self, seed: int) -> Float[Tensor, " unknowns"]:
        """Where a search starts: the stiffness from a linear fit, shapes drawn about 0."""
        count = len(self.names)
        generator = torch.Generator().manual_seed(seed)
        drawn = START_SPREAD * torch.randn(SHAPES, count, generator=generator).double()
        weights = [one.ravel() for one in self._weights.values()]
        if count == 1:
            drawn = torch.zeros_like(drawn)
        else:  # a last layer of zeros would tell no shapes apart
            last = list(self._weights).index(f"weights.{self.law.amounts.layers - 1}")
            weights[last] = START_SPREAD * torch.randn(len(weights[last]), generator=generator).double()
        scale = torch.stack([self._largest_strain(k) for k in range(count)]).log()
        stiffness = torch.zeros(count).double()
        start = torch.cat((stiffness, scale, drawn.ravel(), *weights))
        predicted = self.predicted(start).detach()
        for k in range(count):
            own = self.trained & (self.paths.specimen[self.paths.point] == k)
            ratio = (predicted[own] * self.paths.measured[own]).sum() / predicted[own].square().sum().clamp_min(1e-300)
            stiffness[k] = ratio.clamp_min(1e-30).log()
        return torch.cat((stiffness, start[count:]))

    def numbers(self, unknowns: Float[Tensor, " unknowns"]) -> Float[Tensor, "coefficients specimens"]:
        """Scale and stiffnesses that the formulas read, of each specimen."""
        stiffness, scale, shape, weights = self._split(unknowns)
        shares = self._shares(shape, weights)
        return torch.cat((scale.exp()[None], stiffness.exp() * shares))

    def response(self, numbers: Float[Tensor, "coefficients specimens"], strain: Tensor) -> Response:
        """The law with these numbers of the specimens at principal strains (3, points)."""
        scale, stiffness = numbers[0, self.paths.specimen], numbers[1:, None, self.paths.specimen]
        slopes, curvatures = self._functions(numbers, strain)
        volume = (2.0 * strain.sum(0)).exp()
        lam = self._lame_ratio * self.law.at_rest(numbers[1:])[self.paths.specimen]
        stress = scale * (stiffness * slopes).sum(0) + 0.5 * lam * (volume - 1.0)
        of_volume = (lam * volume)[:, None, None].expand(-1, 3, 3)
        return Response(strain, stress, torch.diag_embed((stiffness * curvatures).sum(0).T) + of_volume)

    def predicted(self, unknowns: Float[Tensor, " unknowns"]) -> Float[Tensor, " numbers"]:
        """As PrincipalPaths.predicted."""
        return self.paths.predicted(self.at(self.numbers(unknowns)))

    def at(self, numbers: Float[Tensor, "coefficients specimens"]) -> Response:
        """The response at the points, with the free sides solved for."""
        return with_free_sides(lambda strain: self.response(numbers, strain), self.paths)

    def linearised(self, unknowns: Float[Tensor, " unknowns"]) -> tuple[Tensor, Tensor]:
        """The predicted numbers and their derivatives by the unknowns, (numbers, unknowns).

        Specimens know nothing of each other: one direction for each coefficient of all specimens at once.
        """
        numbers = self.numbers(unknowns)
        at = self.at(numbers)
        scale, stiffness = numbers[0, self.paths.specimen], numbers[1:, None, self.paths.specimen]
        slopes, curvatures = self._functions(numbers, at.strain)
        of_scale = scale * (stiffness * slopes).sum(0) - at.strain * (stiffness * curvatures).sum(0)
        rest = self.law.at_rest(torch.eye(len(stiffness), dtype=torch.float64))[:, None, None]
        of_volume = 0.5 * self._lame_ratio * rest * ((2.0 * at.strain.sum(0)).exp() - 1.0)
        changes = torch.cat((of_scale[None], stiffness * (scale * slopes + of_volume)))
        inner = torch.stack([self.paths.tangent(at, change) for change in changes])
        outer = jacrev(lambda u: self.numbers(u).log())(unknowns)
        return self.paths.predicted(at), torch.einsum(
            "kn,knu->nu", inner, outer[:, self.paths.specimen[self.paths.point]]
        )

    @property
    def _lame_ratio(self) -> float:
        """lambda over 2 mu; 0 of an incompressible body, whose pressure is eliminated."""
        return 0.0 if self.poissons_ratio >= 0.5 else self.poissons_ratio / (1.0 - 2.0 * self.poissons_ratio)

    def _functions(self, numbers: Tensor, strain: Tensor) -> tuple[Tensor, Tensor]:
        """Slopes and curvatures of the functions of the law, each (functions, 3, points)."""
        x = strain / numbers[0, self.paths.specimen]
        low, high = self.reach[:, self.paths.specimen].expand(3, 2, -1).unbind(1)
        ends = SimpleNamespace(low=low, high=high)
        slopes, curvatures = (torch.stack(self.law.each(x, ends, what)) for what in ("slope", "curvature"))
        return slopes, curvatures

    def held(self, start: Float[Tensor, " unknowns"]) -> tuple[Tensor, Tensor]:
        """Where the unknowns are held, and how strongly: scales at 1, shapes and weights at 0."""
        count, common = len(self.names), self.law.amounts.outputs
        weights = len(start) - (2 + SHAPES) * count - common
        sizes = (count, count, SHAPES * count, weights, common)
        strengths = (0.0, HELD_SCALE, HELD_SHAPE, HELD_WEIGHTS, count * HELD_IN_COMMON)
        strength = torch.cat([torch.full((n,), held) for n, held in zip(sizes, strengths, strict=True)])
        return torch.zeros_like(start), strength.double()

    def found(self, unknowns: Float[Tensor, " unknowns"]) -> tuple[list[Specimen], dict[str, Tensor]]:
        """The specimens and the weights of the network."""
        stiffness, scale, shape, weights = self._split(unknowns)
        two_mu = stiffness.exp() * self.law.at_rest(self._shares(shape, weights))
        modulus = two_mu * (1.0 + self.poissons_ratio)
        specimens = [
            Specimen(name, float(modulus[k]), float(scale[k]), tuple(shape[:, k].tolist()))
            for k, name in enumerate(self.names)
        ]
        return specimens, weights

    def trained_reach(self, unknowns: Float[Tensor, " unknowns"]) -> Float[Tensor, "2 specimens"]:
        """Least and largest strain over the scale of the points of each specimen, and a margin."""
        numbers = self.numbers(unknowns)
        over = self.at(numbers).strain / numbers[0, self.paths.specimen]
        reach = torch.zeros(2, len(self.names)).double()
        for k in range(len(self.names)):
            own = over[:, self._points(k)]
            reach[:, k] = MARGIN * torch.stack((own.min().clamp_max(-CLOSEST), own.max().clamp_min(CLOSEST)))
        return reach.clamp(-WIDEST, WIDEST)

    def _points(self, specimen: int) -> Tensor:
        """The points of a specimen that are trained on."""
        return self.paths.point[self.trained & (self.paths.specimen[self.paths.point] == specimen)]

    def _largest_strain(self, specimen: int) -> Tensor:
        return self.paths.strain[:, self._points(specimen)].abs().max()

    def _split(self, unknowns: Tensor) -> tuple[Tensor, Tensor, Tensor, dict[str, Tensor]]:
        count = len(self.names)
        sizes = [one.numel() for one in self._weights.values()]
        stiffness, scale, shape, *flat = unknowns.split([count, count, SHAPES * count, *sizes])
        weights = {name: one.reshape(like.shape) for (name, like), one in zip(self._weights.items(), flat, strict=True)}
        return stiffness, scale, shape.reshape(SHAPES, count), weights

    def _shares(self, shape: Tensor, weights: dict[str, Tensor]) -> Tensor:
        return self.law.shares(functional_call(self.law.amounts, weights, (shape,)))


def fit_stress(problem: StressProblem, start: Float[Tensor, " unknowns"], iterations: int) -> StressFit:
    """The weighted least-squares fit from a start, by Levenberg-Marquardt.

    source  Marquardt 1963, "An algorithm for least-squares estimation of nonlinear parameters"
    """
    unknowns, damping = start, FIRST
    held_at, strength = problem.held(start)
    weight = problem.paths.weight
    history: list[float] = []

    def loss(at: Tensor, predicted: Tensor) -> float:
        misfit = (weight * (predicted - problem.paths.measured).square()).sum()
        return float(misfit + (strength * (at - held_at).square()).sum())

    predicted, slopes = problem.linearised(unknowns)
    best = loss(unknowns, predicted)
    for _ in range(iterations):
        history.append(float((weight * (predicted - problem.paths.measured).square()).sum()))
        normal = slopes.T @ (weight[:, None] * slopes) + torch.diag(strength)
        gradient = slopes.T @ (weight * (predicted - problem.paths.measured)) + strength * (unknowns - held_at)
        step_to = _shortened(problem, loss, (unknowns, best), (normal, gradient, damping))
        if step_to is None:
            break
        gain, (unknowns, best, damping) = best - step_to[1], step_to
        predicted, slopes = problem.linearised(unknowns)
        if gain < SMALLEST_GAIN * best:
            break
    specimens, weights = problem.found(unknowns)
    problem.reach = problem.trained_reach(unknowns)
    return StressFit(specimens, problem.predicted(unknowns), history, problem.reach, weights=weights, unknowns=unknowns)


def _shortened(
    problem: StressProblem,
    loss: Callable[[Tensor, Tensor], float],
    at: tuple[Tensor, float],
    system: tuple[Tensor, Tensor, float],
) -> tuple[Tensor, float, float] | None:
    """The unknowns after a step that helps, their loss and the next damping; None where none does."""
    (unknowns, before), (normal, gradient, damping) = at, system
    scale = torch.diag(normal.diagonal() + 1e-6 * normal.diagonal().max().clamp_min(1e-12))
    while damping < MOST:
        step = torch.linalg.solve(normal + damping * scale, -gradient).clamp(-LONGEST_STEP, LONGEST_STEP)
        after = loss(unknowns + step, problem.predicted(unknowns + step).detach())
        if math.isfinite(after) and after < before:
            return unknowns + step, after, max(damping * BETTER, LEAST)
        damping *= WORSE
    return None


def relative_errors(paths: PrincipalPaths, predicted: Float[Tensor, " numbers"]) -> list[float]:
    """Root mean square of the error over that of the measured stress, of each path [-]."""
    squares = (predicted - paths.measured).square()
    return [float(squares[paths.path == k].sum().sqrt()) for k in range(int(paths.path.max()) + 1)]
