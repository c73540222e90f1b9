"""Splines as laws: a separable energy of the principal stretches, and a return to a yield surface drawn by a spline.

The energy is that of Xu et al. 2015, "Nonlinear material design using principal stretches". Its public successor among
the baselines of NCLaws looks up the wrong interval for stretches above 1; here every stretch finds its own. For
plasticity the source has nothing: the return is ours, of the same make.
"""

from collections.abc import Mapping

import torch
from jaxtyping import Float
from torch import Tensor, nn

from pcnclaws.baselines.spectral import Principal, from_principal, principal_stretches
from pcnclaws.baselines.splines import Place, cubic, cubic_integral, cubic_slope, knots_around_one, linear, locate
from pcnclaws.errors import UserError
from pcnclaws.laws.analytic import Laws
from pcnclaws.laws.base import Elasticity, Plasticity
from pcnclaws.laws.materials import Material
from pcnclaws.laws.moduli import lame_constants
from pcnclaws.tensors.linalg3 import deviator, hencky_strain, identity_like, safe_norm, stretched, trace
from pcnclaws.tensors.tensor_types import Matrices, Parameters, Scalars

MOST_KNOTS = 201
# Squared stretches closer than this have the limit of their divided difference: the error of either is then 1e-8.
CLOSE = 1e-4
# The untrained yield surface: a shear strain, and what a unit of compression adds to it. Low, so that it is crossed: a
# surface that no particle reaches has no gradient.
FIRST_SHEAR, FIRST_FRICTION = 5e-3, 0.3
# Root of the share of the volumetric strain that the untrained return releases in a step: nearly none, and not quite
# none, which would have no gradient either.
FIRST_LOSS = 0.03


class EnergyTerm(nn.Module):
    """One of the functions f, g, h of the energy: its derivative is a cubic spline that is 0 at 1.

    Values and slopes at the knots x are E (x - 1) theta and E eta, so that all that is trained is of order one.

    stiffness  theta and eta at the start
    scale      E [Pa]
    """

    knots: Tensor

    def __init__(self, knots: Tensor, stiffness: float, scale: float) -> None:
        super().__init__()
        self.register_buffer("knots", knots.float())
        self.scale = scale
        self.secants = nn.Parameter(torch.full((len(knots),), stiffness))
        self.tangents = nn.Parameter(torch.full((len(knots),), stiffness))

    def place(self, x: Tensor) -> Place:
        """Where stretches or products of them lie among the knots."""
        return locate(x, self.knots.to(x.dtype))

    def derivative(self, place: Place) -> Tensor:
        """f'(x) [Pa]."""
        return cubic(place, *self._at_knots(place))

    def second_derivative(self, place: Place) -> Tensor:
        """f''(x) [Pa]."""
        return cubic_slope(place, *self._at_knots(place))

    def energy(self, place: Place) -> Tensor:
        """f(x) [J/m^3], counted from the first knot."""
        return cubic_integral(place, *self._at_knots(place), self.knots.to(place.t.dtype))

    def _at_knots(self, place: Place) -> tuple[Tensor, Tensor]:
        values = self.scale * (self.knots - 1.0) * self.secants
        return values.to(place.t.dtype), (self.scale * self.tangents).to(place.t.dtype)


class SplineElasticity(Elasticity):
    """psi = f(s0) + f(s1) + f(s2) + g(s1 s2) + g(s2 s0) + g(s0 s1) + h(s0 s1 s2)  [J/m^3], s the principal stretches.

    Untrained it is a body of the middle of the material's ranges: f'(s) = 2 mu (s - 1), h'(J) = lambda (J - 1), g' = 0.
    source  Xu et al. 2015, where f, g and h are such splines, too
    """

    def __init__(self, material: Material, knots: int, reach: float) -> None:
        super().__init__()
        self.parameter_names = material.elasticity.parameter_names
        middle = {name: torch.tensor([value]) for name, value in material.defaults.items()}
        scale = float(middle["youngs_modulus"])
        lam, mu = (float(modulus) / scale for modulus in lame_constants(middle))
        places = knots_around_one(knots, reach)
        self.f = EnergyTerm(places, 2.0 * mu, scale)
        self.g = EnergyTerm(places, 0.0, scale)
        self.h = EnergyTerm(places, lam, scale)

    def energy(self, deformation: Matrices) -> Scalars:
        """Energy per initial volume psi [J/m^3], 0 at rest, (particles,)."""
        stretches, _ = principal_stretches(deformation)
        rest = torch.ones_like(stretches)
        return self._energy(stretches) - self._energy(rest)

    def kirchhoff_stress(self, deformation: Matrices, parameters: Parameters) -> Matrices:
        """Kirchhoff stress tau [Pa], (3, 3, particles), whatever the parameters are; its principal values are

            tau_i = s_i dpsi/ds_i = s_i f'(s_i) + s_i s_j g'(s_i s_j) + s_i s_k g'(s_i s_k) + J h'(J)

        double precision within: strains are small differences of stretches.
        """
        stretches, axes = principal_stretches(deformation.double())
        of_f, pairs, volume = self.f.place(stretches), _pairs(stretches), stretches.prod(0)
        of_g = self.g.place(pairs)
        single, double = stretches * self.f.derivative(of_f), pairs * self.g.derivative(of_g)
        values = single + (double.sum(0) - double) + volume * self.h.derivative(self.h.place(volume))
        slopes = self._slopes(stretches.detach(), single.detach(), double.detach())
        return from_principal(deformation.double(), values, axes, slopes).to(deformation.dtype)

    def _energy(self, stretches: Principal) -> Scalars:
        pairs, volume = _pairs(stretches), stretches.prod(0)
        terms = self.f.energy(self.f.place(stretches)).sum(0) + self.g.energy(self.g.place(pairs)).sum(0)
        return terms + self.h.energy(self.h.place(volume))

    @torch.no_grad()
    def _slopes(self, stretches: Principal, single: Principal, double: Principal) -> Principal:
        """(tau_i - tau_j) / (s_i^2 - s_j^2) of the pairs (1, 2), (2, 0), (0, 1).

            tau_i - tau_j = s_i f'(s_i) - s_j f'(s_j) + s_i s_k g'(s_i s_k) - s_j s_k g'(s_j s_k)

        is a difference of one function at two places; where these meet its derivative at their middle stands for it.
        """
        first, second = stretches.roll(-1, 0), stretches.roll(-2, 0)
        # double[j] belongs to the pair without j: s_i s_k is at place j, s_j s_k at place i
        difference = single.roll(-1, 0) - single.roll(-2, 0) + double.roll(-2, 0) - double.roll(-1, 0)
        gap = first.square() - second.square()
        middle = 0.5 * (first + second)
        limit = self._slope_of(self.f, middle) + stretches * self._slope_of(self.g, middle * stretches)
        close = gap.abs() < CLOSE
        return torch.where(close, limit / (2.0 * middle), difference / torch.where(close, 1.0, gap))

    @staticmethod
    def _slope_of(term: EnergyTerm, x: Principal) -> Principal:
        """Derivative of x f'(x)."""
        place = term.place(x)
        return term.derivative(place) + x * term.second_derivative(place)


