"""Simulator step: the only place where the physics of motion and the physics of material meet."""

from dataclasses import replace
from typing import Protocol, runtime_checkable

import torch
from torch import Tensor, nn

from pcnclaws.compiled.calls import kernels_serve
from pcnclaws.laws.analytic import Laws
from pcnclaws.laws.base import Elasticity, Plasticity
from pcnclaws.laws.fixed_parameters import FixedParameters
from pcnclaws.laws.formulas import TIME_STEP
from pcnclaws.laws.internal_variables import start_values, variables_of
from pcnclaws.laws.law import Law
from pcnclaws.laws.viscosity import Viscosity
from pcnclaws.mpm.integrator import MPMIntegrator, TakeImpulses
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.mpm.state import ParticleState, Scenes
from pcnclaws.simulation.fast_paths import Skips
from pcnclaws.tensors.tensor_types import InternalValues, Matrices, Parameters


@runtime_checkable
class Step(Protocol):
    """The state one step later, from a state and the number of steps since the start."""

    def __call__(self, state: ParticleState, step: int = 0, /) -> ParticleState: ...


STATE_FIELDS, SCENE_FIELDS = len(ParticleState._fields), len(Scenes._fields)


class Simulator(nn.Module):
    """One step of elastoplastic motion: stress, MPM step, plastic return (paper, algorithm 2).

    plasticity None is a purely elastic material, viscosity None one without viscous stress: nothing is evaluated.
    """

    def __init__(
        self,
        elasticity: Elasticity,
        plasticity: Plasticity | None,
        integrator: MPMIntegrator,
        viscosity: Viscosity | None = None,
    ) -> None:
        super().__init__()
        self.elasticity = elasticity
        self.plasticity = plasticity
        self.viscosity = viscosity
        self.integrator = integrator
        self.internal_variables = variables_of((plasticity, elasticity))
        self.takes_time = plasticity is not None and plasticity.reads_time_step

    def forward(
        self,
        state: ParticleState,
        scenes: Scenes,
        parameters: Parameters,
        evaluated: bool = True,
        step: int = 0,
        take_impulses: TakeImpulses | None = None,
    ) -> ParticleState:
        """The state one time step later.

        evaluated      False for a state that is differentiated but not looked at: its deformation may have no meaning
        step           number of steps since the start, at which colliders are where they are
        take_impulses  is given the impulses of the colliders in this step [N s]
        """
        parameters = self.law_parameters(parameters)
        state = self.started(state)
        stress = self.stress(state, parameters)
        trial = self.integrator(state, stress, scenes, step, take_impulses)
        if self.plasticity is None:
            return trial
        remembered = self._internal_of(self.plasticity, trial)
        after_flow, internal = self.plasticity.answer(trial.deformation, parameters, remembered, evaluated)
        # the variables of the plastic law come first
        internal = trial.internal if internal is None else torch.cat((internal, trial.internal[len(internal) :]))
        return ParticleState(trial.position, trial.velocity, trial.affine, after_flow, internal)

    def stress(self, state: ParticleState, parameters: Parameters) -> Matrices:
        """Kirchhoff stress [Pa], elastic and viscous, (3, 3, particles)."""
        elastic, _ = self.elasticity.answer(state.deformation, parameters, self._internal_of(self.elasticity, state))
        return elastic if self.viscosity is None else elastic + self.viscosity(state.affine, parameters)

    def started(self, state: ParticleState) -> ParticleState:
        """The state with the internal variables of an undeformed body, where it has none."""
        if len(state.internal) == len(self.internal_variables):
            return state
        return state._replace(internal=start_values(self.internal_variables, state.position))

    def law_parameters(self, parameters: Parameters) -> Parameters:
        """The parameters, and the time step where a law reads it."""
        if not self.takes_time or TIME_STEP in parameters or not parameters:
            return parameters
        like = next(iter(parameters.values()))
        return {**parameters, TIME_STEP: torch.full_like(like, self.integrator.settings.time_step)}

    def starting_at(self, start_time: float) -> "Simulator":
        """The simulator of the same laws with the surroundings of a later start [s]."""
        settings = self.integrator.settings
        if settings.start_time == start_time:
            return self
        integrator = MPMIntegrator(replace(settings, start_time=start_time), self.integrator.window)
        return Simulator(self.elasticity, self.plasticity, integrator, self.viscosity)

    def _internal_of(self, law: Law, state: ParticleState) -> InternalValues | None:
        """The internal variables of a law, None without any."""
        if not law.internal_variables:
            return None
        if law.internal_variables == self.internal_variables:
            return state.internal
        return torch.stack([state.internal[self.internal_variables.index(one)] for one in law.internal_variables])

    @property
    def laws(self) -> list[Law]:
        """The elastic law, and the plastic law where there is one."""
        return [self.elasticity] if self.plasticity is None else [self.elasticity, self.plasticity]

    def trained_weights(self) -> list[Tensor]:
        """The weights of the laws that are differentiated."""
        return [weight for weight in self.parameters() if weight.requires_grad]

    def differentiated(self) -> list[Tensor]:
        """What is differentiated beside states and parameters: weights, and numbers of colliders and loads."""
        return [*self.trained_weights(), *(one for one in self.integrator.settings.tensors() if one.requires_grad)]

    def runs_compiled(self, state: ParticleState) -> bool:
        """Whether every part of a step from this state is a compiled kernel.

        On a CPU the graph of such a step is no more than its inputs.
        """
        if self.viscosity is not None:
            return False
        return all(law.kernel is not None for law in self.laws) and kernels_serve(state.position)

    def step_function(
        self,
        scenes: Scenes,
        parameters: Parameters,
        one_graph: bool = False,
        take_impulses: TakeImpulses | None = None,
    ) -> Step:
        """The step as a function of the state, and of the number of steps since the start (0 unless it is given).

        The parameters must not be changed in place meanwhile.
        one_graph  all steps are differentiated in one backward pass: what the laws read of the parameters is computed
                   and differentiated once
        """
        fixed = FixedParameters(self.law_parameters(parameters), one_graph)

        def stepped(state: ParticleState, step: int = 0) -> ParticleState:
            return self.forward(state, scenes, fixed, step=step, take_impulses=take_impulses)

        return stepped


def simulator_of(laws: Laws, settings: SimulationSettings, skips: Skips | None = None) -> Simulator:
    """The simulator of these laws, with the parts that the switches leave."""
    skips = skips or Skips()
    return Simulator(laws.elasticity, laws.plasticity, MPMIntegrator(settings, skips.grid_window), laws.viscosity)
