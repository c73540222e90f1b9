"""Export of a recorded motion, from its typed options to the files of another program."""

from pathlib import Path

from pcnclaws.commands.outputs import output_file
from pcnclaws.commands.recorded_motion import fields_of, recorded_scene
from pcnclaws.commands.typed_configs import ExportConfig
from pcnclaws.data.motion_files import FORMATS, write_motion
from pcnclaws.errors import UserError, unknown_name

# What the words of `format=` stand for: endings, the first one where output= has none.
ENDINGS = {
    "ply": (".ply",),
    "vtu": (".pvd", ".vtu"),
    "usd": (".usd", ".usda", ".usdc"),
    "npz": (".npz",),
    "csv": (".csv",),
}
# Formats that may hold one frame.
OF_ONE_FRAME = ("ply", "vtu")


def export(config: ExportConfig) -> None:
    """Writes a recorded motion as files of the format that `format` or the ending of `output` names."""
    chosen = _format(config)
    known = [ending for endings in ENDINGS.values() for ending in endings]
    output = output_file(str(_with_ending(config, chosen)), {"trajectory": config.trajectory}, *known)
    if config.frame is not None and chosen not in OF_ONE_FRAME:
        raise UserError(f"frame={config.frame} has no effect with format={chosen}; accepted: one without the other")
    if output.suffix == ".pvd" and config.frame is not None:
        output = output.with_suffix(".vtu")
    FORMATS[output.suffix].require()
    record = recorded_scene(config.trajectory, config.scene, "trajectory")
    frame = _frame(config)
    files = write_motion(output, fields_of(record, config.law), frame)
    frames = len(record.time) if frame is None else 1
    others = f" ... {files[-1].name}" if len(files) > 1 else ""
    print(f"wrote {files[0]}{others}: scene '{record.name}', {record.position.shape[1]} particles, frames: {frames}")


def _format(config: ExportConfig) -> str:
    """The word of `format`, or what the ending of `output` says."""
    ending = Path(str(config.output)).suffix.lower()
    said = next((word for word, endings in ENDINGS.items() if ending in endings), None)
    if config.format is None:
        if said is None:
            raise UserError(
                f"format=null and output={config.output} name no format; accepted: format={', '.join(ENDINGS)}, or "
                f"an output= that ends in {', '.join(FORMATS)}"
            )
        return said
    if config.format not in ENDINGS:
        raise unknown_name("format", config.format, ENDINGS)
    if said not in (None, config.format):
        raise UserError(
            f"output={config.output} is not of format={config.format}; accepted: a file that ends in "
            f"{' or '.join(ENDINGS[config.format])}, or no ending"
        )
    return config.format


def _frame(config: ExportConfig) -> int | None:
    if config.frame is not None and (isinstance(config.frame, bool) or not isinstance(config.frame, int)):
        raise UserError(f"frame={config.frame} is not accepted; accepted: the number of a frame, -1 for the last")
    return config.frame


def _with_ending(config: ExportConfig, chosen: str) -> Path:
    path = Path(str(config.output))
    return path if path.suffix.lower() in ENDINGS[chosen] else path.with_name(f"{path.name}{ENDINGS[chosen][0]}")
