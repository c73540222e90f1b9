"""Run time against error: known answers, orders of convergence, the document and its pictures, the presets."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from benchmarks import run_time_vs_error
from benchmarks.__main__ import benchmark
from benchmarks.cases import NEURAL_MODEL
from benchmarks.cell_lattices import Box, block_means, filled
from benchmarks.closed_forms import (
    CLOSED_FORMS,
    DENSITY,
    YOUNGS_MODULUS,
    AxialMotion,
    FreeBar,
    SteadyRotation,
    TravellingWave,
)
from benchmarks.context import BenchmarkContext
from benchmarks.convergence import orders_table, reference_errors
from benchmarks.floor_scenes import SIDE, Drop, SoftBounce
from benchmarks.free_motions import FreeMotion
from benchmarks.orders import GridError, error_of_reference, order_of, orders_of
from benchmarks.run_time_vs_error_report import pareto_front
from benchmarks.sweep import PRESETS, automatic_of
from benchmarks.timed_runs import PAPER, PAPER_NODES, Resolution, timed_run
from benchmarks.yardstick import Yardstick
from pcnclaws.commands.composition import compose_config
from pcnclaws.commands.configuration import settings_from, start_from
from pcnclaws.commands.runs import laws_for
from pcnclaws.laws.analytic import Laws, analytic_laws
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.laws.neural import build_neural_laws

CPU = torch.device("cpu")
ELASTIC = analytic_laws(MATERIALS["elasticity"])
POINTS = np.array([[0.31, 0.47, 0.52], [0.52, 0.53, 0.46], [0.4, 0.5, 0.5]])
TINY = [
    *("problem.materials=[elasticity]", "problem.problems=[bounce,bar]", "problem.grid_nodes=[10,20]"),
    *("problem.per_cell=[1]", "problem.time_factors=[2.0]", "problem.compare_at=[10]", "problem.presets=false"),
    *("problem.reference_nodes=20", "problem.reference_factor=1.0"),
]


def errors_on(name: str, *resolutions: Resolution, laws: Laws = ELASTIC) -> list[dict[str, float]]:
    """Errors of a closed form at several resolutions, in double precision."""
    motion = FreeMotion(name, CLOSED_FORMS[name])
    return [
        motion.errors(timed_run(motion, laws, replace(resolution, precision="float64"), CPU))
        for resolution in resolutions
    ]


@pytest.mark.parametrize("name", list(CLOSED_FORMS))
def test_velocities_and_gradients_of_a_closed_form_belong_to_its_positions(name: str) -> None:
    exact, time, little = CLOSED_FORMS[name], 0.0043, 1e-6
    now, after, before = (exact.motion(POINTS, t) for t in (time, time + little, time - little))
    np.testing.assert_allclose(now.velocity, (after.position - before.position) / (2 * little), atol=1e-7)
    rate = (after.deformation - before.deformation) / (2 * little)
    np.testing.assert_allclose(now.affine @ now.deformation, rate, atol=1e-7)
    for axis in range(3):
        step = little * np.eye(3)[axis]
        right, left = (exact.motion(POINTS + side * step, time).position for side in (1.0, -1.0))
        np.testing.assert_allclose(now.deformation[:, :, axis], (right - left) / (2 * little), atol=1e-7)


@pytest.mark.parametrize("exact", [FreeBar(), TravellingWave()])
def test_axial_motions_solve_the_wave_equation_and_leave_the_ends_free(exact: AxialMotion) -> None:
    along, time, h, tau = np.linspace(0.35, 0.55, 9), 0.0043, 1e-4, 5e-6
    u, left, right = (exact.axial(along + side * h, time)[0] for side in (0.0, -1.0, 1.0))
    before, after = (exact.axial(along, time + side * tau)[0] for side in (-1.0, 1.0))
    bending, acceleration = (left - 2 * u + right) / h**2, (before - 2 * u + after) / tau**2
    speed_squared = YOUNGS_MODULUS / DENSITY
    np.testing.assert_allclose(acceleration, speed_squared * bending, atol=1e-4 * np.abs(acceleration).max())
    ends = np.array([exact.box.corner[0], exact.box.corner[0] + exact.box.sides[0]])
    for t in (0.0, exact.duration):
        assert np.abs(exact.axial(ends, t)[1]).max() < 2e-3 * exact.largest_strain


def test_a_steady_rotation_balances_inertia_and_stress() -> None:
    exact, h = SteadyRotation(), 1e-3
    points = exact.box.middle + np.array([[0.02, 0.0, 0.0], [0.1, 0.0, 0.0]])
    sides = [exact.stretched(points + side * np.array([h, 0.0, 0.0]))[0][:, 0] for side in (-1.0, 0.0, 1.0)]
    bending = (sides[0] - 2 * sides[1] + sides[2]) / h**2
    np.testing.assert_allclose(YOUNGS_MODULUS * bending, -DENSITY * exact.spin**2 * sides[1], rtol=1e-3)
    corner = np.asarray(exact.box.corner)[None]
    np.testing.assert_allclose(exact.stretched(corner)[1], 1.0, atol=1e-12)


def test_the_free_bar_converges_with_order_two() -> None:
    coarse, fine = errors_on("bar", Resolution(10, 1, 2.0), Resolution(20, 1, 2.0))
    assert fine["error"] < 0.02
    for quantity in ("error", "frequency_error"):
        first, second = (GridError(1 / n, abs(row[quantity])) for n, row in ((10, coarse), (20, fine)))
        assert order_of(first, second) == pytest.approx(2.0, abs=0.15)
    assert coarse["amplitude_left"] < fine["amplitude_left"] < 1.0


def test_a_finer_grid_carries_an_elastic_wave_better() -> None:
    coarse, fine = errors_on("wave", Resolution(20, 1, 2.0), Resolution(40, 1, 2.0))
    assert fine["error"] < 0.3 * coarse["error"]
    assert abs(fine["speed_error"]) < 0.004


def test_a_rotation_keeps_its_angular_momentum_and_its_angle() -> None:
    (row,) = errors_on("rotation", Resolution(20, 2, 2.0))
    assert abs(row["angular_momentum_error"]) < 1e-12
    assert abs(row["angle_error"]) < 1e-4
    assert row["shape_error"] < 1e-4


def test_untrained_neural_laws_have_the_moduli_of_the_closed_forms() -> None:
    from_scratch = build_neural_laws(MATERIALS["elasticity"], NEURAL_MODEL)
    analytic, neural = (errors_on("bar", Resolution(10, 1, 2.0), laws=laws)[0] for laws in (ELASTIC, from_scratch))
    assert neural["frequency_error"] == pytest.approx(analytic["frequency_error"], abs=1e-4)


@pytest.mark.parametrize("reference", [0.0, 1 / 60])
@pytest.mark.parametrize("order", [0.7, 1.0, 2.3])
def test_orders_are_found_in_errors_that_have_one(order: float, reference: float) -> None:
    series = [GridError(h, 3.0 * (h**order - reference**order)) for h in (0.1, 0.05, 0.025)]
    assert orders_of(series, reference) == pytest.approx([order, order])
    if reference:
        assert error_of_reference(series[-1], order, reference) == pytest.approx(3.0 * reference**order)


def test_growing_errors_have_no_order() -> None:
    assert order_of(GridError(0.1, 1.0), GridError(0.05, 1.1)) is None
    assert order_of(GridError(0.1, 1.0), GridError(0.05, 0.0)) is None


def test_orders_are_taken_along_grids_that_share_everything_else() -> None:
    def row(nodes: int, factor: float, error: float | None, material: str = "sand") -> dict[str, Any]:
        names = {"problem": "drop", "material": material, "law": "analytic", "precision": "float32"}
        return (
            names
            | {"grid_nodes": nodes, "per_cell": 2, "time_factor": factor, "skips": True, "backend": "auto"}
            | {"error": error}
        )

    def measured(nodes: int) -> float:
        return 1 / nodes - 1 / 80  # of first order, against a grid of 80 nodes

    rows = [row(40, 1.0, measured(40)), row(20, 1.0, measured(20)), row(20, 2.0, 0.3), row(40, 2.0, 0.1)]
    rows += [row(20, 1.0, None, "plasticine"), row(40, 1.0, 0.1, "plasticine")]
    references = [row(80, 1.0, None)]
    (series,) = orders_table(rows, references)  # neither the other time step nor what diverged
    assert (series["grid_nodes"], series["orders"]) == ([20, 40], pytest.approx([1.0]))
    (reference,) = reference_errors(references, [series])
    assert reference["estimated_error"] == pytest.approx(1 / 80)


def test_block_means_of_a_linear_map_are_those_of_any_lattice() -> None:
    box = Box((0.1, 0.2, 0.3), (0.5, 0.5, 0.5))
    turn = np.array([[1.0, 0.2, 0.0], [-0.3, 0.9, 0.1], [0.0, 0.4, 1.1]])
    means = []
    for spacing in (0.1, 0.05, 0.5 / 15):
        lattice = filled(box, spacing)
        assert lattice.volume.sum() == pytest.approx(0.125)
        means.append(block_means((turn @ lattice.position.T)[None], lattice.counts, blocks=5))
    assert means[0].shape == (1, 3, 125)
    np.testing.assert_allclose(means[1], means[0], atol=1e-14)
    np.testing.assert_allclose(means[2], means[0], atol=1e-14)


@pytest.mark.parametrize("nodes", [10, 20, 30, 40])
@pytest.mark.parametrize("factor", [0.5, 1.25, 3.0])
def test_frames_of_all_resolutions_are_of_the_same_times(nodes: int, factor: float) -> None:
    resolution = Resolution(nodes, 1, factor)
    for scenario in (Drop("sand"), SoftBounce("sand")):
        start = scenario.start(resolution.lattice(scenario.box), resolution)
        interval = scenario.duration / scenario.frames
        steps = resolution.steps_between(interval)
        assert steps * start.settings.time_step == pytest.approx(interval, rel=1e-12)
        wanted = factor * PAPER.time_step * PAPER_NODES / nodes
        assert start.settings.time_step == pytest.approx(wanted, rel=0.1)


def test_a_soft_bounce_is_compressed_and_leaves_the_floor_again() -> None:
    run = timed_run(SoftBounce("elasticity"), ELASTIC, Resolution(20, 1, 2.0), CPU)
    height = SoftBounce("elasticity").means(run)[:, 1].mean(1) - 0.1
    assert height.min() < 0.5 * SIDE - 0.005
    assert height[-1] > height.min() + 0.005


def test_the_pareto_front_holds_what_nothing_beats_in_both() -> None:
    points = [(1.0, 5.0), (2.0, 6.0), (3.0, 2.0), (3.0, 3.0), (9.0, 1.0), (10.0, 1.0)]
    assert pareto_front(points) == [(1.0, 5.0), (3.0, 2.0), (9.0, 1.0)]


def context_for(folder: Path, interrupt_at: int | None = None) -> BenchmarkContext:
    def advance(done: int, _total: int, _what: str) -> None:
        if done == interrupt_at:
            raise KeyboardInterrupt

    return BenchmarkContext(CPU, 0, folder, advance, Yardstick(CPU, size=8), laws_for)


def tiny_options() -> dict[str, Any]:
    return dict(compose_config("benchmark", ["problem=run_time_vs_error", *TINY]).problem)


@pytest.mark.slow
def test_an_interrupted_run_goes_on_where_it_was(tmp_path: Path) -> None:
    options = tiny_options() | {"problems": ["bounce"], "laws": ["analytic"], "grid_nodes": [10]}
    with pytest.raises(KeyboardInterrupt):
        run_time_vs_error.run(options, context_for(tmp_path, interrupt_at=2))
    kept = [json.loads(line) for line in (tmp_path / "run_time_vs_error.partial.jsonl").read_text().splitlines()[1:]]
    assert [line["key"].startswith("reference") for line in kept] == [True, False]
    results = run_time_vs_error.run(options, context_for(tmp_path))
    assert results["rows"][0] == kept[1]["row"]  # its seconds, too: not measured again
    assert len(results["rows"]) == 4


@pytest.mark.slow
def test_the_document_holds_every_setting_and_a_picture_a_material(in_process: Any, tmp_path: Path) -> None:
    options = [option.replace("[bounce,bar]", "[bar]") for option in TINY]
    outcome = in_process(benchmark, "benchmark", "problem=run_time_vs_error", *options, "output=o")
    assert outcome.status == 0, outcome.err
    results = json.loads((tmp_path / "o/run_time_vs_error.json").read_text())["results"]
    assert {path.name for path in (tmp_path / "o").iterdir()} == {
        "run_time_vs_error.json",
        "run_time_vs_error_elasticity.png",
    }
    assert {(row["problem"], row["law"]) for row in results["rows"]} == {("bar", "analytic"), ("bar", "neural")}
    analytic = [row for row in results["rows"] if row["law"] == "analytic"]
    assert {row["precision"] for row in analytic} == {"float32", "float64"}
    assert {row["backend"] for row in analytic} == {"auto", "torch"}
    assert {row["skips"] for row in analytic} == {True, False}
    for row in results["rows"]:
        assert 0.0 < row["error"] < 0.1
        assert row["seconds"] > 0.0
    assert all("means" not in row for row in (*results["rows"], *results["references"]))
    orders = {(row["problem"], row["law"], row["precision"]): row["orders"] for row in results["orders"]}
    assert orders["bar", "analytic", "float64"] == pytest.approx([2.0], abs=0.15)


def test_a_time_step_that_diverges_is_a_row_without_an_error(tmp_path: Path) -> None:
    few = {"problems": ["bar"], "laws": ["analytic"], "grid_nodes": [20], "compare_at": [], "time_factors": [20.0]}
    options = tiny_options() | few
    rows = run_time_vs_error.run(options, context_for(tmp_path))["rows"]
    assert any(row["error"] is None and "diverged" in row["diverged"] for row in rows)


@pytest.mark.parametrize(
    ("argument", "message"),
    [
        ("problem.grid_nodes=[25]", "problem.grid_nodes: 25 is not accepted; accepted: multiples of 10"),
        ("problem.reference_nodes=45", "problem.reference_nodes: 45"),
        ("problem.time_factors=[0.0]", "problem.time_factors: 0.0 is not accepted"),
        ("problem.problems=[dorp]", "problem.problems='dorp' is not known"),
        ("problem.law=nowhere", "problem.law=nowhere is not a folder"),
        ("problem.backend=tocrh", "did you mean 'torch'"),
    ],
)
def test_wrong_options_are_one_line(argument: str, message: str, in_process: Any) -> None:
    outcome = in_process(benchmark, "benchmark", "problem=run_time_vs_error", argument, "output=o")
    assert (outcome.status, len(outcome.err.splitlines())) == (2, 1)
    assert message in outcome.err


@pytest.mark.parametrize("name", list(PRESETS))
@pytest.mark.parametrize("entry", ["simulate", "generate", "train"])
def test_a_preset_simulates_the_papers_scene_for_the_papers_time(name: str, entry: str) -> None:
    paper, config = compose_config(entry), compose_config(entry, [f"simulation={name}"])
    settings, resolution = settings_from(config.simulation, MATERIALS["sand"]), PRESETS[name]
    assert settings == replace(PAPER, grid_spacing=settings.grid_spacing, time_step=settings.time_step)
    assert config.simulation.steps * settings.time_step == pytest.approx(paper.simulation.steps * PAPER.time_step)
    assert config.simulation.steps % config.simulation.every == 0
    # what the benchmark measures under the preset's name
    assert settings.grid_spacing == 1 / resolution.grid_nodes
    assert settings.time_step == pytest.approx(
        resolution.time_factor * PAPER.time_step * PAPER_NODES * settings.grid_spacing
    )
    assert config.scene.particles_per_edge == round(SIDE / settings.grid_spacing * resolution.per_cell)


def test_options_of_a_preset_can_be_changed() -> None:
    changed = ["scene.particles_per_edge=4", "simulation.steps=7", "simulation.skip=none", "scene.side=0.3"]
    config = compose_config("simulate", ["simulation=accurate", *changed])
    assert config.simulation.steps == 7
    assert not any(config.simulation.skip.values())
    assert len(start_from(config).position) == 64


@pytest.mark.parametrize("material", list(MATERIALS))
def test_the_automatic_time_step_is_measured_as_simulate_chooses_it(material: str) -> None:
    options = tiny_options() | {"presets": True}
    (resolution,) = automatic_of(options, "drop", material)
    chosen = start_from(compose_config("simulate", [f"material={material}", "simulation.time_step=auto"])).settings
    assert (resolution.grid_nodes, resolution.per_cell) == (round(1 / chosen.grid_spacing), 1)
    # particles on the faces, as simulate puts them, are half a spacing nearer to the floor
    assert resolution.time_factor * PAPER.time_step == pytest.approx(chosen.time_step, rel=0.01)
