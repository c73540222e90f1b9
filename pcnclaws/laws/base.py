"""The two interfaces of material: a law is stateless, isotropic and knows neither scenes nor grid."""

from abc import ABC, abstractmethod

from torch import nn

from pcnclaws.tensor_types import Matrices, Parameters


class Elasticity(nn.Module, ABC):
    """Elastic law: deformation gradient to Kirchhoff stress."""

    parameter_names: tuple[str, ...]

    @abstractmethod
    def kirchhoff_stress(self, deformation: Matrices, parameters: Parameters) -> Matrices:
        """Kirchhoff stress tau = P F^T [Pa], (3, 3, particles), symmetric.

        deformation  elastic deformation gradient F [-], (3, 3, particles), det F > 0
        parameters   physical parameters by name, each (particles,)
        """

    def forward(self, deformation: Matrices, parameters: Parameters) -> Matrices:
        return self.kirchhoff_stress(deformation, parameters)


class Plasticity(nn.Module, ABC):
    """Plastic law: trial deformation gradient to elastic deformation gradient."""

    parameter_names: tuple[str, ...]

    @abstractmethod
    def return_map(self, trial: Matrices, parameters: Parameters) -> Matrices:
        """Elastic deformation gradient after plastic flow [-], (3, 3, particles).

        trial       trial deformation gradient [-], (3, 3, particles), det > 0
        parameters  physical parameters by name, each (particles,)
        """

    def forward(self, trial: Matrices, parameters: Parameters) -> Matrices:
        return self.return_map(trial, parameters)
