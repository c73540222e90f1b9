"""Options without effect beside others: whoever sets one is told, before any work begins.

Only what the user wrote counts, not what a group of options or a default says; null and false ask for nothing.
"""

import logging
from collections.abc import Callable, Mapping, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, NamedTuple

from pcnclaws.errors import UserError
from pcnclaws.laws.materials import MATERIALS

log = logging.getLogger(__name__)

Options = Mapping[str, Any]

TRAJECTORY_ENDINGS = (".h5", ".hdf5")
LATTICE = ("scene.shape", "scene.centre", "scene.side", "scene.particles_per_edge", "scene.lattice")
# Options of training.* that a model of motion does not read.
OF_SEGMENTS = (
    "training.start",
    "training.segment_length.*",
    "training.loss",
    "training.loss_every",
    "training.loss_scale",
    "training.plastic_learning_rate",
    "training.step_back",
)
# Further options of a fit.
OF_ADAM = (
    *("training.loss", "training.loss_scale", "training.learning_rate", "training.plastic_learning_rate"),
    "training.gradient_clip",
)
OF_FITTING = (
    "training.batch_segments",
    "training.learning_rate",
    "training.gradient_clip",
    "training.check_every",
    "training.seconds",
    "training.noise",
    "logger.every",
    "trainer.*",
    "callbacks.*",
)
OF_GENERATED_DATA = (
    "scene.*",
    "simulation",  # a preset
    *(
        f"simulation.{name}"
        for name in (
            *("time_step", "steps", "every", "grid_spacing", "grid_nodes", "wall_distance", "gravity", "boundary"),
            *("density", "domain", "friction", "transfer"),
        )
    ),
    "data.folder",
    "data.train_scenes",
    "data.validation_scenes",
    "data.every",
    "data.keyframe_every",
    "data.seed",
    "data.speed",
    "data.spin",
)

# What a training on measured stress does not read.
OF_MOTION = (
    "data.trajectories",
    "regime",
    "training",
    "training.*",
    "device",
    "precision",
    *OF_FITTING,
    *OF_GENERATED_DATA,
)


class Rule(NamedTuple):
    """Options without effect under a condition.

    options  their names, with * for any text
    reason   the condition in words, behind 'has no effect'
    holds    whether it holds, of the values of all options by name
    refused  an error; otherwise one line says so: for options that are harmless, or that sweeps use as a name
    """

    options: Sequence[str]
    reason: str
    holds: Callable[[Options], bool]
    refused: bool = True


def check_unused(entry: str, written: Options, options: Options) -> None:
    """Refuses options that the user wrote though they have no effect with a UserError that names the first one.

    written  values by name of the options on the command line; the choice of a group is one of them
    options  the values of all options by name
    """
    for rule in (*RULES.get(entry, ()), *_beside_fixed(options)):
        idle = [name for name, value in written.items() if value is not None and value is not False]
        idle = [name for name in idle if any(fnmatchcase(name, pattern) for pattern in rule.options)]
        if not idle or not rule.holds(options):
            continue
        if rule.refused:
            raise UserError(
                f"{idle[0]}={written[idle[0]]} has no effect {rule.reason}; accepted: one without the other"
            )
        log.warning("%s has no effect %s", ", ".join(f"{name}={written[name]}" for name in idle), rule.reason)


def _given(name: str) -> Callable[[Options], bool]:
    return lambda options: options.get(name) is not None


def _is(name: str, *values: object) -> Callable[[Options], bool]:
    return lambda options: options.get(name) in values


def _other_file(name: str, *endings: str) -> Callable[[Options], bool]:
    """Whether an option names no file, or one with another ending."""
    return lambda options: not str(options.get(name)).lower().endswith(endings)


def _elastic(options: Options) -> bool:
    material = MATERIALS.get(str(options.get("material.name")))
    return material is not None and material.plastic is None


def _beside_fixed(options: Options) -> list[Rule]:
    """No parameter is guessed that is known."""
    names = [option.removeprefix("fixed.") for option in options if option.startswith("fixed.")]
    return [Rule((f"initial_guess.{name}",), f"beside fixed.{name}", _given(f"fixed.{name}")) for name in names]


def _of_cells(options: Options) -> bool:
    from pcnclaws.geometry.implicit_shapes import BODIES  # loads NumPy

    return options.get("scene.mesh") is None and options.get("scene.shape") in BODIES


def _without_body(options: Options) -> bool:
    """Whether the body of the observed trajectory file is taken."""
    no_body = all(options.get(f"scene.{name}") is None for name in ("shape", "mesh", "particles"))
    return no_body and not _is_table(options)


def _draws_nothing(options: Options) -> bool:
    return _is("screening", 0)(options) and not _is("uncertainty", "sample")(options)


def _is_table(options: Options) -> bool:
    return Path(str(options.get("observation.file"))).suffix.lower() == ".csv" or _is_cloud(options)


def _is_cloud(options: Options) -> bool:
    return options.get("observation.kind") == "points"


def _is_record(options: Options) -> bool:
    return options.get("observation.file") is not None and not _is_table(options)


def _nothing_drawn(options: Options) -> bool:
    return (
        options["kind"] == "markers"
        and options["markers"] == 1.0
        and options["noise"] == 0.0
        and options["missing"] == 0.0
    )


