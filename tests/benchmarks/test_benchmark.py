"""The benchmark command: result documents, pictures from them alone, and refusals."""

import json
import sys
from dataclasses import asdict, fields
from pathlib import Path

import pytest
import torch

from benchmarks.__main__ import benchmark
from benchmarks.cases import Case, Prepared
from benchmarks.charts import axis_floor
from benchmarks.context import Checkpointed
from benchmarks.own_laws import WORK
from benchmarks.processes import peak_memory, seconds_of_process
from benchmarks.skip_trials import TRIALS, switched_off
from benchmarks.yardstick import Timing, Yardstick, cost_of, interleaved
from pcnclaws.commands.composition import compose_config
from pcnclaws.simulation.fast_paths import Skips

CPU = torch.device("cpu")
SMOKE = {
    "own_laws": ["problem.pairs=[cohesion]", "problem.scenes=1", "problem.steps=2", "problem.samples=3"],
    "step_cost": [
        *("problem.backends=[torch]", "problem.scenes=[2,1]", "problem.bodies=[]", "problem.steps=2"),
        *("problem.samples=1", "problem.memory_steps=0", "problem.first_call=false"),
    ],
    "scaling": [
        *("problem.backends=[torch]", "problem.edges=[6,8]", "problem.scenes=[1,2]", "problem.threads=[1,2]"),
        *("problem.thread_edges=[6]", "problem.steps=2", "problem.samples=1", "problem.memory=false"),
    ],
    "skips": [
        *("problem.backends=[torch]", "problem.particles_per_edge=4", "problem.steps=8", "problem.samples=1"),
        *("problem.switches=[free_fall,history,all]", "problem.memory=false"),
    ],
    "data_parallel": [
        *("problem.segments=2", "problem.iterations=1", "problem.scenes=2", "problem.particles_per_edge=4"),
        "problem.memory_edges=[4]",
    ],
    "coverage": [
        *("problem.kinds=[elasticity]", "problem.objects=2", "problem.profiles=1", "problem.steps=120"),
        "problem.iterations=3",
    ],
    "fine_tuning": [
        *("problem.pairs=[mohr_coulomb]", "problem.scenes=1", "problem.fine_tuning=[1]", "problem.training=[1]"),
        "problem.steps=160",
    ],
    "foreign_laws": [
        *("problem.materials=[ogden,cap]", "problem.scenes=1", "problem.iterations=1", "problem.steps=160"),
        *("problem.models=[pcnclaws_energy,pcnclaws_convex]", "problem.iterations_of_least_squares=1"),
    ],
    "return_maps": [
        *("problem.materials=[cap]", "problem.models=[pcnclaws_convex]", "problem.samples=64"),
        *("problem.iterations=2", "problem.steps=20"),
    ],
    "imperfect_data": [
        *("problem.cases=[false_robust,noise]", "problem.scenes=4", "problem.iterations=4", "problem.steps=160"),
        "problem.iterations_from_positions=1",
    ],
    "rendering": ["problem.particles_per_edge=8", "problem.frames=4", "problem.colours=[speed]"],
    "transfers": [
        *("problem.transfers=[apic,axpic2]", "problem.cells=4", "problem.cfl=[0.2]", "problem.periods=1"),
        *("problem.long_cfl=0.4", "problem.long_periods=2", "problem.scenes=1", "problem.steps=2", "problem.samples=1"),
    ],
    "training_methods": [
        *("problem.iterations.kalman=[1,2]", "problem.iterations.adam=[1]", "problem.seeds.kalman=2"),
        *("problem.scenes=1", "problem.steps=160"),
    ],
    "training": [
        *("problem.backends=[torch]", "problem.iterations=[1,2]", "problem.train_scenes=2"),
        *("problem.particles_per_edge=6", "problem.steps=20"),
    ],
}


DEAR = (
    "coverage",
    "data_parallel",
    "rendering",
    "own_laws",
    "fine_tuning",
    "foreign_laws",
    "return_maps",
    "imperfect_data",
    "training_methods",
    "training",
    "scaling",
    "step_cost",
    "skips",
)


def check_own_laws(results: dict) -> None:
    assert [(row["pair"], row["work"]) for row in results["rows"]] == [("cohesion", work) for work in WORK]
    for row in results["rows"]:
        ends = [row["own_ms"][a] / row["built_in_ms"][b] for a, b in (("min", "max"), ("max", "min"))]
        assert ends[0] <= row["ratio"] <= ends[1]


