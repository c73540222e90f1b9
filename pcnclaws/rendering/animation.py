"""Films of motions: GIFs and MP4s."""

import importlib
import io
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from PIL import Image, ImageDraw, ImageFont

from pcnclaws.atomic import replaced_file
from pcnclaws.errors import not_installed
from pcnclaws.rendering.colouring import Scale
from pcnclaws.rendering.labels import FONT
from pcnclaws.rendering.montage import Montage
from pcnclaws.rendering.panels import camera_for
from pcnclaws.simulation.records import SceneRecord

PANEL_WIDTH, HEADER, BAR = 220, 36, 74  # pixels
COLOURS_IN_FILE, COLOURS_OF_SCALES = 48, 256
PAUSE_AT_END = 0.8  # s
INK = (40, 40, 40)

Report = Callable[[int], None]


def animation(
    true: SceneRecord, predicted: SceneRecord | None, path: Path, seconds: float = 3.0, pictures: int = 30
) -> Path:
    """GIF of a trajectory, with the predicted one beside it when there is one.

    seconds   length of the animation, however long the motion itself takes
    pictures  frames of the animation, evenly spread over those of the record (at most all of them)
    """
    records = [true, predicted] if predicted else [true]
    montage = Montage(records, ["true", "predicted"][: len(records)], camera_for(records, PANEL_WIDTH))
    times = montage.times(pictures)
    return write_gif(montage, path, times, seconds / len(times))


def write_gif(
    montage: Montage, path: Path, times: list[float], seconds: float, report: Report = lambda _: None
) -> Path:
    """Animated GIF, which goes round for ever.

    times    of the motion that are shown [s]
    seconds  that each picture is shown
    report   hears of each picture that is done
    """
    frames = list(_pictures(montage, times, report))
    # one palette for all, from the whole range of the motion, keeps colours from flickering
    some = np.concatenate([np.asarray(frame) for frame in frames[:: max(1, len(frames) // 6)]])
    scaled = montage.colouring is not None and montage.colouring.scale is not None
    palette = Image.fromarray(some).quantize(COLOURS_OF_SCALES if scaled else COLOURS_IN_FILE)
    frames = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    duration = [round(1000 * seconds)] * len(frames)
    duration[-1] += round(1000 * PAUSE_AT_END)
    with replaced_file(path) as unfinished:
        frames[0].save(unfinished, format="GIF", save_all=True, append_images=frames[1:], duration=duration, loop=0)
    return path


def encoder() -> str:
    """The program that encodes MP4 films; UserError with the way to install it where it is missing."""
    try:
        return importlib.import_module("imageio_ffmpeg").get_ffmpeg_exe()
    except (ImportError, RuntimeError) as error:
        otherwise = "an output= that ends in .gif or .png"
        raise not_installed("an MP4 film", "imageio-ffmpeg", "video", otherwise) from error


def write_mp4(
    montage: Montage, path: Path, times: list[float], seconds: float, report: Report = lambda _: None
) -> Path:
    """MP4 film (H.264), arguments as of write_gif."""
    frames = _pictures(montage, times, report)
    first = next(frames)
    with tempfile.TemporaryDirectory() as folder:
        part = Path(folder) / "film.mp4"
        with subprocess.Popen(  # noqa: S603  # the encoder of the package
            [
                *(encoder(), "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24"),
                *("-s", f"{first.width}x{first.height}", "-r", f"{1.0 / seconds:.9g}", "-i", "-"),
                *("-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2:color=white", "-c:v", "libx264", "-preset", "veryfast"),
                *("-crf", "18", "-pix_fmt", "yuv420p", "-threads", "1", "-movflags", "+faststart", str(part)),
            ],
            stdin=subprocess.PIPE,
            stderr=subprocess.PIPE,
        ) as process:
            try:
                said = _fed(process, first, frames)
            finally:
                process.kill()
        if process.returncode or not part.is_file():
            raise RuntimeError(f"the encoder failed: {said.decode(errors='replace').strip()}")
        content = part.read_bytes()
    with replaced_file(path) as unfinished:
        unfinished.write(content)
    return path


def _fed(process: "subprocess.Popen[bytes]", first: Image.Image, others: Iterator[Image.Image]) -> bytes:
    """Gives the encoder the pictures, and returns what it complained of."""
    if process.stdin is None:
        raise ValueError("the encoder takes no pictures")
    try:
        process.stdin.write(first.tobytes())
        for frame in others:
            process.stdin.write(frame.tobytes())
    except BrokenPipeError:  # it ended before: its complaint says why
        pass
    return process.communicate()[1]


def _pictures(montage: Montage, times: list[float], report: Report) -> Iterator[Image.Image]:
    scale = None if montage.colouring is None else montage.colouring.scale
    bar = None if scale is None else _bar(scale, montage.camera.height + HEADER)
    for number, time in enumerate(times):
        yield _picture(montage, time, bar)
        report(number + 1)


def _picture(montage: Montage, time: float, bar: Image.Image | None) -> Image.Image:
    """The panels of one time side by side under a line of text, and the scale of colours."""
    panels = np.concatenate(montage.panels(time), axis=1)
    across = panels.shape[1]
    picture = Image.new("RGB", (across + (bar.width if bar else 0), panels.shape[0] + HEADER), "white")
    picture.paste(Image.fromarray(panels), (0, HEADER))
    if bar:
        picture.paste(bar, (across, 0))
    draw = ImageDraw.Draw(picture)
    font = ImageFont.truetype(FONT, 11)
    draw.text((6, 3), montage.title, INK, font)
    clock = f"{time:.3f} s"
    draw.text((across - 6 - font.getlength(clock), 3), clock, INK, font)
    if montage.legend:
        left = 6.0
        for name, colour in montage.legend:
            draw.rectangle((left, 22, left + 8, 30), tuple(round(255 * part) for part in colour))
            draw.text((left + 12, 19), name, INK, font)
            left += 28 + font.getlength(name)
    elif len(montage.records) > 1:
        for index, name in enumerate(montage.rows):
            middle = (index + 0.5) * montage.camera.width - 0.5 * font.getlength(name)
            draw.text((middle, 19), name, INK, font)
    return picture


def _bar(scale: Scale, height: int) -> Image.Image:
    """The scale of colours, BAR pixels wide."""
    dpi = 100
    figure = Figure(figsize=(BAR / dpi, height / dpi), dpi=dpi)
    axis = figure.add_axes((0.1, 0.15, 0.18, 0.7))
    bar = figure.colorbar(ScalarMappable(scale.ends, scale.colours), cax=axis, ticks=MaxNLocator(4))
    bar.set_label(scale.label, fontsize=7)
    bar.ax.tick_params(labelsize=6)
    bar.ax.yaxis.get_offset_text().set_fontsize(6)
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=dpi)
    return Image.open(content).convert("RGB")