_BODY = (
    Rule(("simulation.grid_spacing",), "beside simulation.grid_nodes", _given("simulation.grid_nodes")),
    Rule(
        ("simulation.wall_distance", "simulation.boundary", "simulation.friction"),
        "without a domain, which has no walls",
        lambda options: "simulation.steps" in options and options.get("simulation.domain") is None,
    ),
    Rule(LATTICE, "beside scene.particles", _given("scene.particles")),
    Rule(("scene.shape",), "beside scene.mesh", _given("scene.mesh")),
    Rule(("scene.lattice",), "on a shape that is the centres of cells anyway", _of_cells),
)
_SCENE_OF_FILE = Rule(
    ("scene.name",),
    "without scene.particles=FILE.h5, of which it names a scene",
    _other_file("scene.particles", *TRAJECTORY_ENDINGS),
)

_GOING_ON = (
    Rule(
        ("scene.frame",),
        "without scene.particles=FILE.h5, of which it names a frame",
        _other_file("scene.particles", *TRAJECTORY_ENDINGS),
    ),
    Rule(
        ("scene.velocity", "scene.spin", "scene.affine"),
        "beside scene.frame, whose restart state moves by itself",
        _given("scene.frame"),
    ),
)

RULES: Mapping[str, Sequence[Rule]] = {
    "simulate": (*_BODY, *_GOING_ON),
    "generate": (*_BODY, _SCENE_OF_FILE),
    "train": (
        Rule(OF_MOTION, "beside data.stress, which has no motion", _given("data.stress")),
        Rule(("stress.*",), "without data.stress", _is("data.stress", None)),
        Rule(OF_GENERATED_DATA, "beside data.trajectories", _given("data.trajectories")),
        *_BODY,
        _SCENE_OF_FILE,
        Rule(OF_SEGMENTS, "on model=gns, which learns single steps", _is("model.name", "gns")),
        Rule(
            ("training.noise",),
            "without model=gns",
            lambda options: options.get("model.name") != "gns",
        ),
        Rule(("training.plastic_learning_rate",), "on a material without plasticity", _elastic),
        Rule(
            ("model.width",),
            "on the stored energy of an elastic material, which has no network",
            lambda options: _elastic(options) and options.get("model.name") == "pcnclaws_energy",
        ),
        *(
            Rule(
                OF_ADAM,
                f"with training.method={method}, which has no learning rate and the loss 'relative'",
                _is("training.method", method),
            )
            for method in ("gauss_newton", "kalman", "levenberg_marquardt")
        ),
        Rule(
            (*OF_FITTING, *OF_SEGMENTS),
            "with training.iterations=0",
            _is("training.iterations", 0),
            refused=False,
        ),
    ),
    "evaluate": (
        Rule(("floor",), "with task=file, whose truth is not known to be analytic", _is("task.name", "file")),
        Rule(("seed",), "on an evaluation, which draws nothing: it is noted in the result", lambda _: True, False),
    ),
    "estimate": (
        *_BODY,
        Rule(
            (*LATTICE, "scene.name"),
            "without scene.shape, scene.mesh or scene.particles",
            _without_body,
        ),
        _SCENE_OF_FILE,
        Rule(("scene.spin",), "without scene.velocity", _is("scene.velocity", None)),
        Rule(("observation.scene",), "on a file of markers or points, which holds one scene", _is_table),
        Rule(("observation.frame",), "for points, which have no labels", _is_cloud),
        Rule(("unknown.surface_offset",), "without observation.kind=points", lambda options: not _is_cloud(options)),
        Rule(
            tuple(f"observation.{name}" for name in ("units", "frame", "start")),
            "on a trajectory file, which is in metres and seconds of a simulation",
            _is_record,
        ),
        Rule(("estimator.learning_rate",), "with estimator=gauss_newton", _is("estimator.name", "gauss_newton")),
        Rule(("samples",), "without uncertainty=sample", _is("uncertainty", "linear", "profile")),
        Rule(("seed",), "with screening=0, which draws nothing", _draws_nothing, False),
    ),
    "export": (
        Rule(("scene", "frame", "surface"), "without trajectory, of which it is a part", _is("trajectory", None)),
        Rule(("material",), "beside trajectory, whose file names it", _given("trajectory")),
    ),
    "observe": (
        Rule(("seed",), "where every particle is seen, without noise or gaps", _nothing_drawn, False),
        Rule(("markers", "surface"), "with kind=points, which are on the surface", _is("kind", "points")),
        Rule(("points", "camera"), "with kind=markers, which are seen from all sides", _is("kind", "markers")),
    ),
    "benchmark": (
        Rule(("problem.*", "seed", "device", "threads"), "beside redraw", _given("redraw")),
        Rule(
            ("problem.law",),
            "without neural in problem.laws",
            lambda options: "neural" not in options.get("problem.laws", ["neural"]),
        ),
        *(
            Rule(
                (f"problem.{name}",),
                f"without {material} in problem.materials",
                lambda options, material=material: material not in options.get("problem.materials", [material]),
            )
            for name, material in (("yield_strain", "plasticine"), ("friction_angle", "sand"))
        ),
    ),
}
