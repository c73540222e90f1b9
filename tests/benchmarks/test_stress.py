"""Scenes at the edge: a part of the stress problem, and that its verdicts can fail."""

from dataclasses import replace

import numpy as np
import pytest

import pcnclaws as pc
from benchmarks.stress import fates
from benchmarks.stress.cases import AXES, StressCase, base_scene, cases, law_of
from benchmarks.stress.fates import FAULT, GAINS, HOLDS, REFUSED, STOPPED, fate_of
from benchmarks.stress.gradients import AGREEMENT, compare
from benchmarks.stress.long_runs import long_run, verdicts
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.simulation.scenes import SceneStart

# PyTorch warns of its own use of torch.jit when it loads forward mode
pytestmark = pytest.mark.filterwarnings("ignore:`torch.jit.script` is deprecated:DeprecationWarning")
SOME = {
    "time step": ("0.1 of the limit", "1.5 of the limit"),
    "Poisson's ratio": ("-0.5", "0.499"),
    "impact": ("30 m/s",),
    "spin": ("100 rad/s",),
    "particles": ("1",),
    "place": ("one particle on a node", "two in the same place", "in a corner of the room"),
    "start deformed": ("one side to a thousandth",),
    "obstacle": ("press to a tenth of the height", "function"),
}


@pytest.mark.parametrize("axis", SOME)
@pytest.mark.parametrize(("material", "law"), [("elasticity", "analytic"), ("sand", "shipped")])
def test_scenes_at_the_edge_hold_or_end_with_a_reason(axis: str, material: str, law: str) -> None:
    for case in cases([material], [law]):
        if case.axis == axis and case.value in SOME[axis]:
            row = fate_of(case._replace(steps=min(case.steps, 100)))
            assert row["fate"] in (HOLDS, REFUSED, STOPPED), f"{case.name}: {row}"
            assert row["fate"] == HOLDS or row["reason"]


@pytest.mark.slow
@pytest.mark.parametrize("axis", AXES)
def test_all_scenes_at_the_edge_hold_or_end_with_a_reason(axis: str) -> None:
    for case in cases(["elasticity", "plasticine", "sand"], ["analytic", "shipped"]):
        if case.axis == axis:
            row = fate_of(case)
            assert row["fate"] in (HOLDS, REFUSED, STOPPED), f"{case.name}: {row}"


def test_energy_from_nowhere_and_nameless_stops_are_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    case = next(case for case in cases(["elasticity"], ["analytic"]) if case.axis == "gravity")._replace(steps=20)
    moved = fates._motion

    def faster(start: SceneStart, law: pc.ConstitutiveModel, case: StressCase) -> SceneRecord:
        record = moved(start, law, case)
        assert record.velocity is not None
        return replace(record, velocity=record.velocity * np.linspace(1.0, 1.5, len(record.time))[:, None, None])

    monkeypatch.setattr(fates, "_motion", faster)
    assert fate_of(case)["fate"] == GAINS

    def stopped(*_: object) -> None:
        raise pc.SimulationDiverged("it diverged")

    monkeypatch.setattr(fates, "_motion", stopped)
    assert fate_of(case)["fate"] == FAULT


@pytest.mark.slow
@pytest.mark.parametrize("material", ["elasticity", "plasticine", "sand"])
@pytest.mark.parametrize("law", ["analytic", "shipped"])
def test_twenty_thousand_steps(material: str, law: str) -> None:
    row = long_run(material, law, 20_000)
    missed = {name for name, holds in verdicts(row).items() if not holds}
    # sand goes on running out
    assert missed <= ({"drift"} if material == "sand" else set()), row


@pytest.mark.parametrize("unknown", [pytest.param("parameters", marks=pytest.mark.slow), "friction of an obstacle"])
def test_derivatives_through_an_impact_agree(unknown: str) -> None:
    row = compare("sand", unknown, 60, "compiled")
    assert row["forward_error"] < 1e-12
    assert row["difference_error"] < AGREEMENT


def test_a_stop_says_what_to_change() -> None:
    scene = base_scene(law_of("elasticity", "analytic"), velocity=(0.3, -30.0, 0.1))
    with pytest.raises(pc.SimulationDiverged, match=r"scene 'cube' .*step \d+: particle \d+: .*; .*slower or stiffer"):
        scene.simulate(300, 5)
