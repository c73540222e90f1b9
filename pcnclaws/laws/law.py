"""A law: the interface that elastic and plastic laws share, isotropic, without knowledge of scenes or grid.

What a law remembers of a particle is given to it and taken from it. A law is one class with its parameters and one
function of principal Hencky strains, of which its kernels are made.
"""

import logging
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, ClassVar

import torch
from jaxtyping import Float
from torch import Tensor, nn

from pcnclaws.compiled.backend import configured_backend
from pcnclaws.compiled.build import find_compiler
from pcnclaws.compiled.calls import kernels_serve
from pcnclaws.compiled.isotropic_laws import LawArrays, isotropic_law, law_serves
from pcnclaws.compiled.law_source import LawKernel, LawShape, law_kernel
from pcnclaws.compiled.symbols import Branches, Untraceable
from pcnclaws.errors import UserError, unknown_name
from pcnclaws.guards import count
from pcnclaws.laws import principal
from pcnclaws.laws.fixed_parameters import FixedParameters
from pcnclaws.laws.formulas import TIME_STEP, Known, Values
from pcnclaws.laws.internal_variables import InternalVariable, start_values
from pcnclaws.laws.networks import ConditionalMLP
from pcnclaws.laws.parameters import Parameter
from pcnclaws.tensors.tensor_types import InternalValues, Matrices, Parameters

log = logging.getLogger(__name__)


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

    def see(self, deformation: Matrices, beside: bool = False) -> None:
        """Takes note of the deformations (3, 3, particles) of the motions that it will be trained on; nothing here.

        beside  what it has seen before counts, too
        """

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
            count_pytorch()
            return self._evaluated(deformation, parameters, internal)
        network = self._network
        weights = network.all_weights if network is not None else ()
        given = list(parameters.values()) if internal is None else [*parameters.values(), internal]
        if not kernels_serve(deformation, given, weights=weights) or not law_serves(kernel, deformation):
            count_pytorch()
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
                    h, Known(type(self).__name__, dict(zip((*names, *remembered), p, strict=True))), x, f
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

    def _formula_inputs(self, known: Parameters) -> Known:
        """What formulas read as p.<name>, in double precision; internal variables at their start where not given."""
        starts = {variable.name: variable.start for variable in self.internal_variables}
        read = {**starts, **self.coefficients(known), **{name: known[name] for name in starts if name in known}}
        doubled = {n: v.double() if isinstance(v, Tensor) else v for n, v in read.items()}
        return Known(type(self).__name__, doubled)

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


def count_pytorch() -> None:
    """Notes that a law ran in PyTorch where a kernel would have served."""
    # without a compiler a line has said so
    if configured_backend() == "auto" and find_compiler() is not None:
        count("law_evaluations_in_pytorch")
