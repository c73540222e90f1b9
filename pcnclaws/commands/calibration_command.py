"""Calibration of a law on simulated objects whose truth is known."""

from pcnclaws.commands.configuration import use_processor, whole_number
from pcnclaws.commands.outputs import RESULT, output_file
from pcnclaws.commands.progress_bar import progress_bar
from pcnclaws.commands.runs import law_folder, laws_for
from pcnclaws.commands.typed_configs import CalibrateConfig
from pcnclaws.data.sampling import DataSetPlan, draw_motions, draw_parameters
from pcnclaws.errors import UserError
from pcnclaws.estimation.law_error import CALIBRATION, calibrated_error, is_calibrated, known_law_error
from pcnclaws.estimation.uncertainty import QUANTILE_95
from pcnclaws.evaluation.report import write_metrics
from pcnclaws.geometry.shapes import spin_velocity
from pcnclaws.guards import counts
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.materials import Material, material_named
from pcnclaws.provenance import provenance
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.scenes import SceneStart

# With it, the draws are apart from those of data sets.
STREAM = 9


def calibrate(config: CalibrateConfig) -> None:
    """Writes estimation.json beside the law's weights, or to `output`.

    Beside the error it notes how many of the numbers lie in the intervals of the calibration that was there before:
    with another seed, that is a test of it.
    """
    use_processor(config)
    material, law = material_named(config.material.name), config.law
    folder = law_folder(law, material)
    if folder is None:
        raise UserError("law=analytic has no error to calibrate; accepted: pretrained, or the path of a run folder")
    laws = laws_for(law, material)
    if config.output is None and folder.is_file():
        raise UserError(f"output=null: the packaged law {folder} stays as it is; accepted: output= a .json file")
    output = folder / CALIBRATION if config.output is None else output_file(config.output, {}, *RESULT)
    before = known_law_error(folder) if is_calibrated(folder) else None
    starts = calibration_objects(
        material, whole_number(config.objects, "objects"), whole_number(config.seed, "seed", least=0)
    )
    with progress_bar("estimating", len(starts)) as advance:
        truth = simulate_records(starts, analytic_laws(material), FramePlan(500, 5))
        values = calibrated_error(material, laws, truth, advance)
    if before is not None:
        values |= {"law_error_before": before, "covered_before": _covered(values["projected"], before)}
        print(f"{values['covered_before']:.1%} of the numbers lie in the intervals of the calibration that was there")
    write_metrics(
        output, {"material": material.name, **values, "guards": counts(), "provenance": provenance(config.seed)}
    )
    print(f"wrote {output}: the law moves markers wrongly by {values['law_error']:.2e} m")


def calibration_objects(material: Material, count: int, seed: int = 0) -> list[SceneStart]:
    """Objects of the material's ranges, away from the reference objects, thrown as those of the training data."""
    plan = DataSetPlan(material)
    position = plan.body.position
    draw = seed, STREAM
    drawn = zip(draw_parameters(material, count, draw), draw_motions(count, draw), strict=True)
    starts = []
    for number, (parameters, motion) in enumerate(drawn):
        velocity = spin_velocity(position, plan.body.velocity + motion.velocity, motion.spin.tolist())
        name = f"object-{number:02d}"
        starts.append(
            SceneStart(
                name,
                material.name,
                plan.settings,
                parameters,
                position=position,
                velocity=velocity,
                volume=plan.body.volume,
            )
        )
    return starts


def _covered(projected: list[list[float]], law_error: float) -> float:
    """The share of the numbers that lie in intervals of 95 % made with this error."""
    within = [error <= QUANTILE_95 * law_error for errors in projected for error in errors]
    return sum(within) / len(within)
