"""Differentiable Material Point Method with analytic and neural constitutive laws: `import pcnclaws as pc`.

The public names, described in docs/python.md, are imported when they are first used: `import pcnclaws` alone loads
neither PyTorch nor NumPy.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from pcnclaws.version import __version__ as __version__

if TYPE_CHECKING:
    from pcnclaws.commands.law_loading import load_law
    from pcnclaws.compiled.backend import use_backend, using_backend
    from pcnclaws.errors import CannotWrite, SimulationDiverged, UserError
    from pcnclaws.geometry.body import Body
    from pcnclaws.interface.motion import Motion
    from pcnclaws.interface.scene import Scene, simulate_scenes
    from pcnclaws.interface.settings import Settings
    from pcnclaws.laws.base import Elasticity, Plasticity
    from pcnclaws.laws.constitutive_model import ConstitutiveModel, analytic_law, neural_law
    from pcnclaws.laws.internal_variables import InternalVariable
    from pcnclaws.laws.law import Law
    from pcnclaws.laws.materials import Material
    from pcnclaws.laws.parameters import Parameter
    from pcnclaws.laws.registry import Network, register
    from pcnclaws.laws.viscosity import NewtonianViscosity, Viscosity
    from pcnclaws.mpm.colliders import Collider
    from pcnclaws.mpm.loads import Load

__all__ = [
    "Body",
    "CannotWrite",
    "Collider",
    "ConstitutiveModel",
    "Elasticity",
    "InternalVariable",
    "Law",
    "Load",
    "Material",
    "Motion",
    "Network",
    "NewtonianViscosity",
    "Parameter",
    "Plasticity",
    "Scene",
    "Settings",
    "SimulationDiverged",
    "UserError",
    "Viscosity",
    "analytic_law",
    "load_law",
    "neural_law",
    "register",
    "simulate_scenes",
    "use_backend",
    "using_backend",
]

_MODULES = {
    "Body": "geometry.body",
    "CannotWrite": "errors",
    "Collider": "mpm.colliders",
    "ConstitutiveModel": "laws.constitutive_model",
    "Elasticity": "laws.base",
    "InternalVariable": "laws.internal_variables",
    "Law": "laws.law",
    "Load": "mpm.loads",
    "Material": "laws.materials",
    "Motion": "interface.motion",
    "Network": "laws.registry",
    "NewtonianViscosity": "laws.viscosity",
    "Parameter": "laws.parameters",
    "Plasticity": "laws.base",
    "Scene": "interface.scene",
    "Settings": "interface.settings",
    "SimulationDiverged": "errors",
    "UserError": "errors",
    "Viscosity": "laws.viscosity",
    "analytic_law": "laws.constitutive_model",
    "load_law": "commands.law_loading",
    "neural_law": "laws.constitutive_model",
    "register": "laws.registry",
    "simulate_scenes": "interface.scene",
    "use_backend": "compiled.backend",
    "using_backend": "compiled.backend",
}


def __getattr__(name: str) -> Any:
    """A public name, from the module that holds it."""
    if name not in _MODULES:
        raise AttributeError(f"module 'pcnclaws' has no attribute '{name}'")
    value = getattr(import_module(f"pcnclaws.{_MODULES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*__all__, "__version__"})
