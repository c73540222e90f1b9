"""The only place where the physics of motion and the physics of material meet."""

from collections.abc import Callable
from functools import partial

from torch import nn

from pcnclaws.laws.base import Elasticity, Plasticity
from pcnclaws.mpm.integrator import MPMIntegrator
from pcnclaws.mpm.state import ParticleState, Scenes
from pcnclaws.tensor_types import Parameters

Step = Callable[[ParticleState], ParticleState]


class Simulator(nn.Module):
    """One step of elastoplastic motion: stress, MPM step, plastic return (paper, algorithm 2).

    plasticity None is a purely elastic material: no plastic law is evaluated.
    """

    def __init__(self, elasticity: Elasticity, plasticity: Plasticity | None, integrator: MPMIntegrator) -> None:
        super().__init__()
        self.elasticity = elasticity
        self.plasticity = plasticity
        self.integrator = integrator

    def forward(self, state: ParticleState, scenes: Scenes, parameters: Parameters) -> ParticleState:
        """The state one time step later."""
        stress = self.elasticity(state.deformation, parameters)
        trial = self.integrator(state, stress, scenes)
        if self.plasticity is None:
            return trial
        return trial._replace(deformation=self.plasticity(trial.deformation, parameters))

    def step_function(self, scenes: Scenes, parameters: Parameters) -> Step:
        """The step as a function of the state alone."""
        return partial(self.forward, scenes=scenes, parameters=parameters)
