"""The two interfaces of material: a law is stateless, isotropic and knows neither scenes nor grid."""

from abc import ABC, abstractmethod
from collections.abc import Sequence

import torch
from torch import Tensor, nn

from pcnclaws.compiled.kernels import kernels_serve
from pcnclaws.compiled.laws import isotropic_law
from pcnclaws.tensor_types import Matrices, Parameters


class Law(nn.Module, ABC):
    """What elasticity and plasticity share: they may have a kernel that computes the same, faster, on the CPU."""

    parameter_names: tuple[str, ...]
    # the name of the law among pcnclaws.compiled.laws.LAWS, None without a kernel
    kernel: str | None = None

    def __init_subclass__(cls, **options: object) -> None:
        """A class that redefines its law does not inherit the kernel of the law that it changes."""
        super().__init_subclass__(**options)
        redefined = {"evaluate", "kirchhoff_stress", "return_map"} & set(cls.__dict__)
        if redefined and "kernel" not in cls.__dict__:
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

    def forward(self, deformation: Matrices, parameters: Parameters) -> Matrices:
        if self.kernel is None or not kernels_serve(deformation, weights=self.kernel_weights()):
            return self.evaluate(deformation, parameters)
        rows = torch.broadcast_tensors(*self.kernel_parameters(parameters))
        return isotropic_law(self.kernel, deformation, torch.stack(rows), self.kernel_weights())


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