class SplinePlasticity(Plasticity):
    """A radial return in Hencky strain whose limits are straight lines between knots of the volumetric strain v = tr h.

        |dev h'| = min(|dev h|, Y(v)),   tr h' = w(v),   F' = exp(h' - h) F

    Y is the yield surface, at least 0. w is v itself where nothing flows in volume, and 0 <= w/v <= 1: the return
    releases Hencky strain and never adds any. Von Mises (Y constant) and Drucker-Prager (Y falling to 0 at v = 0, w = 0
    beyond) are two of these surfaces, which the training has to find.
    """

    knots: Tensor

    def __init__(self, material: Material, knots: int, reach: float) -> None:
        super().__init__()
        if material.plasticity is None:
            raise ValueError(f"material '{material.name}' is purely elastic and has no plastic law")
        self.parameter_names = material.plasticity.parameter_names
        self.register_buffer("knots", knots_around_one(knots, reach).log().float())
        # as squares, which reach 0: of Y in units of the first surface, and of what of v is lost in a step
        self.shear = nn.Parameter(torch.ones(knots))
        self.loss = nn.Parameter(torch.full((knots,), FIRST_LOSS))

    def return_map(self, trial: Matrices, parameters: Parameters) -> Matrices:
        """Elastic deformation gradient after plastic flow [-], (3, 3, particles), whatever the parameters are."""
        h = hencky_strain(trial)
        volumetric, shear = trace(h), safe_norm(deviator(h))
        place = locate(volumetric, self.knots.to(h.dtype))
        limit, kept = self._limits(place)
        amount = (shear - limit).clamp_min(0.0)
        flow = deviator(h) * (-amount / torch.where(shear > 0.0, shear, 1.0)) + identity_like(h) * (
            (kept - volumetric) / 3.0
        )
        return stretched(flow, trial)

    def _limits(self, place: Place) -> tuple[Scalars, Scalars]:
        """Y(v) and w(v)."""
        first = FIRST_SHEAR + FIRST_FRICTION * (-self.knots).clamp_min(0.0)
        shear = linear(place, (first * self.shear.square()).to(place.t.dtype))
        kept = linear(place, (self.knots * (1.0 - self.loss.square().clamp_max(1.0))).to(place.t.dtype))
        return shear.clamp_min(0.0), kept


def spline(material: Material, fields: Mapping[str, object]) -> Laws:
    """Untrained spline laws of a material from the plain fields `knots` and `reach` of a `model` config."""
    knots, reach = fields.get("knots"), fields.get("reach")
    if isinstance(knots, bool) or not isinstance(knots, int) or not 3 <= knots <= MOST_KNOTS or knots % 2 == 0:
        raise UserError(f"model.knots={knots} is not accepted; accepted: an odd whole number from 3 to {MOST_KNOTS}")
    if isinstance(reach, bool) or not isinstance(reach, (int, float)) or not 0.0 < reach <= 3.0:
        raise UserError(f"model.reach={reach} is not accepted; accepted: a number above 0 and at most 3")
    plasticity = SplinePlasticity(material, knots, reach) if material.plasticity else None
    return Laws(SplineElasticity(material, knots, reach), plasticity)


def _pairs(stretches: Principal) -> Float[Tensor, "3 particles"]:
    """s1 s2, s2 s0, s0 s1: at place i the product without s_i."""
    return stretches.roll(-1, 0) * stretches.roll(-2, 0)
