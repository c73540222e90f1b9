"""Viscous laws: from the velocity gradient to a stress that is added to the elastic one."""

from abc import ABC, abstractmethod
from typing import ClassVar

from torch import nn

from pcnclaws.laws.parameters import VISCOSITY, Parameter
from pcnclaws.tensors.linalg3 import identity_like, trace, transpose
from pcnclaws.tensors.tensor_types import Matrices, Parameters


class Viscosity(nn.Module, ABC):
    """Viscous law: velocity gradient to Kirchhoff stress.

    It runs in PyTorch, a few operations on all particles at once, beside the kernels of the other laws.

    physical_parameters  that the law depends on
    """

    physical_parameters: ClassVar[tuple[Parameter, ...]] = ()
    parameter_names: tuple[str, ...] = ()

    def __init_subclass__(cls, **options: object) -> None:
        super().__init_subclass__(**options)
        if "physical_parameters" in cls.__dict__:
            cls.parameter_names = tuple(parameter.name for parameter in cls.physical_parameters)

    @abstractmethod
    def viscous_stress(self, velocity_gradient: Matrices, parameters: Parameters) -> Matrices:
        """Viscous Kirchhoff stress [Pa], (3, 3, particles), symmetric; zero in a rigid motion.

        velocity_gradient  [1/s], (3, 3, particles)
        parameters         physical parameters by name, each (particles,)
        """

    def forward(self, velocity_gradient: Matrices, parameters: Parameters) -> Matrices:
        return self.viscous_stress(velocity_gradient, parameters)


class NewtonianViscosity(Viscosity):
    """Stress proportional to the rate of shear: tau = 2 eta dev D, D = sym(grad v); no resistance to change of volume.

    source  Newton 1687, Stokes 1845; the Kelvin-Voigt solid where it stands beside an elastic law
    """

    physical_parameters = (VISCOSITY,)

    def viscous_stress(self, velocity_gradient: Matrices, parameters: Parameters) -> Matrices:
        twice_rate = velocity_gradient + transpose(velocity_gradient)
        return parameters["viscosity"] * (twice_rate - trace(twice_rate) / 3.0 * identity_like(twice_rate))
