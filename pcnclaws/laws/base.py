"""The interfaces of elastic and plastic laws, which are isotropic and know neither scenes nor grid.

What a law remembers of a particle is given to it and taken from it. A law is one class with its parameters and one
function of principal Hencky strains, of which its kernels are made.
"""

import logging
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from types import SimpleNamespace
from typing import Any, ClassVar

import torch
from jaxtyping import Float
from torch import Tensor, nn

from pcnclaws.compiled.backend import configured_backend
from pcnclaws.compiled.build import find_compiler
from pcnclaws.compiled.calls import kernels_serve
from pcnclaws.compiled.isotropic_laws import LawArrays, isotropic_law, law_serves
from pcnclaws.compiled.law_source import LawKernel, LawShape, law_kernel
from pcnclaws.compiled.symbols import Branches, Symbol, Untraceable, derivative
from pcnclaws.errors import UserError, unknown_name
from pcnclaws.guards import count
from pcnclaws.laws import principal
from pcnclaws.laws.internal_variables import InternalVariable, start_values
from pcnclaws.laws.networks import ConditionalMLP
from pcnclaws.laws.parameters import Parameter
from pcnclaws.tensor_types import InternalValues, Matrices, Parameters

log = logging.getLogger(__name__)

# Three principal values: tensors (particles,) in PyTorch, numbers of a kernel when it is made.
Values = Sequence[Any]
# What laws that flow with time read as a parameter [s].
TIME_STEP = "time_step"


