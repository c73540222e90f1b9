"""Which names and values the options of a configuration accept."""

import math
import re

import pytest

from pcnclaws.commands.options import check_options
from pcnclaws.errors import UserError

DEFAULTS = {
    "simulation.time_step": 5e-4,
    "simulation.steps": 500,
    "scene.velocity": [0.0, 0.0, 0.0],
    "scene.name": None,
    "picture": True,
    "output": "x.h5",
    "problem.sizes": [10, 20],
}


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("simulation.time_step", 1),
        ("simulation.time_step", "auto"),
        ("scene.velocity", [1, -1.5, 0]),
        ("scene.name", "falling"),
        ("scene.name", ["a", "b"]),
        ("picture", False),
        ("output", "a b.h5"),
        ("problem.sizes", [30]),
        ("problem.sizes", []),
    ],
)
def test_values_of_the_kind_of_the_default_are_accepted(option, value):
    check_options({**DEFAULTS, option: value}, DEFAULTS)


@pytest.mark.parametrize(
    ("option", "value", "line"),
    [
        ("simulation.steps", 1.5, "simulation.steps=1.5 is not accepted; accepted: a whole number"),
        ("simulation.steps", "abc", "simulation.steps=abc is not accepted; accepted: a whole number"),
        ("simulation.steps", True, "simulation.steps=true is not accepted; accepted: a whole number"),
        ("simulation.steps", None, "simulation.steps=null is not accepted; accepted: a whole number"),
        (
            "simulation.time_step",
            math.nan,
            "simulation.time_step=nan is not accepted; accepted: a finite number, or auto",
        ),
        ("simulation.time_step", "now", "simulation.time_step=now is not accepted; accepted: a finite number, or auto"),
        ("simulation.time_step", [1e-4], "accepted: a finite number, or auto"),
        ("scene.velocity", [0.0, 1.0], "scene.velocity=[0.0, 1.0] is not accepted; accepted: a list of 3"),
        ("scene.velocity", [0.0, 1.0, math.inf], "accepted: a list of 3, each a finite number"),
        ("scene.velocity", 3.0, "accepted: a list of 3"),
        ("scene.name", math.nan, "scene.name=nan is not accepted; accepted: finite numbers"),
        ("scene.name", {"deep": [1, math.inf]}, "accepted: finite numbers"),
        ("picture", "maybe", "picture=maybe is not accepted; accepted: true or false"),
        ("output", 5, "output=5 is not accepted; accepted: text"),
        ("problem.sizes", [1.5], "problem.sizes=[1.5] is not accepted; accepted: a list, each a whole number"),
        ("problem.sizes", 10, "problem.sizes=10 is not accepted; accepted: a list, each a whole number"),
    ],
)
def test_values_of_another_kind_are_refused(option, value, line):
    with pytest.raises(UserError, match=re.escape(line)):
        check_options({**DEFAULTS, option: value}, DEFAULTS)


@pytest.mark.parametrize(
    ("option", "line"),
    [
        ("simulation.stpes", "accepted: simulation.steps, simulation.time_step; did you mean 'simulation.steps'?"),
        ("ouput", "accepted: output, picture, problem.sizes, scene.name, scene.velocity, simulation.steps"),
        ("scene.velocity.x", "accepted: scene.name, scene.velocity"),
    ],
)
def test_unknown_options_are_refused_beside_their_siblings(option, line):
    with pytest.raises(UserError, match=re.escape(f"option='{option}' is not known; {line}")):
        check_options({**DEFAULTS, option: 1}, DEFAULTS)


def test_a_deleted_option_is_missed():
    values = {option: value for option, value in DEFAULTS.items() if option != "picture"}
    with pytest.raises(UserError, match="option 'picture' is missing; accepted: true or false"):
        check_options(values, DEFAULTS)
