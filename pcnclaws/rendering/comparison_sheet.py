"""Several scenes on one sheet, each as it was and as it was predicted, side by side at three times."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, UInt8
from matplotlib.colors import LinearSegmentedColormap
from PIL import Image, ImageDraw, ImageFont

from pcnclaws.atomic import replaced_file
from pcnclaws.metrics import mse_sum, object_size, position_mse, rms_percent
from pcnclaws.rendering.camera import Camera
from pcnclaws.rendering.labels import FONT, material_colour, material_label
from pcnclaws.rendering.panels import camera_for, panel
from pcnclaws.simulation.records import SceneRecord

TIMES, WIDTH, MARGIN, PAIR_GAP = 3, 1600, 14, 20  # the lengths in pixels
TITLE, LABEL, SMALL = 24, 20, 17  # heights of letters [pixels]
INK, FAINT, RULE = (30, 30, 30), (95, 95, 95), (215, 215, 215)
# A particle as far off as the upper end of the scale, and further.
FAR = (0.42, 0.0, 0.38)
# The scale ends at the largest distance, but in these fractions of the object's size.
SCALE_WITHIN = (0.01, 0.1)
COLOURS_IN_FILE = 160


class Pair(NamedTuple):
    """A scene and its prediction: the same particles at the same frames."""

    true: SceneRecord
    predicted: SceneRecord


class _Scale(NamedTuple):
    """Colours of distances: the material's own at none, FAR at `end` [m]."""

    end: float
    colours: LinearSegmentedColormap

    def __call__(self, distance: Float[np.ndarray, " particles"]) -> Float[np.ndarray, "particles 3"]:
        return self.colours(np.clip(np.nan_to_num(distance) / self.end, 0.0, 1.0))[:, :3]


def comparison_sheet(pairs: Sequence[Pair], path: Path, title: str) -> Path:
    """One row a scene: true and predicted at three times, after a third of the motion, two thirds, and at its end.

    A predicted particle has the material's colour where it is as true, and a dark one where it is far off.
    """
    gaps = 2 * MARGIN + (TIMES - 1) * PAIR_GAP
    camera = camera_for([record for pair in pairs for record in pair], (WIDTH - gaps) // (2 * TIMES))
    scale = _scale(pairs)
    rows = [_row(pair, camera, scale) for pair in pairs]
    head, foot = _head(title), _foot(scale)
    sheet = Image.new("RGB", (WIDTH, sum(part.height for part in (head, *rows, foot))), "white")
    top = 0
    for part in (head, *rows, foot):
        sheet.paste(part, (0, top))
        top += part.height
    with replaced_file(path) as unfinished:
        small = sheet.quantize(COLOURS_IN_FILE, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
        small.save(unfinished, format="PNG", optimize=True)
    return path


def comparison_picture(pair: Pair, width: int) -> UInt8[np.ndarray, "rows columns 3"]:
    """The end of a motion, true at the left and predicted at the right; coloured as comparison_sheet.

    width  of each of the two [pixels]
    """
    camera, frame = camera_for(pair, width), len(pair.true.time) - 1
    distance = np.linalg.norm(pair.predicted.position[frame] - pair.true.position[frame], axis=1)
    true = panel(pair.true, frame, camera, oversample=1)
    predicted = panel(pair.predicted, frame, camera, _scale([pair])(distance), oversample=1)
    return np.concatenate((true, predicted), axis=1)


def _head(title: str) -> Image.Image:
    strip, draw = _strip(TITLE + 3 * MARGIN // 2)
    draw.text((MARGIN, MARGIN), title, INK, _font(TITLE))
    return strip


def _row(pair: Pair, camera: Camera, scale: _Scale) -> Image.Image:
    """The label of a scene, and below it the panels with their times."""
    caption = LABEL + MARGIN
    strip, draw = _strip(caption + SMALL + camera.height + MARGIN)
    draw.line((MARGIN, 2, WIDTH - MARGIN, 2), RULE, 1)
    draw.text((MARGIN, MARGIN // 2), _label(pair), INK, _font(LABEL))
    for number, frame in enumerate(_frames(pair.true)):
        left = MARGIN + number * (2 * camera.width + PAIR_GAP)
        distance = np.linalg.norm(pair.predicted.position[frame] - pair.true.position[frame], axis=1)
        pictures = (panel(pair.true, frame, camera), panel(pair.predicted, frame, camera, scale(distance)))
        clock = f"{pair.true.time[frame] - pair.true.time[0]:.3f} s"
        for place, (word, picture) in enumerate(zip((f"true, {clock}", "predicted"), pictures, strict=True)):
            corner = left + place * camera.width
            strip.paste(Image.fromarray(picture), (corner, caption + SMALL))
            middle = corner + 0.5 * (camera.width - _font(SMALL).getlength(word))
            draw.text((middle, caption - 3), word, FAINT, _font(SMALL))
    return strip


def _foot(scale: _Scale) -> Image.Image:
    """The scale of colours."""
    strip, draw = _strip(SMALL + 2 * MARGIN)
    words = "distance of a predicted particle from the true one: 0", f"{1e3 * scale.end:.2g} mm and more"
    left, width = MARGIN + _font(SMALL).getlength(words[0]) + 8, 220
    draw.text((MARGIN, MARGIN), words[0], FAINT, _font(SMALL))
    ramp = np.rint(255.0 * scale(np.linspace(0.0, scale.end, width))).astype(np.uint8)
    strip.paste(Image.fromarray(np.tile(ramp, (SMALL, 1, 1))), (round(left), MARGIN + 2))
    draw.text((left + width + 8, MARGIN), words[1], FAINT, _font(SMALL))
    return strip


def _label(pair: Pair) -> str:
    true = pair.true
    mse = position_mse(pair.predicted.position, true.position)
    percent = rms_percent(mse_sum(mse), true.volume)
    parameters = material_label("", true.parameters)
    return f"{true.name}:  {parameters}    MSE {mse:.1e} m²,  RMS {percent:.2g} % of size"


def _scale(pairs: Sequence[Pair]) -> _Scale:
    farthest = max(float(np.nanmax(np.linalg.norm(p.predicted.position - p.true.position, axis=2))) for p in pairs)
    least, most = (part * object_size(pairs[0].true.volume) for part in SCALE_WITHIN)
    own = material_colour(pairs[0].true.material)
    return _Scale(min(max(farthest, least), most), LinearSegmentedColormap.from_list("distance", [own, FAR]))


def _frames(record: SceneRecord) -> list[int]:
    """Evenly spread frames, the last among them; the first, which is given, is not."""
    last = len(record.time) - 1
    return [round(last * (number + 1) / TIMES) for number in range(TIMES)]


def _strip(height: int) -> tuple[Image.Image, ImageDraw.ImageDraw]:
    strip = Image.new("RGB", (WIDTH, height), "white")
    return strip, ImageDraw.Draw(strip)


def _font(size: int) -> ImageFont.FreeTypeFont:
    return ImageFont.truetype(FONT, size)
