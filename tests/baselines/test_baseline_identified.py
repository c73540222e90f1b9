"""System identification: bounded parameters, the analytic law at them, and a training that finds the truth."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from bodies import per_particle
from law_checks import COUNT, deformations
from training_bodies import recorded

from pcnclaws.baselines.identified import UnknownParameters, identified, identified_values
from pcnclaws.data.datamodule import TrajectoryDataModule
from pcnclaws.data.segments import SegmentPlan
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.training.module import OptimiserSettings
from pcnclaws.training.single_scene import SingleSceneModule
from pcnclaws.training.trainer import fit, quiet_lightning


@pytest.mark.parametrize("material", ["elasticity", "plasticine", "sand"])
def test_the_first_guess_is_the_analytic_law_of_the_middle_of_the_ranges(material: str) -> None:
    known = MATERIALS[material]
    laws, analytic = identified(known), analytic_laws(known)
    assert identified_values(laws) == pytest.approx(known.defaults, rel=1e-5)
    f = deformations(1, 0.02)
    guess, others = per_particle(known.defaults, COUNT), per_particle(known.defaults, COUNT)
    others["youngs_modulus"] *= 3.0  # what a scene says of itself does not count
    unit = known.defaults["youngs_modulus"]
    torch.testing.assert_close(
        laws.elasticity(f, others) / unit, analytic.elasticity(f, guess) / unit, rtol=0, atol=1e-7
    )
    if laws.plasticity is not None and analytic.plasticity is not None:
        torch.testing.assert_close(laws.plasticity(f, others), analytic.plasticity(f, guess), rtol=0, atol=1e-7)


@pytest.mark.parametrize("x", [-50.0, -3.0, 3.0, 50.0])
def test_no_step_of_the_optimiser_leaves_what_physics_allows(x: float) -> None:
    unknown = UnknownParameters(MATERIALS["sand"].defaults | {"yield_stress": 5e3})
    for value in unknown.unbounded.values():
        value.data.fill_(x)
    values = unknown.values()
    assert values["youngs_modulus"] > 0.0
    assert values["yield_stress"] > 0.0
    assert 0.0 <= values["poissons_ratio"] <= 0.5
    assert 0.0 <= values["friction_angle"] <= 90.0


def test_both_laws_share_the_unknowns() -> None:
    laws = identified(MATERIALS["plasticine"])
    assert laws.plasticity is not None
    assert set(map(id, laws.plasticity.parameters())) == set(map(id, laws.elasticity.parameters()))


@pytest.mark.slow
def test_training_approaches_the_truth(tmp_path: Path) -> None:
    quiet_lightning()
    bodies = recorded(1)
    truth = bodies[0].parameters
    material = replace(MATERIALS["elasticity"], ranges={"youngs_modulus": (1e4, 5e4), "poissons_ratio": (0.2, 0.4)})
    laws = identified(material)
    before = identified_values(laws)
    data = TrajectoryDataModule(bodies, bodies, SegmentPlan(120, 2, first=40, last=40), 60)
    module = SingleSceneModule(laws, data.dataset.settings, OptimiserSettings(0.1), 120)
    fitted = fit(module, data, tmp_path, torch.device("cpu"))
    after = identified_values(laws)
    assert abs(after["youngs_modulus"] / truth["youngs_modulus"] - 1.0) < 0.02
    for name, value in truth.items():
        assert abs(after[name] - value) < 0.1 * abs(before[name] - value)
    assert fitted.history.check_mse[-1] < 1e-10
