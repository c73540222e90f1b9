"""Pictures and films of recorded motions, from typed options to the file."""

import math
from collections.abc import Sequence
from pathlib import Path

from pcnclaws.commands.configuration import whole_number
from pcnclaws.commands.outputs import output_file
from pcnclaws.commands.progress_bar import progress_bar
from pcnclaws.commands.recorded_motion import fields_of, recorded_scene
from pcnclaws.commands.typed_configs import RenderConfig
from pcnclaws.errors import UserError, unknown_name
from pcnclaws.rendering.animation import encoder, write_gif, write_mp4
from pcnclaws.rendering.colouring import Colouring
from pcnclaws.rendering.montage import Montage, motion_sheet
from pcnclaws.rendering.panels import PANEL_WIDTH, Place, camera_for
from pcnclaws.rendering.pyvista_spheres import pyvista_spheres, require_pyvista
from pcnclaws.simulation.particle_fields import ParticleFields

SHEETS, FILMS = (".png", ".pdf", ".svg"), {".gif": write_gif, ".mp4": write_mp4}
LAYOUTS, RENDERERS = ("beside", "overlaid"), {"matplotlib": None, "pyvista": pyvista_spheres}
FILM_WIDTH, SMALLEST, LARGEST, MOST_OVERSAMPLE = 560, 64, 4096, 4
MOST_MOTIONS = 6
# Whether F is read: the restart states are most of a file.
WITHOUT_STATES = ("material", "body", "speed", "volume", "density")


def render(config: RenderConfig) -> None:
    """Draws recorded motions to `output`: a sheet of their times, or a film."""
    files = _listed(config.trajectory, "trajectory", "the path of a trajectory file, or a list of up to 6")
    output = output_file(str(config.output), {"trajectory": files[0]}, *SHEETS, *FILMS)
    ending = output.suffix.lower()
    if ending not in (*SHEETS, *FILMS):
        raise UserError(f"output={output} ends in no known format; accepted: {', '.join((*SHEETS, *FILMS))}")
    is_film = ending in FILMS
    _check(config, is_film)
    if ending == ".mp4":
        encoder()
    if config.renderer == "pyvista":
        require_pyvista()
    montage = _montage(config, files, is_film)
    if not is_film:
        motion_sheet(montage, output, whole_number(config.times, "times"))
        print(f"wrote {output}: {', '.join(montage.names)}")
        return
    rate, seconds = float(config.frame_rate), config.seconds
    times = montage.times(None if seconds is None else max(1, round(rate * seconds)))
    shown = 1.0 / rate if seconds is None else float(seconds) / len(times)
    with progress_bar("drawing", len(times)) as advance:
        FILMS[ending](montage, output, times, shown, lambda _: advance(1))
    print(f"wrote {output}: {', '.join(montage.names)}, {len(times)} pictures, {len(times) * shown:.3g} s")


def _montage(config: RenderConfig, files: Sequence[str], is_film: bool) -> Montage:
    motions = _motions(config, files)
    records = [fields.record for fields in motions]
    overlaid = config.layout == "overlaid"
    ends = _range(config.colour_range)
    width = config.size or (FILM_WIDTH if is_film else PANEL_WIDTH)
    place = Place(float(config.azimuth), float(config.elevation), float(config.zoom))
    return Montage(
        records,
        _names(config, files),
        camera_for(records, width, place),
        Colouring(motions, config.colour, config.colour_map, ends, apart=overlaid),
        overlaid=overlaid,
        oversample=config.oversample or (1 if is_film else 2),
        shade=RENDERERS[config.renderer],
    )


def _motions(config: RenderConfig, files: Sequence[str]) -> list[ParticleFields]:
    scenes = [config.scene] * len(files) if not isinstance(config.scene, list) else config.scene
    if len(scenes) != len(files):
        raise UserError(f"scene={scenes} names {len(scenes)} scenes; accepted: one for each of the {len(files)} files")
    with_states = config.colour not in WITHOUT_STATES
    records = [
        recorded_scene(file, scene, "trajectory", with_states) for file, scene in zip(files, scenes, strict=True)
    ]
    return [fields_of(record, config.law) if with_states else ParticleFields(record) for record in records]


def _names(config: RenderConfig, files: Sequence[str]) -> list[str]:
    if config.names is None:
        scenes = config.scene if isinstance(config.scene, list) else [None] * len(files)
        return [Path(file).stem if scene is None else str(scene) for file, scene in zip(files, scenes, strict=True)]
    names = _listed(config.names, "names", "a list of names")
    if len(names) != len(files):
        raise UserError(f"names={names} are {len(names)}; accepted: one for each of the {len(files)} trajectories")
    return names


def _listed(value: object, option: str, accepted: str) -> list[str]:
    values = value if isinstance(value, list) else [value]
    if not 1 <= len(values) <= MOST_MOTIONS or not all(isinstance(one, str) and one for one in values):
        shown = "null" if value is None else value
        raise UserError(f"{option}={shown} is not accepted; accepted: {accepted}")
    return [str(one) for one in values]


def _check(config: RenderConfig, is_film: bool) -> None:
    """Refuses values that cannot be drawn, and options of films beside a sheet and the other way round."""
    if config.layout not in LAYOUTS:
        raise unknown_name("layout", config.layout, LAYOUTS)
    if config.renderer not in RENDERERS:
        raise unknown_name("renderer", config.renderer, RENDERERS)
    for option, value, low, high in (
        ("elevation", config.elevation, -89.0, 89.0),
        ("zoom", config.zoom, 0.1, 100.0),
        ("frame_rate", config.frame_rate, 0.1, 240.0),
        ("seconds", config.seconds, 0.01, 3600.0),
        ("size", config.size, SMALLEST, LARGEST),
        ("oversample", config.oversample, 1, MOST_OVERSAMPLE),
    ):
        whole = option in ("size", "oversample")
        if value is None:
            continue
        if isinstance(value, bool) or not isinstance(value, int if whole else (int, float)) or not low <= value <= high:
            kind = "a whole number" if whole else "a number"
            raise UserError(f"{option}={value} is not accepted; accepted: {kind} from {low:g} to {high:g}")
    if config.seconds is not None and not is_film:
        raise UserError(f"seconds={config.seconds} has no effect on a sheet; accepted: with an output= .gif or .mp4")


def _range(value: object) -> tuple[float, float] | None:
    if value is None:
        return None
    numbers = isinstance(value, list) and all(type(one) in (int, float) and math.isfinite(one) for one in value)
    if not isinstance(value, list) or not numbers or len(value) != 2 or not value[0] < value[1]:
        raise UserError(f"colour_range={value} is not accepted; accepted: two increasing numbers")
    return float(value[0]), float(value[1])
