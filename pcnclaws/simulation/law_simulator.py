"""Simulator by laws: MLS-MPM with the constitutive laws of a material."""

from collections.abc import Sequence

from pcnclaws.laws.analytic import Laws
from pcnclaws.simulation.execution import SINGLE_ON_CPU, Execution
from pcnclaws.simulation.motion import SceneSimulator
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.simulation.scenes import SceneStart


class LawSimulator(SceneSimulator):
    """Scenes simulated with laws. Its weights are theirs, under the names elasticity.*, plasticity.*, viscosity.*."""

    def __init__(self, laws: Laws) -> None:
        super().__init__()
        self.elasticity, self.plasticity, self.viscosity = laws

    @property
    def laws(self) -> Laws:
        return Laws(self.elasticity, self.plasticity, self.viscosity)

    def simulate(
        self, starts: Sequence[SceneStart], plan: FramePlan, execution: Execution = SINGLE_ON_CPU
    ) -> list[SceneRecord]:
        return simulate_records(starts, self.laws, plan, execution)