def check_step_cost(results: dict) -> None:
    rows = results["rows"]
    assert [(row["kind"], row["scenes"]) for row in rows] == [(kind, scenes) for scenes in (2, 1) for kind in "ABCD"]
    for row in rows:
        assert row["particles"] == 1000 * row["scenes"]
        times, products = row["ms_per_1000"], row["matmul_ms"]
        assert 0.0 < times["min"] <= times["median"] <= times["max"]
        assert row["cost"] == pytest.approx(1e3 * times["min"] / products["min"])
        assert row["aim"] < row["at_most"]


def check_scaling(results: dict) -> None:
    assert [row["particles"] for row in results["particles"]] == [216, 512]
    assert [row["scenes"] for row in results["scenes"]] == [1, 2]
    assert [row["threads"] for row in results["threads"]] == [1, 2]
    assert torch.get_num_threads() == 1


def check_skips(results: dict) -> None:
    assert [row["switch"] for row in results["rows"]] == ["free_fall", "history", "all"]
    for row in results["rows"]:
        assert row["gain"] == pytest.approx(row["off_ms"]["min"] / row["on_ms"]["min"])
        assert row["relative_difference"] < 1e-4


def check_training(results: dict) -> None:
    assert [row["iterations"] for row in results["rows"]] == [1, 2]
    for row in results["rows"]:
        assert row["seconds"] > 0.0
        assert row["mse"] == pytest.approx(sum(scene["mse"] for scene in row["scenes"]) / 3)


def check_transfers(results: dict) -> None:
    rows = {(row["transfer"], row["periods"]): row for row in results["bars"]}
    assert set(rows) == {(transfer, periods) for transfer in ("apic", "axpic2") for periods in (1, 2)}
    assert rows["apic", 1]["kept"] < rows["axpic2", 1]["kept"] < 1.01
    assert len(results["costs"]) == 4
    assert all(row["ratio"] == 1.0 for row in results["costs"] if row["transfer"] == "apic")


def check_coverage(results: dict) -> None:
    first, second = results["rows"]
    assert set(first["numbers"]) == {"youngs_modulus", "poissons_ratio"}
    for one in first["numbers"].values():
        assert one["linear"][0] < one["estimate"] < one["linear"][1]
        assert one["profile"][0] < one["estimate"] < one["profile"][1]
    assert {one["profile"] for one in second["numbers"].values()} == {None}


def check_rendering(results: dict) -> None:
    assert (results["particles"], results["frames"]) == (512, 4)
    (row,) = results["rows"]
    assert (row["ending"], row["colour"]) == (".gif", "speed")
    assert min(row["seconds"], row["cpu_seconds"], row["megabytes"]) > 0.0


def check_data_parallel(results: dict) -> None:
    rows = {(row["processes"], row["segments"]): row for row in results["rows"]}
    assert set(rows) == {(1, 2), (2, 2), (2, 4)}
    assert rows[2, 2]["difference"] < 1e-5
    assert results["reduce"]["ms"] > 0.0
    assert results["memory"][0]["above_mb"] > 0.0
    assert 0.0 < results["file"]["frame"] < results["file"]["restart_state"]


def check_fine_tuning(results: dict) -> None:
    rows = {(row["start"], row["iterations"]): row for row in results["rows"]}
    assert set(rows) == {("shipped", 0), ("shipped", 1), ("nothing", 1)}
    assert rows["shipped", 0]["old"] < 1e-8 < rows["nothing", 1]["old"], "the shipped law knows its own material"


def check_foreign_laws(results: dict) -> None:
    assert [(row["material"], row["model"]) for row in results["rows"]] == [
        ("ogden", "pcnclaws_energy"),
        ("cap", "pcnclaws_convex"),
    ]
    for row in results["rows"]:
        assert 0.0 < row["unseen"] == pytest.approx(sum(row["scenes"]) / 3)


def check_return_maps(results: dict) -> None:
    (row,) = results["rows"]
    assert (row["material"], row["model"], len(row["by_lode"])) == ("cap", "pcnclaws_convex", 6)
    assert min(row["residual"], row["unseen"], *row["by_lode"]) > 0.0


def check_imperfect_data(results: dict) -> None:
    assert [row["case"] for row in results["rows"]] == ["false_robust", "noise"]
    for row in results["rows"]:
        assert len(row["scenes"]) == 3
        assert 0.0 < row["unseen"] == pytest.approx(sum(row["scenes"]) / 3)


def check_training_methods(results: dict) -> None:
    rows = [(row["method"], row["iterations"], row["seed"]) for row in results["rows"]]
    assert rows == [("kalman", 1, 0), ("kalman", 2, 0), ("kalman", 2, 1), ("adam", 1, 0)]
    for row in results["rows"]:
        assert row["cpu_seconds"] > 0.0 < row["unseen"] == pytest.approx(sum(row["scenes"]) / 3)


