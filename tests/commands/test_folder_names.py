"""Default folders: the same options give the same one, other options another, and a sweep's bear what was swept."""

import re

import pytest

from pcnclaws.commands.composition import compose_config
from pcnclaws.commands.folder_names import LONGEST_NAME, folder_names

RUNS = "outputs/runs"


def run_folder(*overrides: str) -> str:
    return compose_config("train", overrides).output


def test_a_training_that_differs_has_a_folder_of_its_own() -> None:
    plain = run_folder("experiment=sand_multi")
    assert plain == f"{RUNS}/sand_multi"
    other = run_folder("experiment=sand_multi", "training.learning_rate=0.05")
    assert other == f"{RUNS}/sand_multi_training.learning_rate-0.05"
    assert other == run_folder("training.learning_rate=5e-2", "experiment=sand_multi"), "however it is written"
    others = [
        folder_names(["experiment=sand_multi", *options]).apart
        for options in (
            ("seed=5",),
            ("model=pcnclaws_paper",),
            ("training=initial",),
            ("precision=float64",),
            ("data.trajectories=a/b.h5",),
            ("data.trajectories=a_b.h5",),
            ("data.trajectories=a_b_h5",),
            ("simulation.gravity=[0,-9.8,0]",),
            ("simulation.gravity=[0,-9.8,1]",),
            ("debug=fast",),
        )
    ]
    assert not any(name.endswith(".h5") for name in others), "the ending of a file is refused"
    others.append(folder_names(["debug=fast", "experiment=elasticity_multi"]).apart)
    assert len({"", *others}) == len(others) + 1


def test_options_that_change_no_result_change_no_folder() -> None:
    free = ("picture=false", "threads=1", "device=auto", "logger.every=3", "data.folder=d", "simulation.skip=none")
    assert run_folder("experiment=sand_multi", *free, "overwrite=true") == f"{RUNS}/sand_multi"
    assert run_folder("name=mine", "seed=3") == f"{RUNS}/mine", "a name of one's own is the name"
    assert folder_names(["paths.outputs=o", "material=sand", "model=pcnclaws"]).apart == "", "they are in the name"


@pytest.mark.parametrize(
    ("overrides", "swept", "apart", "job"),
    [
        (["seed=3", "training.iterations=7", "picture=false"], ["seed"], "_training.iterations-7", "/seed-3"),
        (["experiment=sand_multi"], ["experiment"], "", ""),
        (["experiment=sand_multi", "device=cpu"], ["device"], "", "/device-cpu"),
        (["material=sand", "seed=1"], ["material"], "_seed-1", "/material-sand"),
    ],
)
def test_jobs_bear_the_swept_options_alone(overrides: list[str], swept: list[str], apart: str, job: str) -> None:
    names = folder_names(overrides, swept)
    assert (names.apart, names.job) == (apart, job)
    assert names.sweep == f"{apart.replace('_', '/', 1)}{job}"


def test_names_stay_short_and_different() -> None:
    many = [f"simulation.skip.option_{k}=0.123456789" for k in range(6)] + ["scene.mesh=/a/long/path with spaces/x.stl"]
    names = {folder_names([*many, f"seed={k}"], ["seed", *(one.partition("=")[0] for one in many)]).job for k in (1, 2)}
    assert len(names) == 2
    assert all(len(name) <= LONGEST_NAME + 1 and re.fullmatch(r"/[A-Za-z0-9._-]+", name) for name in names)