class Law(nn.Module, ABC):
    """What elasticity and plasticity share: physical parameters, and a kernel that computes the same, faster.

    physical_parameters  that the law depends on
    internal_variables   that the law reads, and a plastic one changes; formulas read them as p.<name>
    """

    physical_parameters: ClassVar[tuple[Parameter, ...]] = ()
    internal_variables: ClassVar[tuple[InternalVariable, ...]] = ()
    parameter_names: tuple[str, ...] = ()
    returns_strain: ClassVar[bool]

    def __init_subclass__(cls, **options: object) -> None:
        super().__init_subclass__(**options)
        if "physical_parameters" in cls.__dict__:
            cls.parameter_names = tuple(parameter.name for parameter in cls.physical_parameters)

    def see(self, deformation: Matrices) -> None:
        """Takes note of the deformations (3, 3, particles) of the motions that it will be trained on; nothing here."""

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
    @abstractmethod
    def is_principal(self) -> bool:
        """Whether the law is its function of principal strains; False where the function of F is another one."""

    @abstractmethod
    def evaluate(self, deformation: Matrices, known: Parameters) -> tuple[Matrices, Mapping[str, Tensor]]:
        """The law in PyTorch: the reference, and what runs where no kernel does.

        known    physical parameters and internal variables by name, each (particles,)
        returns  the result, and the internal variables that have changed
        """

    def forward(self, deformation: Matrices, parameters: Parameters, evaluated: bool = True) -> Matrices:
        """Stress or elastic deformation, with the internal variables of an undeformed body."""
        return self.answer(deformation, parameters, None, evaluated)[0]

    def answer(
        self,
        deformation: Matrices,
        parameters: Parameters,
        internal: InternalValues | None = None,
        evaluated: bool = True,
    ) -> tuple[Matrices, InternalValues | None]:
        """The result, and the internal variables after it, None without any.

        internal   internal variables of the law before it, (variables, particles); None: of an undeformed body
        evaluated  False for a result that is differentiated but not looked at, which a kernel need not compute
        """
        if internal is None and self.internal_variables:
            internal = start_values(self.internal_variables, deformation)
        kernel = self.kernel
        if kernel is None:
            _count_pytorch()
            return self._evaluated(deformation, parameters, internal)
        network = self._network
        weights = network.all_weights if network is not None else ()
        given = list(parameters.values()) if internal is None else [*parameters.values(), internal]
        if not kernels_serve(deformation, given, weights=weights) or not law_serves(kernel, deformation):
            _count_pytorch()
            return self._evaluated(deformation, parameters, internal)
        rows = parameters.rows_of(self) if isinstance(parameters, FixedParameters) else None
        if rows is None:
            rows = self.kernel_rows(parameters)
        rows = rows.expand(-1, deformation.shape[-1])
        result, after = isotropic_law(kernel, LawArrays(deformation, rows, internal, weights), evaluated)
        return result, internal if after is None else after

    def _evaluated(
        self, deformation: Matrices, parameters: Parameters, internal: InternalValues | None
    ) -> tuple[Matrices, InternalValues | None]:
        if internal is None:
            return self.evaluate(deformation, parameters)[0], None
        before = {one.name: row for one, row in zip(self.internal_variables, internal.unbind(0), strict=True)}
        result, changed = self.evaluate(deformation, {**parameters, **before})
        if not changed:
            return result, internal
        return result, torch.stack(torch.broadcast_tensors(*{**before, **changed}.values()))

    @cached_property
    def kernel(self) -> LawKernel | None:
        """The kernel, made of the formulas; None, and one line, where they do more than arithmetic."""
        if not self.is_principal:
            return None
        network, names = self._network, self._coefficient_names()
        remembered = [variable.name for variable in self.internal_variables]
        shape = LawShape(self.returns_strain, len(names), len(remembered))
        if network is not None:
            features = len(self.features(list(torch.ones(3, 1))))
            shape = replace(
                shape,
                features=features,
                outputs=network.outputs,
                conditions=network.inputs - features,
                layers=network.layers,
            )
        try:
            return law_kernel(
                type(self).__name__,
                shape,
                self.features if network is not None else None,
                lambda h, x, p, f: self.respond(
                    h, _Known(type(self).__name__, dict(zip((*names, *remembered), p, strict=True))), x, f
                ),
            )
        except Branches as error:
            raise UserError(f"the law {type(self).__name__} cannot run: {error}") from error
        except (Untraceable, TypeError) as error:
            hint = "" if isinstance(error, Untraceable) else "; formulas use pcnclaws.laws.operations"
            log.warning("the law %s runs in PyTorch, without a kernel: %s%s", type(self).__name__, error, hint)
            return None

    def kernel_rows(self, parameters: Parameters) -> Float[Tensor, "rows particles"]:
        """What the kernel reads of the parameters, as one tensor: the coefficients, then the network's conditions."""
        values = (*self.coefficients(parameters).values(), *self.conditions(parameters))
        return torch.stack(torch.broadcast_tensors(*values))

    def response(self, known: Parameters) -> principal.Response:
        """The function of principal strains with these parameters and internal variables, in PyTorch."""
        coefficients, conditions = self._formula_inputs(known), self.conditions(known)

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

    def _formula_inputs(self, known: Parameters) -> "_Known":
        """What formulas read as p.<name>, in double precision; internal variables at their start where not given."""
        starts = {variable.name: variable.start for variable in self.internal_variables}
        read = {**starts, **self.coefficients(known), **{name: known[name] for name in starts if name in known}}
        doubled = {n: v.double() if isinstance(v, Tensor) else v for n, v in read.items()}
        return _Known(type(self).__name__, doubled)

    @property
    def _network(self) -> ConditionalMLP | None:
        """The network of the features and of `conditions`, None without one."""
        network = self._modules.get("network")
        return network if isinstance(network, ConditionalMLP) else None

    def _coefficient_names(self) -> tuple[str, ...]:
        anything = {name: torch.full((1,), 0.25) for name in (*self.parameter_names, TIME_STEP)}
        try:
            return tuple(self.coefficients(anything))
        except KeyError as error:
            raise unknown_name(
                f"the law {type(self).__name__}: parameter", error.args[0], self.parameter_names
            ) from error


