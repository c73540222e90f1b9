"""Calibrates a law for estimation: python -m pcnclaws.calibrate material=sand law=RUN_FOLDER."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from omegaconf import DictConfig
from rich.console import Console
from rich.progress import Progress

from pcnclaws import launcher
from pcnclaws.configuration import material_from, use_processor, whole_number
from pcnclaws.data.sampling import DataSetPlan, draw_motions, draw_parameters
from pcnclaws.data.scenes import SceneStart, simulate_records
from pcnclaws.data.shapes import spin_velocity
from pcnclaws.errors import UserError
from pcnclaws.estimation.law_error import CALIBRATION, calibrated_error
from pcnclaws.evaluation.provenance import provenance
from pcnclaws.evaluation.report import write_metrics
from pcnclaws.laws.materials import Material, analytic_laws
from pcnclaws.runs import law_folder, laws_for

# Of the objects that laws are calibrated on: apart from those of data sets and of tests.
SEED = (0, 9)


def calibrate(config: DictConfig) -> None:
    """Writes estimation.json beside the law's weights, or to `output`."""
    use_processor(config)
    material, law = material_from(config), str(config.law)
    folder = law_folder(law, material)
    if folder is None:
        raise UserError("law=analytic has no error to calibrate; accepted: pretrained, or the path of a run folder")
    laws = laws_for(law, material)
    output = folder / CALIBRATION if config.output is None else Path(config.output)
    starts = calibration_objects(material, whole_number(config, "objects"))
    with _progress(len(starts)) as advance:
        truth = simulate_records(starts, analytic_laws(material), 500, 5)
        values = calibrated_error(material, laws, truth, advance)
    write_metrics(output, {"material": material.name, **values, "provenance": provenance(0)})
    print(f"wrote {output}: the law moves markers wrongly by {values['law_error']:.2e} m")


def calibration_objects(material: Material, count: int, seed: tuple[int, ...] = SEED) -> list[SceneStart]:
    """Objects of the material's ranges, away from the reference objects, thrown as those of the training data."""
    plan = DataSetPlan(material)
    position = plan.body.position
    drawn = zip(draw_parameters(material, count, seed), draw_motions(count, seed), strict=True)
    starts = []
    for number, (parameters, motion) in enumerate(drawn):
        velocity = spin_velocity(position, plan.body.velocity + motion.velocity, motion.spin.tolist())
        name = f"object-{number:02d}"
        starts.append(SceneStart(name, material.name, plan.settings, parameters, position, velocity, plan.body.volume))
    return starts


@contextmanager
def _progress(count: int) -> Iterator[Callable[[int], None]]:
    """A progress bar with the time left, on stderr, gone when done."""
    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("estimating", total=count)
        yield lambda done: progress.advance(task, done)


def main() -> None:
    """The command."""
    launcher.main(calibrate, "calibrate")


if __name__ == "__main__":
    main()
