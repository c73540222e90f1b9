"""The constitutive model of a material: its elastic and its plastic law, bound to its parameters. Particle-first."""

import copy
from collections.abc import Mapping
from typing import TypeVar

import torch
from torch import Tensor, nn

from pcnclaws.errors import UserError
from pcnclaws.laws.analytic import Laws, analytic_laws
from pcnclaws.laws.base import Law
from pcnclaws.laws.given_values import Value, checked_values, of_particles, require_values
from pcnclaws.laws.materials import Material, material_named
from pcnclaws.laws.neural import build_neural_laws
from pcnclaws.laws.parameters import Parameter
from pcnclaws.layout import particles_first, particles_last

LawKind = TypeVar("LawKind", bound=Law)
PRECISIONS = (torch.float32, torch.float64)


class ConstitutiveModel(nn.Module):
    """Constitutive model: a material and the two laws that answer for it, analytic or neural.

    Made by analytic_law, load_law and neural_law. A module of PyTorch: `law.parameters()` are the weights of its
    networks, none of an analytic law; those of a law that was loaded are frozen until `law.requires_grad_()`.

    material   whose parameters the laws take
    ranges     span of each physical parameter in the training data of the law; None: it was not trained, and they are
               those of the material
    source     what the law is called in messages
    """

    def __init__(
        self,
        material: Material,
        laws: Laws,
        ranges: Mapping[str, tuple[float, float]] | None = None,
        source: str = "analytic",
    ) -> None:
        super().__init__()
        self.material, self.source, self.is_trained = material, source, ranges is not None
        self.ranges = dict(material.ranges if ranges is None else ranges)
        self.elasticity, self.plasticity = laws

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the physical parameters."""
        return self.material.parameter_names

    @property
    def physical_parameters(self) -> tuple[Parameter, ...]:
        """The physical parameters."""
        return self.material.physical_parameters

    @property
    def internal_names(self) -> tuple[str, ...]:
        """Names of the internal variables; no law has one yet."""
        return ()

    @property
    def laws(self) -> Laws:
        """The two laws, component-first, as the simulator takes them."""
        return Laws(self.elasticity, self.plasticity)

    def stress(self, deformation: Tensor, /, **parameters: Value) -> Tensor:
        """Kirchhoff stress tau = P F^T [Pa], (..., 3, 3), symmetric.

        Precision and place are those of F; derivatives reach F, the parameters and the weights.

        deformation  elastic deformation gradient F [-], (..., 3, 3), det F > 0
        parameters   physical parameters by name: a number, a tensor of one value, or one value a particle, (...)
        raises       UserError
        """
        return self._evaluated(self.elasticity, "elasticity", deformation, parameters)

    def return_map(self, trial: Tensor, /, **parameters: Value) -> Tensor:
        """Elastic deformation gradient after plastic flow [-], (..., 3, 3); a purely elastic material returns F_trial.

        trial       trial deformation gradient [-], (..., 3, 3), det > 0
        parameters  as of `stress`
        raises      UserError
        """
        return self._evaluated(self.plasticity, "plasticity", trial, parameters)

    def laws_in(self, dtype: torch.dtype, device: torch.device | str) -> Laws:
        """The laws in this precision and place. Derivatives go through to the weights of these."""
        elasticity = _converted(self.elasticity, dtype, torch.device(device))
        plasticity = None if self.plasticity is None else _converted(self.plasticity, dtype, torch.device(device))
        return Laws(elasticity, plasticity)

    def _evaluated(self, law: Law | None, part: str, given: Tensor, parameters: Mapping[str, Value]) -> Tensor:
        _require_deformation(given)
        values = checked_values(parameters, self.physical_parameters, given.shape[:-2])
        if law is None:
            return given.clone()
        require_values(values, [one for one in self.physical_parameters if one.name in law.parameter_names])
        flat = particles_last(given.reshape(-1, 3, 3))
        converted = getattr(self.laws_in(given.dtype, given.device), part)
        each = {name: one.reshape(-1) for name, one in of_particles(values, given.shape[:-2], flat).items()}
        return particles_first(converted(flat, each)).reshape(given.shape)


def analytic_law(material: str | Material) -> ConstitutiveModel:
    """The analytic law of a material, the ground truth of its data.

    material  its name, or the material itself, which need not be registered
    raises    UserError for an unknown material, with the nearest known one
    """
    known = material if isinstance(material, Material) else material_named(material)
    return ConstitutiveModel(known, analytic_laws(known))


def neural_law(material: str | Material, network: str = "pcnclaws", width: int | None = None) -> ConstitutiveModel:
    """The untrained neural law of a material, whose weights require gradients: the structure around the networks.

    The weights are drawn by PyTorch: torch.manual_seed makes them the same again.
    network  the name of a registered network: pcnclaws, pcnclaws_free_flow, pcnclaws_no_prior, pcnclaws_paper
    width    of the hidden layers, the network's own unless given
    raises   UserError for unknown names, with the nearest known one
    """
    known = material if isinstance(material, Material) else material_named(material)
    laws = build_neural_laws(known, {"name": network} if width is None else {"name": network, "width": width})
    return ConstitutiveModel(known, laws, source=network)


def _require_deformation(given: Tensor) -> None:
    """Refuses what no law can answer: another kind or shape, or a body that is turned inside out."""
    if not isinstance(given, Tensor) or given.dtype not in PRECISIONS or given.shape[-2:] != (3, 3):
        what = f"a tensor {tuple(given.shape)} of {given.dtype}" if isinstance(given, Tensor) else type(given).__name__
        raise UserError(f"F is {what}; accepted: a tensor (..., 3, 3) of torch.float32 or torch.float64")
    determinant = torch.linalg.det(given.detach()).reshape(-1)
    wrong = (~((determinant > 0.0) & torch.isfinite(determinant))).nonzero()
    if len(wrong):
        first = int(wrong[0])
        raise UserError(f"F of particle {first} has the determinant {float(determinant[first]):g}; accepted: above 0")


def _converted(law: LawKind, dtype: torch.dtype, device: torch.device) -> LawKind:
    """The law with its weights in another precision or place, as functions of the weights of this one."""
    if all(one.dtype == dtype and one.device == device for one in (*law.parameters(), *law.buffers())):
        return law
    shared = {id(one): one for one in (*law.parameters(), *law.buffers())}
    converted = copy.deepcopy(law, shared)
    for module in converted.modules():
        for kept in (module._parameters, module._buffers):
            for name, one in kept.items():
                if one is not None:
                    kept[name] = one.to(device, dtype)  # pyright: ignore[reportArgumentType]  # not a leaf
    return converted
