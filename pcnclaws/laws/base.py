"""The two interfaces of material: a law is stateless, isotropic and knows neither scenes nor grid.

A law is one class with its parameters and one function of principal Hencky strains, of which its kernels are made.
"""

import logging
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from types import SimpleNamespace
from typing import Any, ClassVar

import torch
from jaxtyping import Float
from torch import Tensor, nn

from pcnclaws.compiled.calls import kernels_serve
from pcnclaws.compiled.isotropic_laws import isotropic_law, law_serves
from pcnclaws.compiled.law_source import LawKernel, LawShape, law_kernel
from pcnclaws.compiled.symbols import Symbol, Untraceable, derivative
from pcnclaws.laws import principal
from pcnclaws.laws.networks import ConditionalMLP
from pcnclaws.laws.parameters import Parameter
from pcnclaws.tensor_types import Matrices, Parameters

log = logging.getLogger(__name__)

# Three principal values: tensors (particles,) in PyTorch, numbers of a kernel when it is made.
Values = Sequence[Any]


class Law(nn.Module, ABC):
    """What elasticity and plasticity share: physical parameters, and a kernel that computes the same, faster.

    physical_parameters  that the law depends on
    """

    physical_parameters: ClassVar[tuple[Parameter, ...]] = ()
    parameter_names: tuple[str, ...] = ()
    returns_strain: ClassVar[bool]

    def __init_subclass__(cls, **options: object) -> None:
        super().__init_subclass__(**options)
        if "physical_parameters" in cls.__dict__:
            cls.parameter_names = tuple(parameter.name for parameter in cls.physical_parameters)

    def coefficients(self, parameters: Parameters) -> Mapping[str, Tensor]:
        """What the formulas read as p.<name>, each (particles,): made once for all steps. The parameters themselves."""
        return {name: parameters[name] for name in self.parameter_names}

    def conditions(self, parameters: Parameters) -> Sequence[Tensor]:
        """Further inputs of the network, each (particles,)."""
        return ()

    def features(self, h: Values) -> Values:
        """Inputs of the network, from three principal Hencky strains: invariants, the same in every order of them."""
        return ()

    @abstractmethod
    def respond(self, h: Values, p: Any, x: Values, f: Values) -> Values:
        """Three principal values from three principal Hencky strains h.

        p  the coefficients, by name
        x  the features
        f  the outputs of the network
        """

    @property
    def is_principal(self) -> bool:
        """Whether the law is its function of principal strains; False where `evaluate` says another one."""
        return type(self).evaluate in (Elasticity.evaluate, Plasticity.evaluate) and self._of_strains

    @property
    @abstractmethod
    def _of_strains(self) -> bool:
        """Whether the function of F is the one of principal strains."""

    @abstractmethod
    def evaluate(self, deformation: Matrices, parameters: Parameters) -> Matrices:
        """The law in PyTorch: the reference, and what runs where no kernel does."""

    def forward(self, deformation: Matrices, parameters: Parameters, evaluated: bool = True) -> Matrices:
        """evaluated: False for a result that is differentiated but not looked at, which a kernel need not compute."""
        kernel = self.kernel
        if kernel is None:
            return self.evaluate(deformation, parameters)
        network = self._network
        weights = network.all_weights if network is not None else ()
        if not kernels_serve(deformation, list(parameters.values()), weights=weights) or not law_serves(
            kernel, deformation
        ):
            return self.evaluate(deformation, parameters)
        rows = parameters.rows_of(self) if isinstance(parameters, FixedParameters) else None
        if rows is None:
            rows = self.kernel_rows(parameters)
        return isotropic_law(kernel, deformation, rows.expand(-1, deformation.shape[-1]), weights, evaluated)

    @cached_property
    def kernel(self) -> LawKernel | None:
        """The kernel, made of the formulas; None, and one line, where they do more than arithmetic."""
        if not self.is_principal:
            return None
        network, names = self._network, self._coefficient_names()
        shape = LawShape(self.returns_strain, len(names))
        if network is not None:
            features = len(self.features(list(torch.ones(3, 1))))
            shape = LawShape(
                self.returns_strain, len(names), features, network.outputs, network.inputs - features, network.layers
            )
        try:
            return law_kernel(
                type(self).__name__,
                shape,
                self.features if network is not None else None,
                lambda h, x, p, f: self.respond(h, SimpleNamespace(**dict(zip(names, p, strict=True))), x, f),
            )
        except (Untraceable, TypeError) as error:
            log.warning("the law %s runs in PyTorch, without a kernel: %s", type(self).__name__, error)
            return None

    def kernel_rows(self, parameters: Parameters) -> Float[Tensor, "rows particles"]:
        """What the kernel reads of the parameters, as one tensor: the coefficients, then the network's conditions."""
        values = (*self.coefficients(parameters).values(), *self.conditions(parameters))
        return torch.stack(torch.broadcast_tensors(*values))

    def response(self, parameters: Parameters) -> principal.Response:
        """The function of principal strains with these parameters, in PyTorch."""
        coefficients = SimpleNamespace(**{n: v.double() for n, v in self.coefficients(parameters).items()})
        conditions = self.conditions(parameters)

        def of_strains(h: Tensor) -> Tensor:
            strains = h.unbind(0)
            features, outputs, network = self.features(strains), (), self._network
            if network is not None:
                precision = network.weights[0].dtype
                inputs = torch.stack(torch.broadcast_tensors(*(x.to(precision) for x in (*features, *conditions))))
                outputs = network(inputs).double().unbind(0)
            values = self.respond(strains, coefficients, features, outputs)
            return torch.stack(
                [value if isinstance(value, Tensor) else torch.full_like(h[0], value) for value in values]
            )

        return of_strains

    @property
    def _network(self) -> ConditionalMLP | None:
        """The network of the features and of `conditions`, None without one."""
        network = self._modules.get("network")
        return network if isinstance(network, ConditionalMLP) else None

    def _coefficient_names(self) -> tuple[str, ...]:
        anything = {name: torch.full((1,), 0.25) for name in self.parameter_names}
        return tuple(self.coefficients(anything))


