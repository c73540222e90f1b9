"""Short animated GIFs of trajectories."""

from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from pcnclaws.atomic import replaced_file
from pcnclaws.rendering.camera import Camera
from pcnclaws.rendering.labels import FONT, material_label
from pcnclaws.rendering.pictures import camera_for, panel
from pcnclaws.simulation.records import SceneRecord

PANEL_WIDTH, HEADER = 220, 36  # pixels
COLOURS_IN_FILE = 48
PAUSE_AT_END = 0.8  # s
INK = (40, 40, 40)


def animation(
    true: SceneRecord, predicted: SceneRecord | None, path: Path, seconds: float = 3.0, pictures: int = 30
) -> Path:
    """GIF of a trajectory, with the predicted one beside it when there is one.

    seconds   length of the animation, however long the motion itself takes
    pictures  frames of the animation, evenly spread over those of the record (at most all of them)
    """
    records = [("true", true)] + ([("predicted", predicted)] if predicted else [])
    camera = camera_for([record for _, record in records], PANEL_WIDTH)
    count = min(pictures, len(true.time))
    frames = [_picture(records, int(frame), camera) for frame in np.rint(np.linspace(0, len(true.time) - 1, count))]
    # one palette for all, from the whole range of the motion, keeps colours from flickering
    montage = np.concatenate([np.asarray(frame) for frame in frames[:: max(1, count // 6)]])
    palette = Image.fromarray(montage).quantize(COLOURS_IN_FILE)
    frames = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    duration = [round(1000 * seconds / count)] * count
    duration[-1] += round(1000 * PAUSE_AT_END)
    with replaced_file(path) as unfinished:
        frames[0].save(unfinished, format="GIF", save_all=True, append_images=frames[1:], duration=duration, loop=0)
    return path


def _picture(records: list[tuple[str, SceneRecord]], frame: int, camera: Camera) -> Image.Image:
    """The panels of one frame side by side under a line of text."""
    panels = np.concatenate([panel(record, frame, camera) for _, record in records], axis=1)
    picture = Image.new("RGB", (panels.shape[1], panels.shape[0] + HEADER), "white")
    picture.paste(Image.fromarray(panels), (0, HEADER))
    draw = ImageDraw.Draw(picture)
    font = ImageFont.truetype(FONT, 11)
    reference = records[0][1]
    draw.text((6, 3), material_label(reference.material, reference.parameters), INK, font)
    clock = f"{reference.time[frame] - reference.time[0]:.3f} s"
    draw.text((picture.width - 6 - font.getlength(clock), 3), clock, INK, font)
    if len(records) > 1:
        for index, (name, _) in enumerate(records):
            middle = (index + 0.5) * camera.width - 0.5 * font.getlength(name)
            draw.text((middle, 19), name, INK, font)
    return picture
