"""Every configuration that ships composes, and says what its comments say."""

import re
import shlex
from itertools import product
from pathlib import Path

import pytest
import torch

from pcnclaws.commands.choices import offer_choices
from pcnclaws.commands.composition import compose_config, composed_groups, conf_folder, register_resolvers
from pcnclaws.commands.configuration import (
    device_from,
    parameters_from,
    precision_from,
    settings_from,
    start_from,
    whole_number,
)
from pcnclaws.errors import UserError
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.simulation.time_step import largest_speed, stability_of

MAKEFILES = (
    "Makefile",
    "benchmarks/accuracy.mk",
    "benchmarks/estimation.mk",
    "benchmarks/baselines.mk",
    "benchmarks/unified.mk",
)

ENTRIES = [path.stem for path in sorted(conf_folder().glob("*.yaml"))]
OF_ONE_MATERIAL = [entry for entry in ENTRIES if entry not in ("benchmark", "observe", "export", "render")]
PROBLEMS = [path.stem for path in sorted((conf_folder() / "problem").glob("*.yaml"))]
EXPERIMENTS = [path.stem for path in sorted((conf_folder() / "experiment").glob("*.yaml"))]
BASELINES = ("nclaws", "spline", "gns", "identified")
CHOICES = [
    (path.parent.name, path.stem)
    for path in sorted(conf_folder().glob("*/*.yaml"))
    if path.parent.name not in ("experiment", "debug")
]


@pytest.mark.parametrize(("entry", "material"), list(product(OF_ONE_MATERIAL, MATERIALS)))
def test_every_entry_point_composes_with_every_material(entry, material):
    assert compose_config(entry, [f"material={material}"]).material.name == material


@pytest.mark.parametrize("problem", PROBLEMS)
def test_every_benchmark_problem_composes_under_its_name(problem):
    assert compose_config("benchmark", [f"problem={problem}"]).problem["name"] == problem


@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_every_experiment_composes(experiment):
    if experiment.startswith("measured_"):
        config = compose_config("train", [f"experiment={experiment}", "data.stress=x.csv"])
        assert (config.name, config.model["name"]) == (experiment, "pcnclaws_stretches")
        return
    config = compose_config("train", [f"experiment={experiment}", "debug=fast"])
    baseline, _, material = experiment.partition("_")
    if baseline in BASELINES:
        assert (config.material.name, config.model["name"]) == (material, baseline)
        assert config.regime.name == "single_scene"
        return
    material, regime = experiment.rsplit("_", 1)
    assert config.material.name == material
    assert config.regime.name == f"{'multi' if regime == 'energy' else regime}_scene"


WEIGHTLESS = SimulationSettings(gravity=(0.0, 0.0, 0.0))


def test_an_experiment_shows_its_command():
    for experiment in EXPERIMENTS:
        text = (conf_folder() / "experiment" / f"{experiment}.yaml").read_text()
        # followed by nothing, or by what the experiment leaves to its user
        assert re.search(rf"^# python -m pcnclaws.train experiment={experiment}( .*)?$", text, re.MULTILINE), experiment


@pytest.fixture(scope="module")
def groups() -> dict[str, list[str]]:
    """The groups of each entry point."""
    register_resolvers()
    offer_choices()
    return {entry: composed_groups(entry, ())[1] for entry in ENTRIES}


@pytest.mark.parametrize(("group", "choice"), CHOICES)
def test_every_choice_of_a_group_composes_with_an_entry_point_that_has_it(group, choice, groups):
    # what is observed goes with what is estimated
    entry = "estimate" if choice == "observed" else next(entry for entry in ENTRIES if group in groups[entry])
    compose_config(entry, [f"{group}={choice}"])


@pytest.mark.parametrize("material", list(MATERIALS.values()), ids=list(MATERIALS))
def test_default_parameters_are_the_middle_of_the_training_ranges(material):
    config = compose_config("simulate", [f"material={material.name}"])
    middle = {name: (low + high) / 2 for name, (low, high) in material.ranges.items()}
    assert parameters_from(config.parameters, material) == pytest.approx(middle)


def test_default_settings_are_the_papers():
    assert settings_from(compose_config("simulate").simulation, MATERIALS["sand"]) == SimulationSettings()


@pytest.mark.parametrize("material", list(MATERIALS))
@pytest.mark.parametrize("velocity", ["[0,0,0]", "[1,-1.5,-2]", "[3,0,0]"])
def test_the_automatic_time_step_aims_at_a_cfl_number_of_0_4(material, velocity):
    start = start_from(
        compose_config("simulate", [f"material={material}", f"scene.velocity={velocity}", "simulation.time_step=auto"])
    )
    assert 0.4 * 0.99 <= stability_of(start).cfl <= 0.4


def test_the_speed_bound_is_the_start_speed_and_the_fall():
    start = start_from(compose_config("simulate", ["scene.velocity=[0,-2,0]"]))
    # from the lowest particles, half a spacing above the cube's lower face at 0.25 m, to the wall layer at 0.1 m
    expected = (2.0**2 + 2 * 9.8 * 0.175) ** 0.5
    assert largest_speed(start.position, start.velocity, SimulationSettings()) == pytest.approx(expected)
    assert largest_speed(start.position, start.velocity, WEIGHTLESS) == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("override", "line"),
    [
        ("simulation.steps=-1", "simulation.steps=-1"),
        ("simulation.steps=0", "simulation.steps=0"),
    ],
)
def test_counts_are_positive(override, line):
    with pytest.raises(UserError, match=re.escape(line)):
        whole_number(compose_config("simulate", [override]).simulation.steps, "simulation.steps")


def test_device_and_precision_are_known_names():
    config = compose_config("simulate", ["precision=float64"])
    assert precision_from(config.precision) is torch.float64
    assert device_from(config.device) == torch.device("cpu")
    with pytest.raises(UserError, match="did you mean 'cuda'"):
        device_from(compose_config("simulate", ["device=cudaa"]).device)
    with pytest.raises(UserError, match="float32, float64"):
        precision_from(compose_config("simulate", ["precision=float16"]).precision)


def test_the_readme_names_commands_that_exist():
    text = (Path(__file__).parents[2] / "README.md").read_text()
    commands = re.findall(r"python -m pcnclaws\.(\w+)([^\n#`]*)", text)
    assert commands
    for entry, arguments in commands:
        compose_config(entry, [argument for argument in shlex.split(arguments) if not argument.startswith("-")])
    makefile = "\n".join((Path(__file__).parents[2] / name).read_text() for name in MAKEFILES)
    for target in re.findall(r"`?make ([a-z-]+)`?", text):
        assert re.search(rf"^{target}:", makefile, re.MULTILINE), target