CHECKS = {
    "coverage": check_coverage,
    "data_parallel": check_data_parallel,
    "fine_tuning": check_fine_tuning,
    "foreign_laws": check_foreign_laws,
    "imperfect_data": check_imperfect_data,
    "own_laws": check_own_laws,
    "step_cost": check_step_cost,
    "rendering": check_rendering,
    "return_maps": check_return_maps,
    "scaling": check_scaling,
    "skips": check_skips,
    "training": check_training,
    "training_methods": check_training_methods,
    "transfers": check_transfers,
}


# PyTorch warns of its own use of torch.jit when it loads forward mode
@pytest.mark.filterwarnings("ignore:`torch.jit.script` is deprecated:DeprecationWarning")
@pytest.mark.usefixtures("own_registry")
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow) if name in DEAR else name for name in SMOKE]
)
def test_a_problem_leaves_its_document_and_pictures_and_can_be_redrawn(name: str, in_process, tmp_path: Path) -> None:
    outcome = in_process(benchmark, "benchmark", f"problem={name}", *SMOKE[name], "output=o", "seed=3")
    assert outcome.status == 0, outcome.err
    document = json.loads((tmp_path / "o" / f"{name}.json").read_text())
    assert set(document) == {"problem", "options", "provenance", "yardstick", "seconds", "results"}
    assert (document["problem"], document["provenance"]["seed"], document["provenance"]["threads"]) == (name, 3, 1)
    assert document["yardstick"]["matmul_2048_ms"] > 0.0
    CHECKS[name](document["results"])
    pictures = {path.name: path.read_bytes() for path in (tmp_path / "o").glob("*.png")}
    assert pictures
    assert {path.name for path in (tmp_path / "o").iterdir()} == {f"{name}.json", *pictures}
    assert len(outcome.err.splitlines()) == 1
    assert all(f"wrote o/{file}" in outcome.out for file in (f"{name}.json", *pictures))

    again = in_process(benchmark, "benchmark", f"problem={name}", f"redraw=o/{name}.json", "output=new")
    assert again.status == 0, again.err
    assert {path.name: path.read_bytes() for path in (tmp_path / "new").iterdir()} == pictures
    assert again.out.replace("new/", "o/") in outcome.out  # the same tables


def test_steps_on_a_gpu_have_a_table_and_a_picture_of_their_own(in_process, tmp_path: Path) -> None:
    measured = Path(__file__).parents[2] / "docs" / "results" / "step_cost_nvidia_h100.json"
    (tmp_path / "gpu.json").write_bytes(measured.read_bytes())
    outcome = in_process(benchmark, "benchmark", "problem=step_cost", "redraw=gpu.json", "output=new")
    assert outcome.status == 0, outcome.err
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["step_cost.png"]
    row = json.loads(measured.read_text())["results"]["rows"][0]
    assert f"{1e3 * row['ms_per_1000']['min'] * row['particles'] / 1000.0:.3g}" in outcome.out
    assert "aim [us]" in outcome.out
    assert "T/1000" not in outcome.out


@pytest.mark.parametrize(("costs", "floor"), [([0.83, 12.3], 0.1), ([2.1, 145.0], 1.0), ([1.0, 9.0], 0.1)])
def test_the_logarithmic_axis_begins_below_the_shortest_bar(costs: list[float], floor: float) -> None:
    assert axis_floor(costs) == pytest.approx(floor)


def test_every_switch_is_tried_alone_and_all_together() -> None:
    assert list(TRIALS) == compose_config("benchmark", ["problem=skips"]).problem["switches"]
    assert list(TRIALS) == [*(switch.name for switch in fields(Skips)), "all"]
    assert all(asdict(switched_off(name)) == {n: n != name for n in asdict(Skips())} for name in list(TRIALS)[:-1])
    assert switched_off("all") == Skips.none()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["problem=step_csot"], "did you mean 'step_cost'"),
        (["problem.backends=[troch]"], "problem.backends='troch' is not known"),
        (["problem.backends=[]"], "problem.backends=[]"),
        (["problem.backends=torch"], "problem.backends=torch is not accepted; accepted: a list"),
        (["problem.steps=0"], "problem.steps: 0 is not accepted"),
        (["problem.scenes=[1,0]"], "problem.scenes: 0 is not accepted"),
        (["problem.bodies=[500]"], "problem.bodies: 500 is not accepted"),
        (["problem=training", "problem.steps=30"], "problem.steps=30"),
        (["problem=training", "problem.material=snad"], "did you mean 'sand'"),
        (["problem=scaling", "problem.threads=[-1]"], "problem.threads: -1 is not accepted"),
        (["problem=skips", "problem.switches=[rset]"], "did you mean 'rest'"),
        (["redraw=missing.json"], "redraw=missing.json cannot be read"),
        (["redraw=other.json"], "redraw=other.json holds no results of problem=step_cost"),
        (["output=other.json"], "output=other.json ends like a file of another format"),
        (["output=other"], "output=other: other is a file; accepted: a folder"),
        (["threads=0"], "threads=0"),
    ],
)
def test_wrong_input_is_one_line_and_exit_2(arguments: list[str], message: str, in_process, tmp_path: Path) -> None:
    (tmp_path / "other.json").write_text('{"problem": "scaling", "results": {}}')
    (tmp_path / "other").touch()
    outcome = in_process(
        benchmark, "benchmark", *([] if arguments[0].startswith("output") else ["output=o"]), *arguments
    )
    assert outcome.status == 2
    assert message in outcome.err
    assert len(outcome.err.splitlines()) == 1
    assert not list(tmp_path.glob("o/*"))


