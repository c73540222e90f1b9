"""The two interfaces of material: a law is stateless, isotropic and knows neither scenes nor grid."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence

import torch
from jaxtyping import Float
from torch import Tensor, nn

from pcnclaws.compiled.calls import kernels_serve
from pcnclaws.compiled.isotropic_laws import isotropic_law
from pcnclaws.tensor_types import Matrices, Parameters


class Law(nn.Module, ABC):
    """What elasticity and plasticity share: they may have a kernel that computes the same, faster."""

    parameter_names: tuple[str, ...]
    # the name of the law among pcnclaws.compiled.isotropic_laws.LAWS, None without a kernel
    kernel: str | None = None

    def __init_subclass__(cls, **options: object) -> None:
        """A class has the kernel that it names itself: one that is derived from it may be another law."""
        super().__init_subclass__(**options)
        if "kernel" not in cls.__dict__:
            cls.kernel = None

    def kernel_parameters(self, parameters: Parameters) -> Sequence[Tensor]:
        """The rows of per-particle parameters that the kernel reads, each (particles,) or broadcastable to it."""
        raise NotImplementedError(f"{type(self).__name__} names a kernel but not its parameters")

    def kernel_weights(self) -> Sequence[Tensor]:
        """Weights and biases of the network, none for an analytic law."""
        return ()

    @abstractmethod
    def evaluate(self, deformation: Matrices, parameters: Parameters) -> Matrices:
        """The law in PyTorch: the reference, and what runs where no kernel does."""

    def forward(self, deformation: Matrices, parameters: Parameters, evaluated: bool = True) -> Matrices:
        """evaluated: False for a result that is differentiated but not looked at, which a kernel need not compute."""
        if self.kernel is None:
            return self.evaluate(deformation, parameters)
        weights = self.kernel_weights()
        if not kernels_serve(deformation, list(parameters.values()), weights=weights):
            return self.evaluate(deformation, parameters)
        rows = parameters.rows_of(self) if isinstance(parameters, FixedParameters) else None
        if rows is None:
            rows = self.kernel_rows(parameters)
        return isotropic_law(self.kernel, deformation, rows.expand(-1, deformation.shape[-1]), weights, evaluated)

    def kernel_rows(self, parameters: Parameters) -> Float[Tensor, "rows particles"]:
        """kernel_parameters as one tensor."""
        return torch.stack(torch.broadcast_tensors(*self.kernel_parameters(parameters)))


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
    """Elastic law: deformation gradient to Kirchhoff stress."""

    @abstractmethod
    def kirchhoff_stress(self, deformation: Matrices, parameters: Parameters) -> Matrices:
        """Kirchhoff stress tau = P F^T [Pa], (3, 3, particles), symmetric.

        deformation  elastic deformation gradient F [-], (3, 3, particles), det F > 0
        parameters   physical parameters by name, each (particles,)
        """

    def evaluate(self, deformation: Matrices, parameters: Parameters) -> Matrices:
        return self.kirchhoff_stress(deformation, parameters)


class Plasticity(Law):
    """Plastic law: trial deformation gradient to elastic deformation gradient."""

    @abstractmethod
    def return_map(self, trial: Matrices, parameters: Parameters) -> Matrices:
        """Elastic deformation gradient after plastic flow [-], (3, 3, particles).

        trial       trial deformation gradient [-], (3, 3, particles), det > 0
        parameters  physical parameters by name, each (particles,)
        """

    def evaluate(self, deformation: Matrices, parameters: Parameters) -> Matrices:
        return self.return_map(deformation, parameters)
