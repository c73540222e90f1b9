"""Stability: the survival map, the limit that a lone particle predicts, and the refusal that follows from the map."""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from benchmarks import stability
from benchmarks.__main__ import benchmark
from benchmarks.context import BenchmarkContext
from benchmarks.stability_limits import limits_of, single_particle_limit
from benchmarks.stability_report import KINDS, kinds_of
from benchmarks.survival import DIVERGED, GAINS_ENERGY, STABLE, Batch, fates, scene_start
from benchmarks.yardstick import Yardstick
from pcnclaws.commands.composition import compose_config
from pcnclaws.commands.runs import laws_for
from pcnclaws.compiled.backend import using_backend
from pcnclaws.errors import UserError
from pcnclaws.evaluation.energy import potential_energy, scene_energy
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.laws.parameters import compression_wave_speed
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.mpm.state import ParticleState, Scenes
from pcnclaws.simulation.batch import batch_scenes
from pcnclaws.simulation.scenes import SceneStart
from pcnclaws.simulation.simulator import simulator_of
from pcnclaws.simulation.time_step import Stability, stability_of, stable_cfl

CPU = torch.device("cpu")
FLOWS = {"elasticity": None, "plasticine": 1e-2, "sand": 30.0, "neo_hookean": None, "tresca": 1e-2}
TINY = [
    *("problem.materials=[elasticity,sand]", "problem.cfl=[0.5,2.0]", "problem.youngs_modulus=[1e5,1e6]"),
    *("problem.poissons_ratio=[0.0,0.4]", "problem.friction_angle=[30.0]", "problem.precisions=[float32]"),
    *("problem.per_cell=[1.0]", "problem.steps=60"),
]


def run_steps(starts: list[SceneStart], steps: int, dtype: torch.dtype = torch.float64) -> ParticleState:
    """The state of a batch after some steps of the analytic laws."""
    batch = batch_scenes(starts, dtype)
    simulator = simulator_of(analytic_laws(MATERIALS[starts[0].material]), starts[0].settings).to(dtype=dtype)
    state = batch.state
    with torch.no_grad():
        for _ in range(steps):
            state = simulator(state, batch.scenes, batch.parameters)
    return state


def lone_particle(cfl: float, poissons_ratio: float, strain_rate: np.ndarray) -> SceneStart:
    """A particle alone on the grid, without gravity, that begins to strain at a rate relative to 1 / time step."""
    youngs_modulus, nodes = 1e5, 10
    time_step = cfl / nodes / compression_wave_speed(youngs_modulus, poissons_ratio, 1000.0)
    settings = SimulationSettings(time_step, 1 / nodes, 0.0, (0.0, 0.0, 0.0))
    parameters = {"youngs_modulus": youngs_modulus, "poissons_ratio": poissons_ratio}
    position, rest = np.array([[0.47, 0.52, 0.5]]), np.zeros((1, 3))
    affine = 1e-6 / time_step * strain_rate[None]
    return SceneStart("lone", "elasticity", settings, parameters, position, rest, np.array([1e-3]), affine)


@pytest.mark.parametrize("poissons_ratio", [-0.5, -0.2, 0.0, 0.3, 0.45])
def test_a_lone_particle_is_stable_up_to_the_predicted_cfl_number_and_no_further(poissons_ratio: float) -> None:
    limit = single_particle_limit(poissons_ratio)
    # a change of volume is what goes wrong first above nu = 0, a change of shape below
    strain_rate = np.eye(3) if poissons_ratio >= 0.0 else np.diag((1.0, -1.0, 0.0))
    swing = {}
    for share in (0.99, 1.03):
        state = run_steps([lone_particle(share * limit, poissons_ratio, strain_rate)], 60)
        swing[share] = float((state.deformation[:, :, 0] - torch.eye(3, dtype=torch.float64)).abs().max())
    assert swing[0.99] < 1e-4
    assert not swing[1.03] < 1e-3


