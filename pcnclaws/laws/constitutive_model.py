"""The constitutive model of a material: its elastic and its plastic law, bound to its parameters. Particle-first."""

import copy
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

import torch
from torch import Tensor, nn

from pcnclaws.errors import UserError
from pcnclaws.laws.analytic import Laws, analytic_laws
from pcnclaws.laws.formulas import TIME_STEP
from pcnclaws.laws.given_values import Value, checked_values, of_particles, require_values
from pcnclaws.laws.internal_variables import InternalVariable, start_values
from pcnclaws.laws.materials import Material, material_named
from pcnclaws.laws.neural import build_neural_laws
from pcnclaws.laws.parameters import Parameter
from pcnclaws.laws.registry import check_material
from pcnclaws.tensors.layout import particles_first, particles_last

LawKind = TypeVar("LawKind", bound=nn.Module)
PRECISIONS = (torch.float32, torch.float64)


class ConstitutiveModel(nn.Module):
    """Constitutive model: a material and the laws that answer for it, analytic or neural.

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
        self.elasticity, self.plasticity, self.viscosity = laws

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
        """Names of the internal variables, in their order in `internal`."""
        return tuple(variable.name for variable in self.laws.internal_variables)

    @property
    def laws(self) -> Laws:
        """The laws, component-first, as the simulator takes them."""
        return Laws(self.elasticity, self.plasticity, self.viscosity)

    def stress(self, deformation: Tensor, /, *, internal: Tensor | None = None, **parameters: Value) -> Tensor:
        """Elastic Kirchhoff stress tau = P F^T [Pa], (..., 3, 3), symmetric.

        Precision and place are those of F; derivatives reach F, the parameters and the weights.

        deformation  elastic deformation gradient F [-], (..., 3, 3), det F > 0
        internal     internal variables in the order of `internal_names`, (..., variables); None: of an undeformed body
        parameters   physical parameters by name: a number, a tensor of one value, or one value a particle, (...)
        raises       UserError
        """
        values = self._checked(deformation, parameters, self.elasticity)
        flat = particles_last(deformation.reshape(-1, 3, 3))
        law = self.laws_in(deformation.dtype, deformation.device).elasticity
        known = self._internal(internal, deformation, law.internal_variables)
        found, _ = law.answer(flat, self._of_particles(values, deformation), known)
        return particles_first(found).reshape(deformation.shape)

    def viscous_stress(self, velocity_gradient: Tensor, /, **parameters: Value) -> Tensor:
        """Viscous Kirchhoff stress [Pa], (..., 3, 3), symmetric; zero for a material without viscosity.

        velocity_gradient  [1/s], (..., 3, 3)
        parameters         as of `stress`
        raises             UserError
        """
        _require_matrices("the velocity gradient", velocity_gradient)
        values = self._checked_values(velocity_gradient, parameters, self.viscosity)
        law = self.laws_in(velocity_gradient.dtype, velocity_gradient.device).viscosity
        if law is None:
            return torch.zeros_like(velocity_gradient)
        flat = particles_last(velocity_gradient.reshape(-1, 3, 3))
        found = law(flat, self._of_particles(values, velocity_gradient))
        return particles_first(found).reshape(velocity_gradient.shape)

    def return_map(
        self, trial: Tensor, /, *, internal: Tensor | None = None, dt: float | None = None, **parameters: Value
    ) -> Any:
        """Elastic deformation gradient after plastic flow [-], (..., 3, 3); a purely elastic material returns F_trial.

        trial       trial deformation gradient [-], (..., 3, 3), det > 0
        internal    as of `stress`
        dt          time step [s], needed by a law whose flow takes time
        parameters  as of `stress`
        returns     F; of a law with internal variables, F and the internal variables after plastic flow
        raises      UserError
        """
        values = self._checked(trial, parameters, self.plasticity)
        law = self.laws_in(trial.dtype, trial.device).plasticity
        before = self._internal(internal, trial, self.laws.internal_variables)
        if law is None:
            return trial.clone() if before is None else (trial.clone(), _variables_last(before, trial))
        each = self._of_particles(values, trial)
        if law.reads_time_step:
            if dt is None or not dt > 0.0:
                raise UserError(f"dt={dt} is not accepted; accepted: the time step [s], above 0")
            each[TIME_STEP] = trial.new_full((trial[..., 0, 0].numel(),), dt)
        count = len(law.internal_variables)
        own = before[:count] if before is not None and count else None
        found, after = law.answer(particles_last(trial.reshape(-1, 3, 3)), each, own)
        elastic = particles_first(found).reshape(trial.shape)
        if before is None:
            return elastic
        after = before if after is None else torch.cat((after, before[count:]))
        return elastic, _variables_last(after, trial)

    def laws_in(self, dtype: torch.dtype, device: torch.device | str) -> Laws:
        """The laws in this precision and place. Derivatives go through to the weights of these."""
        elasticity = _converted(self.elasticity, dtype, torch.device(device))
        plasticity = None if self.plasticity is None else _converted(self.plasticity, dtype, torch.device(device))
        viscosity = None if self.viscosity is None else _converted(self.viscosity, dtype, torch.device(device))
        return Laws(elasticity, plasticity, viscosity)

    def _checked(self, given: Tensor, parameters: Mapping[str, Value], law: Any) -> dict[str, Any]:
        _require_deformation(given)
        return self._checked_values(given, parameters, law)

    def _checked_values(self, given: Tensor, parameters: Mapping[str, Value], law: Any) -> dict[str, Any]:
        """The parameters, among them all that the law takes, None for no law."""
        values = checked_values(parameters, self.physical_parameters, given.shape[:-2])
        if law is not None:
            require_values(values, [one for one in self.physical_parameters if one.name in law.parameter_names])
        return values

    def _of_particles(self, values: Mapping[str, Any], given: Tensor) -> dict[str, Tensor]:
        flat = given.reshape(-1, 3, 3)[:, 0, 0]
        return {name: one.reshape(-1) for name, one in of_particles(values, given.shape[:-2], flat).items()}

    def _internal(self, internal: Tensor | None, given: Tensor, variables: Sequence[InternalVariable]) -> Tensor | None:
        """The rows of some internal variables, (variables, particles), None without any."""
        every = self.laws.internal_variables
        expected = (*given.shape[:-2], len(every))
        if internal is not None and (not isinstance(internal, Tensor) or tuple(internal.shape) != expected):
            got = f"a tensor {tuple(internal.shape)}" if isinstance(internal, Tensor) else type(internal).__name__
            raise UserError(
                f"internal is {got}; accepted: a tensor {expected}, "
                f"{', '.join(self.internal_names) or 'of a law without internal variables'}"
            )
        if not variables:
            return None
        flat = given.reshape(-1, 3, 3)[:, 0, 0]
        if internal is None:
            return start_values(variables, flat)
        rows = internal.to(flat).reshape(-1, len(every)).T
        return torch.stack([rows[every.index(variable)] for variable in variables])


def analytic_law(material: str | Material) -> ConstitutiveModel:
    """The analytic law of a material, the ground truth of its data.

    material  its name, or the material itself, which need not be registered
    raises    UserError for an unknown material, with the nearest known one
    """
    known = _known(material)
    return ConstitutiveModel(known, analytic_laws(known))


def neural_law(material: str | Material, network: str = "pcnclaws", width: int | None = None) -> ConstitutiveModel:
    """The untrained neural law of a material, whose weights require gradients: the structure around the networks.

    The weights are drawn by PyTorch: torch.manual_seed makes them the same again.
    network  the name of a registered network: pcnclaws, pcnclaws_convex, pcnclaws_free_flow, pcnclaws_paper
    width    of the hidden layers, the network's own unless given
    raises   UserError for unknown names, with the nearest known one
    """
    known = _known(material)
    laws = build_neural_laws(known, {"name": network} if width is None else {"name": network, "width": width})
    return ConstitutiveModel(known, laws, source=network)


def _known(material: str | Material) -> Material:
    if isinstance(material, Material):
        check_material(material)
        return material
    return material_named(material)


def _variables_last(internal: Tensor, like: Tensor) -> Tensor:
    """(variables, particles) to (..., variables), for the matrices that `like` holds."""
    return internal.T.reshape(*like.shape[:-2], len(internal))


def _require_matrices(what: str, given: Tensor) -> None:
    if not isinstance(given, Tensor) or given.dtype not in PRECISIONS or given.shape[-2:] != (3, 3):
        got = f"a tensor {tuple(given.shape)} of {given.dtype}" if isinstance(given, Tensor) else type(given).__name__
        raise UserError(f"{what} is {got}; accepted: a tensor (..., 3, 3) of torch.float32 or torch.float64")


def _require_deformation(given: Tensor) -> None:
    """Refuses what no law can answer: another kind or shape, or a body that is turned inside out."""
    _require_matrices("F", given)
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
