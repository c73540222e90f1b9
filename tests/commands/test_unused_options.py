"""Options without effect are refused when the user sets them, and named where a refusal would be too much."""

import re
from collections.abc import Sequence
from functools import cache
from typing import Any

import pytest
import yaml

from pcnclaws.commands.composition import compose_config
from pcnclaws.commands.options import leaves
from pcnclaws.commands.typed import plain
from pcnclaws.commands.unused_options import check_unused
from pcnclaws.errors import UserError

IDLE = [
    ("simulate", "scene.side=0.3", ["scene.particles=x.npz"]),
    ("simulate", "scene.shape=cube", ["scene.particles=x.h5"]),
    ("simulate", "scene.particles_per_edge=4", ["scene.particles=x.h5"]),
    ("simulate", "scene.shape=sphere", ["scene.mesh=x.stl"]),
    ("simulate", "scene.lattice=faces", ["scene.particles=x.npz"]),
    ("simulate", "scene.lattice=faces", ["scene.shape=torus"]),
    ("generate", "scene.centre=[0.5,0.5,0.5]", ["scene.particles=x.npz"]),
    ("generate", "scene.name=a", []),
    ("train", "data.train_scenes=4", ["data.trajectories=x.h5"]),
    ("train", "data.folder=a", ["data.trajectories=[x.h5,y.h5]"]),
    ("train", "scene.side=0.4", ["data.trajectories=x.h5"]),
    ("train", "simulation.density=900", ["data.trajectories=x.h5"]),
    ("train", "simulation=fast", ["data.trajectories=x.h5"]),
    ("train", "training.loss=absolute", ["model.name=gns"]),
    ("train", "training.segment_length.first=5", ["model.name=gns"]),
    ("train", "training.noise=1e-5", []),
    ("train", "training.plastic_learning_rate=0.1", ["material.name=elasticity"]),
    ("evaluate", "floor=true", []),
    ("estimate", "scene.side=0.4", ["observation.file=x.h5"]),
    ("estimate", "scene.side=0.4", ["observation.file=x.csv", "scene.particles=x.npz"]),
    ("estimate", "scene.spin=[0,0,1]", ["observation.file=x.csv", "scene.shape=cube"]),
    ("estimate", "observation.scene=a", ["observation.file=x.csv"]),
    ("train", "training.learning_rate=0.1", ["training.method=gauss_newton"]),
    ("train", "training.loss=robust", ["training.method=kalman"]),
    ("train", "training.learning_rate=0.1", ["training.method=levenberg_marquardt"]),
    ("train", "model.width=32", ["material.name=elasticity", "model.name=pcnclaws_energy"]),
    ("train", "data.speed=6", ["data.trajectories=x.h5"]),
    ("estimate", "estimator.learning_rate=0.2", []),
    ("estimate", "samples=500", ["uncertainty=profile"]),
    ("estimate", "initial_guess.youngs_modulus=1e5", ["fixed.youngs_modulus=2e5"]),
    ("benchmark", "seed=1", ["redraw=x.json"]),
    ("benchmark", "problem.yield_strain=[0.01]", ["problem.materials=[sand]"]),
]
NEEDED = [
    ("simulate", ["scene.particles=x.h5", "scene.name=a", "scene.velocity=[0,0,1]", "scene.spin=[0,0,1]"]),
    ("simulate", ["scene.mesh=x.stl", "scene.side=0.3", "scene.particles_per_edge=4"]),
    ("simulate", ["scene.particles=x.h5", "scene.mesh=null"]),
    ("generate", ["scene.particles=x.h5", "scene.name=a"]),
    ("train", ["data.trajectories=x.h5", "simulation.backend=torch", "simulation.skip.rest=false"]),
    ("train", ["model.name=gns", "training.noise=1e-5", "training.learning_rate=1e-3"]),
    ("train", ["material.name=elasticity", "training.plastic_learning_rate=null"]),
    ("evaluate", ["floor=false"]),
    ("evaluate", ["floor=true", "task.name=unseen"]),
    ("estimate", ["observation.file=x.h5", "scene.velocity=[0,0,1]", "scene.spin=[0,0,1]"]),
    ("estimate", ["estimator.name=adam", "estimator.learning_rate=0.2"]),
    ("estimate", ["initial_guess.youngs_modulus=1e5", "fixed.poissons_ratio=0.3"]),
]


@cache
def defaults(entry: str) -> dict[str, Any]:
    return dict(leaves(plain(compose_config(entry))))


def looked_at(entry: str, options: Sequence[str]) -> None:
    """The look at options that a command takes, without composing all of its options anew for each of them."""
    written = {name: yaml.safe_load(value) for name, _, value in (option.partition("=") for option in options)}
    check_unused(entry, written, defaults(entry) | written)


@pytest.mark.parametrize(("entry", "option", "beside"), IDLE)
def test_an_option_without_effect_is_refused(entry, option, beside):
    name = option.partition("=")[0]
    with pytest.raises(UserError, match=rf"^{re.escape(name)}=.* has no effect .*; accepted: "):
        looked_at(entry, [*beside, option])
    looked_at(entry, beside)


@pytest.mark.parametrize(("entry", "options"), NEEDED)
def test_options_with_an_effect_are_accepted(entry, options):
    looked_at(entry, options)


def test_a_preset_sets_no_option_of_the_user_and_a_mapping_sets_those_below():
    compose_config("simulate", ["scene.particles=x.h5", "simulation=balanced"])
    with pytest.raises(UserError, match="initial_guess.youngs_modulus=.* has no effect beside fixed"):
        compose_config("estimate", ["fixed.youngs_modulus=2e5", "initial_guess={youngs_modulus: 1e5}"])


@pytest.mark.parametrize(
    ("entry", "options", "line"),
    [
        ("train", ["training.iterations=0", "training.check_every=5"], "training.check_every=5 has no effect"),
        ("evaluate", ["seed=3"], "seed=3 has no effect"),
        ("estimate", ["seed=3", "screening=0"], "seed=3 has no effect with screening=0"),
        ("observe", ["seed=3"], "seed=3 has no effect"),
        ("simulate", ["simulation.steps=5", "simulation.steps=6"], "simulation.steps is given twice: 6 counts"),
    ],
)
def test_what_is_harmless_gets_a_line(entry, options, line, caplog):
    compose_config(entry, options)
    (said,) = caplog.messages
    assert line in said


@pytest.mark.parametrize("options", [["screening=8", "seed=3"], ["seed=3"]])
def test_a_seed_that_draws_gets_none(options, caplog):
    compose_config("estimate", options)
    assert not caplog.messages