def _gradient(function: Callable[[Values], Any], h: Values) -> Values:
    """The derivatives of a function of three numbers: as a formula, or of tensors (particles,)."""
    if isinstance(h[0], Symbol):
        value = function(h)
        return [derivative(value, strain) if isinstance(value, Symbol) else 0.0 for strain in h]
    strains = torch.stack(list(h))
    value, pull = torch.func.vjp(lambda s: function(s.unbind(0)), strains)[:2]
    return pull(torch.ones_like(value))[0].unbind(0)


class FixedParameters(dict[str, Tensor]):
    """Parameters that stay the same from step to step: what the kernels read of them is made once.

    Rates of forward mode are kept with them, so that such an object must not outlive the level of forward mode that it
    was made in.
    one_graph  the same where they are differentiated in reverse mode: all steps then belong to one backward pass
    """

    def __init__(self, parameters: Parameters, one_graph: bool = False) -> None:
        super().__init__(parameters)
        self._one_graph = one_graph
        self._rows: dict[Law, Tensor] = {}

    @classmethod
    def of_rows(cls, rows: Mapping[Law, Tensor]) -> "FixedParameters":
        """Parameters of which nothing but Law.kernel_rows is known, for laws that have kernels."""
        parameters = cls({}, one_graph=True)
        parameters._rows = dict(rows)
        return parameters

    def rows_of(self, law: Law) -> Tensor | None:
        """Law.kernel_rows, or None where the parameters are differentiated in backward passes of several graphs."""
        if not self._one_graph and any(value.requires_grad for value in self.values()):
            return None
        if law not in self._rows:
            self._rows[law] = law.kernel_rows(self)
        return self._rows[law]


class Elasticity(Law):
    """Elastic law: deformation gradient to Kirchhoff stress.

    A law states its principal stress, or its energy, or (without a kernel) kirchhoff_stress itself.
    """

    returns_strain = False

    def principal_stress(self, h: Values, p: Any) -> Values:
        """Principal Kirchhoff stresses [Pa] of principal Hencky strains h: the derivatives of the energy.

        p  the coefficients, by name
        """
        return _gradient(lambda strains: self.principal_energy(strains, p), h)

    def principal_energy(self, h: Values, p: Any) -> Any:
        """Energy per initial volume [J/m^3] of principal Hencky strains h."""
        raise NotImplementedError(f"{type(self).__name__} states no energy")

    def kirchhoff_stress(self, deformation: Matrices, parameters: Parameters) -> Matrices:
        """Kirchhoff stress tau = P F^T [Pa], (3, 3, particles), symmetric.

        deformation  elastic deformation gradient F [-], (3, 3, particles), det F > 0
        parameters   physical parameters by name, each (particles,)
        """
        return principal.stress(deformation, self.response(parameters))

    def energy_density(self, deformation: Matrices, parameters: Parameters) -> Float[Tensor, " particles"]:
        """Energy per initial volume [J/m^3], (particles,).

        raises  NotImplementedError for a law that states none
        """
        coefficients = SimpleNamespace(**{n: v.double() for n, v in self.coefficients(parameters).items()})
        strains = principal.strains(deformation)
        return self.principal_energy(strains.unbind(0), coefficients).to(deformation.dtype)

    @property
    def has_energy(self) -> bool:
        """Whether the law states its energy."""
        return type(self).principal_energy is not Elasticity.principal_energy

    def respond(self, h: Values, p: Any, x: Values, f: Values) -> Values:
        return self.principal_stress(h, p)

    @property
    def _of_strains(self) -> bool:
        return type(self).kirchhoff_stress is Elasticity.kirchhoff_stress

    def evaluate(self, deformation: Matrices, parameters: Parameters) -> Matrices:
        return self.kirchhoff_stress(deformation, parameters)


class Plasticity(Law):
    """Plastic law: trial deformation gradient to elastic deformation gradient.

    A law states the strain after plastic flow, or (without a kernel) return_map itself.
    """

    returns_strain = True

    def strain_after_flow(self, h: Values, p: Any) -> Values:
        """Principal Hencky strains after plastic flow [-] from those of the trial deformation, h.

        p  the coefficients, by name
        """
        raise NotImplementedError(f"{type(self).__name__} states no strain after plastic flow")

    def return_map(self, trial: Matrices, parameters: Parameters) -> Matrices:
        """Elastic deformation gradient after plastic flow [-], (3, 3, particles).

        trial       trial deformation gradient [-], (3, 3, particles), det > 0
        parameters  physical parameters by name, each (particles,)
        """
        return principal.elastic_deformation(trial, self.response(parameters))

    def respond(self, h: Values, p: Any, x: Values, f: Values) -> Values:
        return self.strain_after_flow(h, p)

    @property
    def _of_strains(self) -> bool:
        return type(self).return_map is Plasticity.return_map

    def evaluate(self, deformation: Matrices, parameters: Parameters) -> Matrices:
        return self.return_map(deformation, parameters)