class _Known(SimpleNamespace):
    """What formulas read as p.<name>."""

    def __init__(self, law: str, values: Mapping[str, Any]) -> None:
        super().__init__(**values)
        self.__dict__["_law"] = law

    def __getattr__(self, name: str) -> Any:
        known = [one for one in vars(self) if one != "_law"]
        raise unknown_name(f"the law {vars(self).get('_law')}: p", name, known)


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

    A law states its principal stress, or its energy, or (without a kernel) kirchhoff_stress itself. It may read
    internal variables; a plastic law changes them.
    """

    returns_strain = False

    def principal_stress(self, h: Values, p: Any) -> Values:
        """Principal Kirchhoff stresses [Pa] of principal Hencky strains h: the derivatives of the energy.

        p  the coefficients, and internal variables, by name
        """
        return _gradient(lambda strains: self.principal_energy(strains, p), h)

    def principal_energy(self, h: Values, p: Any) -> Any:
        """Energy per initial volume [J/m^3] of principal Hencky strains h."""
        raise NotImplementedError(
            f"the law {type(self).__name__} states no energy; accepted: principal_energy, or else principal_stress or "
            "kirchhoff_stress"
        )

    def kirchhoff_stress(self, deformation: Matrices, parameters: Parameters) -> Matrices:
        """Kirchhoff stress tau = P F^T [Pa], (3, 3, particles), symmetric.

        deformation  elastic deformation gradient F [-], (3, 3, particles), det F > 0
        parameters   physical parameters, and internal variables, by name, each (particles,)
        """
        return principal.stress(deformation, self.response(parameters))

    def energy_density(self, deformation: Matrices, parameters: Parameters) -> Float[Tensor, " particles"]:
        """Energy per initial volume [J/m^3], (particles,).

        raises  NotImplementedError for a law that states none
        """
        strains = principal.strains(deformation)
        return self.principal_energy(strains.unbind(0), self._formula_inputs(parameters)).to(deformation.dtype)

    @property
    def has_energy(self) -> bool:
        """Whether the law states its energy."""
        return type(self).principal_energy is not Elasticity.principal_energy

    def respond(self, h: Values, p: Any, x: Values, f: Values) -> Values:
        return self.principal_stress(h, p)

    @property
    def is_principal(self) -> bool:
        return type(self).kirchhoff_stress is Elasticity.kirchhoff_stress

    def evaluate(self, deformation: Matrices, known: Parameters) -> tuple[Matrices, Mapping[str, Tensor]]:
        return self.kirchhoff_stress(deformation, known), {}


class Plasticity(Law):
    """Plastic law: trial deformation gradient and internal variables to those after plastic flow.

    A law states the strain after plastic flow, or with internal variables the flow, or (without a kernel) return_map
    itself.

    reads_time_step  formulas read p.time_step [s], and `coefficients` parameters["time_step"]: plastic flow takes time
    """

    returns_strain = True
    reads_time_step: ClassVar[bool] = False

    def coefficients(self, parameters: Parameters) -> Mapping[str, Tensor]:
        read = super().coefficients(parameters)
        return {**read, TIME_STEP: parameters[TIME_STEP]} if self.reads_time_step else read

    def strain_after_flow(self, h: Values, p: Any) -> Values:
        """Principal Hencky strains after plastic flow [-] from those of the trial deformation, h.

        p  the coefficients, by name
        """
        raise NotImplementedError(f"{type(self).__name__} states no strain after plastic flow")

    def flow(self, h: Values, p: Any) -> tuple[Values, Mapping[str, Any]]:
        """Principal Hencky strains after plastic flow [-], and the internal variables that have changed, by name.

        p  the coefficients and the internal variables before it, by name
        """
        return self.strain_after_flow(h, p), {}

    def return_map(self, trial: Matrices, parameters: Parameters) -> Matrices:
        """Elastic deformation gradient after plastic flow [-], (3, 3, particles).

        trial       trial deformation gradient [-], (3, 3, particles), det > 0
        parameters  physical parameters, and internal variables, by name, each (particles,)
        """
        return self.evaluate(trial, parameters)[0]

    def respond(self, h: Values, p: Any, x: Values, f: Values) -> Values:
        """Three strains after plastic flow, then the internal variables after it."""
        given = self.flow(h, p)
        if not isinstance(given, tuple) or len(given) != 2:
            raise UserError(
                f"the law {type(self).__name__}: flow gives {type(given).__name__}; accepted: three strains, and the "
                "internal variables by name"
            )
        strains, changed = given
        known = [variable.name for variable in self.internal_variables]
        for name in changed:
            if name not in known:
                raise unknown_name(f"the law {type(self).__name__}: internal variable", name, known)
        if type(self).flow is not Plasticity.flow and (missing := [name for name in known if name not in changed]):
            raise UserError(f"the law {type(self).__name__}: flow gives no {missing[0]}; accepted: {', '.join(known)}")
        return [*strains, *(changed.get(name, getattr(p, name)) for name in known)]

    @property
    def is_principal(self) -> bool:
        return type(self).return_map is Plasticity.return_map and type(self).evaluate is Plasticity.evaluate

    def evaluate(self, deformation: Matrices, known: Parameters) -> tuple[Matrices, Mapping[str, Tensor]]:
        """For a law of F with internal variables to say otherwise; one without says return_map."""
        if type(self).return_map is not Plasticity.return_map:
            return self.return_map(deformation, known), {}
        result, after = principal.elastic_deformation(deformation, self.response(known))
        names = [variable.name for variable in self.internal_variables]
        return result, dict(zip(names, after.to(deformation.dtype).unbind(0), strict=True))


def _count_pytorch() -> None:
    # without a compiler a line has said so
    if configured_backend() == "auto" and find_compiler() is not None:
        count("law_evaluations_in_pytorch")
