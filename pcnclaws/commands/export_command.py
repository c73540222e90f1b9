"""Export of a recorded motion or of a law, from typed options to the files of another program."""

from pcnclaws.commands.export_format import chosen_format, with_ending
from pcnclaws.commands.law_export import export_law
from pcnclaws.commands.outputs import output_file
from pcnclaws.commands.recorded_motion import fields_of, recorded_scene
from pcnclaws.commands.typed_configs import ExportConfig
from pcnclaws.data.motion_files import FORMATS, write_motion
from pcnclaws.data.surface_files import write_surfaces
from pcnclaws.errors import UserError
from pcnclaws.geometry.reconstructed_surface import require_marching_cubes

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
    """Writes a recorded motion, or without one a law, as files of a format."""
    if config.trajectory is None and config.law is None:
        raise UserError(
            "trajectory=null and law=null name nothing to export; accepted: the path of a trajectory file, or law= the "
            "name of a material, analytic, pretrained, the path of a run folder or of a packaged law"
        )
    if config.trajectory is None:
        export_law(config)
    else:
        _export_motion(config)


def _export_motion(config: ExportConfig) -> None:
    chosen = chosen_format(config, ENDINGS)
    known = [ending for endings in ENDINGS.values() for ending in endings]
    output = output_file(str(with_ending(config, ENDINGS[chosen])), {"trajectory": config.trajectory}, *known)
    if config.frame is not None and chosen not in OF_ONE_FRAME:
        raise UserError(f"frame={config.frame} has no effect with format={chosen}; accepted: one without the other")
    if output.suffix == ".pvd" and config.frame is not None:
        output = output.with_suffix(".vtu")
    FORMATS[output.suffix].require()
    if config.surface:
        _check_surface(config, chosen)
    record = recorded_scene(config.trajectory, config.scene, "trajectory")
    frame = _frame(config)
    if config.surface:
        files = write_surfaces(output, record, frame)
    else:
        files = write_motion(output, fields_of(record, config.law or "analytic"), frame)
    frames = len(record.time) if frame is None else 1
    others = f" ... {files[-1].name}" if len(files) > 1 else ""
    what = "surface of " if config.surface else ""
    print(
        f"wrote {files[0]}{others}: {what}scene '{record.name}', {record.position.shape[1]} particles, frames: {frames}"
    )


def _check_surface(config: ExportConfig, chosen: str) -> None:
    if chosen != "ply":
        raise UserError(f"surface=true has no effect with format={chosen}; accepted: format=ply, or surface=false")
    if config.law is not None:
        raise UserError(f"law={config.law} has no effect with surface=true; accepted: one without the other")
    require_marching_cubes()


def _frame(config: ExportConfig) -> int | None:
    if config.frame is not None and (isinstance(config.frame, bool) or not isinstance(config.frame, int)):
        raise UserError(f"frame={config.frame} is not accepted; accepted: the number of a frame, -1 for the last")
    return config.frame