@pytest.mark.parametrize("material", ["elasticity", "sand"])
def test_the_elastic_energy_is_what_the_stress_works_against(material: str) -> None:
    law = analytic_laws(MATERIALS[material]).elasticity
    generator = torch.Generator().manual_seed(0)
    noise = torch.rand(3, 3, 5, generator=generator, dtype=torch.float64) - 0.5
    deformation = (torch.eye(3, dtype=torch.float64)[:, :, None] + 0.5 * noise).requires_grad_()
    parameters = {"youngs_modulus": torch.full((5,), 2e5).double(), "poissons_ratio": torch.full((5,), 0.3).double()}
    volume = torch.linspace(1.0, 2.0, 5, dtype=torch.float64)
    still = torch.zeros(3, 5, dtype=torch.float64)
    scenes = Scenes(torch.zeros(5, dtype=torch.int64), volume, volume, torch.zeros(3, 1, dtype=torch.float64))
    state = ParticleState(still, still, torch.zeros(3, 3, 5, dtype=torch.float64), deformation)
    energy = scene_energy(state, scenes, parameters, law, spacing=0.1)
    (nominal,) = torch.autograd.grad(energy.sum(), deformation)
    kirchhoff = torch.einsum("ijp,kjp->ikp", nominal, deformation)
    expected = volume * law(deformation, parameters)
    torch.testing.assert_close(kirchhoff, expected, rtol=1e-6, atol=1e-4)


def test_a_rigid_body_has_the_energy_of_its_motion_and_height() -> None:
    count, mass, height = 4, torch.full((4,), 2.0).double(), 0.3
    scenes = Scenes(
        torch.zeros(count, dtype=torch.int64), mass, mass / 1000, torch.tensor([[0.0], [-9.8], [0.0]]).double()
    )
    velocity = torch.tensor([[3.0], [0.0], [4.0]]).double().expand(3, count)
    spinning = torch.zeros(3, 3, count, dtype=torch.float64)
    spinning[0, 1], spinning[1, 0] = -2.0, 2.0
    state = ParticleState.at_rest_shape(torch.full((3, count), height).double(), velocity)._replace(affine=spinning)
    parameters = {"youngs_modulus": mass, "poissons_ratio": 0.1 * mass}
    law = analytic_laws(MATERIALS["elasticity"]).elasticity
    expected = 0.5 * 8.0 * (25.0 + 0.25 * 0.1**2 * 8.0)
    assert float(scene_energy(state, scenes, parameters, law, 0.1)) == pytest.approx(expected)
    assert float(potential_energy(state, scenes, 0.1)) == pytest.approx(8.0 * 9.8 * 0.2)


