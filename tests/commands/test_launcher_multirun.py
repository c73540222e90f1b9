"""Sweeps: every job runs, each in a place of its own, and the worst exit status stays."""

import re
from typing import Any

import pytest

from pcnclaws.errors import SimulationDiverged, UserError


@pytest.mark.parametrize(
    "arguments",
    [("--multirun", "seed=1,2"), ("seed=1,2", "--multirun"), ("seed=1,2", "-m", "experiment=sand_single")],
)
def test_each_job_has_its_own_folder_wherever_the_flag_stands(arguments, in_process, tmp_path):
    seen = []
    assert in_process(seen.append, "train", *arguments).status == 0
    assert [config.seed for config in seen] == [1, 2]
    assert len({config.output for config in seen}) == 2
    assert all(re.fullmatch(r"[A-Za-z0-9._/-]+/seed-[12]", config.output) for config in seen)
    assert list(tmp_path.iterdir()) == []


def test_the_same_job_of_another_sweep_goes_to_the_same_folder(in_process):
    seen = []
    in_process(seen.append, "train", "-m", "seed=1,2")
    in_process(seen.append, "train", "-m", "seed=2,5")
    assert seen[1].output == seen[2].output


def test_folder_names_stay_short(in_process):
    seen = []
    long = ",".join(f"{n}e-3" for n in range(1, 3))
    in_process(
        seen.append,
        "train",
        "-m",
        f"training.learning_rate={long}",
        "scene.centre=[0.5,0.5,0.5]",
        "scene.velocity=[0.0,0.0,0.0]",
        "simulation.gravity=[0.0,-9.8,0.0]",
        "data.train_scenes=12",
    )
    assert len({config.output for config in seen}) == 2
    assert all(len(config.output.rpartition("/")[2]) <= 100 for config in seen)


def test_fixed_options_do_not_fill_the_names_and_do_not_collide(in_process):
    seen, options = [], ("experiment=sand_multi", "training.learning_rate=1e-3,1e-2", "picture=false", "data.folder=d")
    in_process(seen.append, "train", "-m", *options)
    in_process(seen.append, "train", "-m", *options, "training.iterations=0")
    names = ["training.learning_rate-0.001", "training.learning_rate-0.01"]
    assert [config.output for config in seen] == [
        f"outputs/runs/{parent}/{name}"
        for parent in ("sand_multi", "sand_multi_training.iterations-0")
        for name in names
    ]


def fails_with(errors: dict[int, Exception]):
    """A task that fails for some seeds, and the list of the seeds that it ran for."""
    ran = []

    def task(config: Any) -> None:
        ran.append(config.seed)
        if config.seed in errors:
            raise errors[config.seed]

    return task, ran


def _status(error: Exception | None) -> int:
    return 0 if error is None else 2 if isinstance(error, UserError) else 1


@pytest.mark.parametrize(
    ("errors", "status"),
    [
        pytest.param({1: SimulationDiverged("left")}, 1, marks=pytest.mark.slow),
        pytest.param({2: UserError("wrong")}, 2, marks=pytest.mark.slow),
        ({1: SimulationDiverged("left"), 3: UserError("wrong")}, 2),
        pytest.param({1: UserError("wrong"), 3: SimulationDiverged("left")}, 2, marks=pytest.mark.slow),
        ({2: RuntimeError("a bug")}, 1),
    ],
)
def test_a_failed_job_does_not_stop_the_others_and_the_worst_status_stays(errors, status, in_process):
    task, ran = fails_with(errors)
    outcome = in_process(task, "train", "--multirun", "seed=1,2,3")
    assert ran == [1, 2, 3]
    assert outcome.status == status
    words = {0: "done", 1: "failed", 2: "refused"}
    table = [line.split()[:2] for line in outcome.out.splitlines() if "seed-" in line]
    assert table == [[str(seed), words[_status(errors.get(seed))]] for seed in (1, 2, 3)]
    lines = [line for line in outcome.err.splitlines() if line.startswith("error: ")]
    assert len(lines) == len(errors)
    assert all(f"seed={seed}" in line for seed, line in zip(sorted(errors), lines, strict=True))


def test_a_job_with_a_wrong_value_is_refused_and_the_others_run(in_process):
    task, ran = fails_with({})
    assert in_process(task, "train", "seed=1,a,3", "--multirun").status == 2
    assert ran == [1, 3]


@pytest.mark.parametrize("output", ["output=x", "'output=${paths.outputs}/x'"])
def test_an_output_shared_by_the_jobs_is_refused(output, in_process):
    task, ran = fails_with({})
    outcome = in_process(task, "train", "--multirun", "seed=1,2", output.strip("'"))
    assert outcome.status == 2
    assert "shared" in outcome.err
    assert len(ran) <= 1


def test_an_output_that_names_what_is_swept_is_accepted(in_process):
    seen = []
    assert in_process(seen.append, "train", "--multirun", "seed=1,2", "output=x_${seed}").status == 0
    assert [config.output for config in seen] == ["x_1", "x_2"]


def test_an_option_that_one_swept_material_lacks_is_named(in_process):
    outcome = in_process(
        lambda config: None, "simulate", "-m", "material=sand,elasticity", "parameters.friction_angle=30"
    )
    assert outcome.status == 2
    assert "accepted: parameters.poissons_ratio, parameters.youngs_modulus" in outcome.err