def test_rows_survive_an_interruption_but_not_other_settings(tmp_path: Path) -> None:
    first = Checkpointed.load(tmp_path, "p", {"steps": 5})
    first.store("a", {"x": 1.5})
    first.store("b", [1, None])
    first.path.write_text(first.path.read_text() + '{"key": "c", "ro')  # killed while writing

    again = Checkpointed.load(tmp_path, "p", {"steps": 5})
    assert again.rows == {"a": {"x": 1.5}, "b": [1, None]}
    assert again.row("a", lambda: pytest.fail("made twice")) == {"x": 1.5}
    assert again.row("c", lambda: 7) == 7
    assert Checkpointed.load(tmp_path, "p", {"steps": 5}).rows == {"a": {"x": 1.5}, "b": [1, None], "c": 7}

    other = Checkpointed.load(tmp_path, "p", {"steps": 6})
    assert other.rows == {}
    other.store("a", 0)
    assert Checkpointed.load(tmp_path, "p", {"steps": 5}).rows == {}


def test_a_cost_is_the_fastest_call_over_the_fastest_matrix_product() -> None:
    timing = Timing([0.8, 0.4], [0.2, 0.16, 0.3])
    cost = cost_of(timing, particles=2000, steps=10)
    assert cost["ms_per_1000"] == pytest.approx({"min": 20.0, "median": 30.0, "max": 40.0})
    assert cost["cost"] == pytest.approx(20.0 / 0.16)


def test_matrix_products_stand_before_between_and_after_the_calls() -> None:
    yardstick, calls = Yardstick(CPU, size=8), []
    timing = interleaved(lambda: calls.append(len(yardstick.samples.get(1, []))), yardstick, samples=3)
    assert len(timing.seconds) == 3
    assert calls == [0, 1, 2, 3]  # the first one is not timed
    assert yardstick.samples[1] == timing.matmul


@pytest.mark.parametrize(
    ("laws", "material"), [("analytic", "elasticity"), pytest.param("neural", "sand", marks=pytest.mark.slow)]
)
def test_what_is_timed_is_a_body_in_contact_with_gradients_of_everything(laws: str, material: str) -> None:
    prepared = Prepared(Case(material, laws, scenes=2, particles_per_edge=6), CPU, settle=20)
    deformation = prepared.batch.state.deformation
    assert float((deformation - torch.eye(3)[:, :, None]).abs().max()) > 1e-2
    gradients = prepared.gradient(4)()
    assert isinstance(gradients, tuple)
    assert all(torch.isfinite(gradient).all() for gradient in gradients)
    assert any(gradient.abs().max() > 0.0 for gradient in gradients)
    assert len(gradients) == (len(list(prepared.simulator.parameters())) or 1)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="peak memory is read from /proc")
def test_a_larger_body_takes_more_memory() -> None:
    small, large = (
        peak_memory(Case("elasticity", particles_per_edge=edge), "forward", 2, "torch") for edge in (10, 40)
    )
    assert small is not None
    assert large is not None
    assert large["above_mb"] > small["above_mb"] + 64_000 * 96 / 1e6  # the state alone
    assert large["peak_mb"] == pytest.approx(large["library_mb"] + large["above_mb"])


@pytest.mark.slow
def test_the_time_of_a_first_call_is_that_of_a_process(tmp_path: Path) -> None:
    case = Case("elasticity", particles_per_edge=4)
    few, many = (seconds_of_process(case, "forward", steps, "torch", str(tmp_path)) for steps in (1, 400))
    assert 0.0 < few < many