@pytest.mark.parametrize(
    "material",
    [name if name in ("elasticity", "sand") else pytest.param(name, marks=pytest.mark.slow) for name in FLOWS],
)
def test_a_change_of_the_unit_of_time_changes_nothing_but_the_step(material: str) -> None:
    batch = Batch(material, FLOWS[material], "spinning", "float64", 1, 0.4)
    scaled = scene_start(batch, 1e5, 0.3)
    assert stability_of(scaled).cfl == pytest.approx(0.4)

    unit = (scaled.parameters["youngs_modulus"] / 1e5) ** 0.5
    settings = SimulationSettings(
        unit * scaled.settings.time_step, scaled.settings.grid_spacing, scaled.settings.wall_distance
    )
    stresses = {name: value / unit**2 for name, value in scaled.parameters.items() if name.endswith(("ulus", "stress"))}
    real = SceneStart(
        "real",
        material,
        settings,
        {**scaled.parameters, **stresses},
        scaled.position,
        scaled.velocity / unit,
        scaled.volume,
    )
    one, other = run_steps([scaled], 80), run_steps([real], 80)
    assert float((one.deformation - torch.eye(3).double()[:, :, None]).abs().max()) > 1e-3  # it has met the floor
    torch.testing.assert_close(one.position, other.position, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("backend", ["torch", "auto"])
def test_a_scene_that_diverges_does_not_disturb_the_others_of_its_batch(backend: str) -> None:
    batch = Batch("elasticity", None, "dropped", "float32", 1, 0.4)
    healthy = scene_start(batch, 1e5, 0.3)
    sick = scene_start(batch._replace(cfl=3.0), 1e5, 0.3)
    with using_backend(backend):
        together = run_steps([sick, healthy, sick], 80)
        alone = run_steps([healthy], 80)
    count = len(healthy.volume)
    assert not torch.isfinite(together.position[:, :count]).all()
    for field, expected in zip(together, alone, strict=True):
        assert torch.isfinite(expected).all()
        torch.testing.assert_close(field[..., count : 2 * count], expected, rtol=0.0, atol=1e-9)


def test_bodies_live_at_a_small_cfl_number_and_die_at_a_large_one() -> None:
    moduli = [(1e5, 0.0), (1e6, 0.4)]
    batch = Batch("plasticine", 1e-2, "spinning", "float32", 1, 0.5)
    assert fates(batch, moduli, 60, CPU) == STABLE * 2
    assert fates(batch._replace(cfl=2.0), moduli, 60, CPU) == DIVERGED * 2


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("material", list(FLOWS))
def test_what_is_accepted_with_a_tenth_to_spare_stays_stable(material: str, precision: str) -> None:
    # neo-Hookean bodies, whose limits were not measured, give way under strong compression where nu is negative
    ratios = (0.05 if material == "neo_hookean" else -0.4, 0.1, 0.35, 0.47)
    for motion, ratio in zip(("dropped", "spinning") * 2, ratios, strict=True):
        batch = Batch(material, FLOWS[material], motion, precision, 1, 0.9 * stable_cfl(material, ratio))
        assert fates(batch, [(1e5, ratio), (2e6, ratio)], 80, CPU) == STABLE * 2, (motion, ratio)


def rows_of(fates_by_level: Mapping[float, list[str]]) -> list[dict[str, Any]]:
    return [{"material": "sand", "cfl": cfl, "fates": words} for cfl, words in fates_by_level.items()]


def test_the_limit_is_the_last_level_before_anything_goes_wrong() -> None:
    rows = rows_of({0.5: ["ss", "ss"], 1.2: ["ss", "se"], 1.5: ["sd", "ss"], 2.0: ["ss", "dd"]})
    limits = limits_of(rows, [1e4, 1e5], [0.0, 0.3])
    assert limits == {"sand": {"poissons_ratio": [0.0, 0.3], "cfl": [1.5, 0.5]}}
    # one more kind of body that fails earlier
    worse = [*rows, *rows_of({1.5: ["ds", "ss"]})]
    assert limits_of(worse, [1e4, 1e5], [0.0, 0.3])["sand"]["cfl"] == [1.2, 0.5]


def test_what_its_own_weight_crushes_does_not_count() -> None:
    rows = rows_of({0.2: ["s", "s"], 0.4: ["d", "s"], 1.0: ["s", "s"], 1.5: ["d", "d"]})
    assert limits_of(rows, [1e3, 1e5], [0.3])["sand"]["cfl"] == [1.0]
    # a stiff body that needs a shorter step than a soft one is not crushed: it counts
    assert limits_of(rows, [1e5, 1e3], [0.3])["sand"]["cfl"] == [0.2]
    results = {"youngs_modulus": [1e3, 1e5], "poissons_ratio": [0.3], "cfl": [0.2, 0.4, 1.0, 1.5]}
    assert {KINDS[kind] for kind in kinds_of(rows, results, 0).flat} == {"crushed"}
    assert [KINDS[kind] for kind in kinds_of(rows, results, 1).flat] == ["all stable"] * 3 + ["all diverge"]


def test_colours_say_what_becomes_of_the_worst_body() -> None:
    rows = rows_of({0.5: ["ssss"]}) + rows_of({0.5: ["sedd"]}) + rows_of({0.5: ["ssds"]})
    results = {"youngs_modulus": [1e5], "poissons_ratio": [0.0, 0.1, 0.2, 0.3], "cfl": [0.5]}
    # a limit of 0 is that of crushed bodies
    assert [KINDS[kind] for kind in kinds_of(rows, results, 0).flat] == ["all stable", *["crushed"] * 3]
    rows += rows_of({0.1: ["ssss"]})
    kinds = [KINDS[kind] for kind in kinds_of(rows, results | {"cfl": [0.1, 0.5]}, 0)[1]]
    assert kinds == ["all stable", "some gain energy", "some diverge", "some diverge"]


def test_the_measured_limits_are_at_least_the_predicted_ones_but_for_the_spacing_of_levels() -> None:
    for material in MATERIALS:
        for ratio in (-0.5, -0.25, 0.0, 0.15, 0.3, 0.4, 0.45, 0.49, 0.499):
            assert stable_cfl(material, ratio) > single_particle_limit(ratio) - 0.12


def test_between_and_beyond_the_measured_ratios_the_limit_stays_between_its_neighbours() -> None:
    for material in MATERIALS:
        low, middle, high = (stable_cfl(material, ratio) for ratio in (0.4, 0.425, 0.45))
        assert min(low, high) <= middle <= max(low, high)
        assert stable_cfl(material, 0.4999) == stable_cfl(material, 0.499)
    assert stable_cfl("granite", 0.3) == min(stable_cfl(material, 0.3) for material in MATERIALS)


@pytest.mark.parametrize("material", list(MATERIALS))
def test_a_time_step_is_refused_above_the_limit_of_its_material_alone(material: str) -> None:
    one = Stability(SimulationSettings(1e-3), MATERIALS[material].defaults, 2.0, material)
    limit = 1e-3 * one.stable_cfl / one.cfl
    replace(one, settings=SimulationSettings(0.999 * limit)).check()
    with pytest.raises(UserError) as caught:
        replace(one, settings=SimulationSettings(1.001 * limit)).check()
    # rounded down to three digits, so that the step that is named is accepted
    named = float(str(caught.value).partition("accepted: at most ")[2].partition(" s")[0])
    assert 0.99 * limit < named <= limit
    assert "youngs_modulus at most" in replace(one, settings=SimulationSettings(limit)).limit


def context_for(folder: Path, interrupt_at: int | None = None) -> BenchmarkContext:
    def advance(done: int, _total: int, _what: str) -> None:
        if done == interrupt_at:
            raise KeyboardInterrupt

    return BenchmarkContext(CPU, 0, folder, advance, Yardstick(CPU, size=8), laws_for)


def tiny_options(*more: str) -> dict[str, Any]:
    return dict(compose_config("benchmark", ["problem=stability", *TINY, *more]).problem)


def test_an_interrupted_map_goes_on_where_it_was(tmp_path: Path) -> None:
    options = tiny_options() | {"materials": ["elasticity"]}
    with pytest.raises(KeyboardInterrupt):
        stability.run(options, context_for(tmp_path, interrupt_at=3))
    partial = tmp_path / "stability.partial.jsonl"
    assert len(partial.read_text().splitlines()) == 1 + 3
    # a mark on a stored row shows that it is not computed again
    partial.write_text(partial.read_text().replace('"row": "ssss"', f'"row": "{GAINS_ENERGY * 4}"'))
    rows = stability.run(options, context_for(tmp_path))["rows"]
    assert [row["fates"] == ["ee", "ee"] for row in rows] == [True, False, True, False]
    # the file of the limits changes no row
    again = stability.run(options | {"limits": str(tmp_path / "limits.json")}, context_for(tmp_path))
    assert again["rows"] == rows
    assert json.loads((tmp_path / "limits.json").read_text())["limits"] == again["limits"]


def test_the_document_holds_the_map_and_a_picture_shows_it(in_process: Any, tmp_path: Path) -> None:
    outcome = in_process(benchmark, "benchmark", "problem=stability", *TINY, "output=o")
    assert outcome.status == 0, outcome.err
    assert {path.name for path in (tmp_path / "o").iterdir()} == {"stability.json", "stability.png"}
    results = json.loads((tmp_path / "o/stability.json").read_text())["results"]
    assert len(results["rows"]) == 2 * 2 * 2
    for row in results["rows"]:
        assert [len(word) for word in row["fates"]] == [2, 2]
        if row["cfl"] == 0.5:
            assert row["fates"] == ["ss", "ss"]
    assert {row["flow"] for row in results["rows"] if row["material"] == "sand"} == {30.0}
    assert results["limits"]["elasticity"] == {"poissons_ratio": [0.0, 0.4], "cfl": [0.5, 0.5]}
    assert "0.5" in outcome.out


@pytest.mark.parametrize(
    ("argument", "message"),
    [
        ("problem.poissons_ratio=[0.5]", "problem.poissons_ratio: 0.5 is not accepted"),
        ("problem.friction_angle=[90.0]", "problem.friction_angle: 90.0 is not accepted"),
        ("problem.cfl=[]", "problem.cfl=[]"),
        ("problem.motions=[droped]", "did you mean 'dropped'"),
        ("problem.steps=0", "problem.steps: 0"),
    ],
)
def test_wrong_options_are_one_line(argument: str, message: str, in_process: Any) -> None:
    outcome = in_process(benchmark, "benchmark", "problem=stability", argument, "output=o")
    assert (outcome.status, len(outcome.err.splitlines())) == (2, 1)
    assert message in outcome.err
