"""Words and colours of pictures."""

from collections.abc import Mapping
from pathlib import Path

import matplotlib

from pcnclaws.laws.materials import MATERIALS, OTHER_COLOUR
from pcnclaws.laws.parameters import PARAMETERS

# Letters of the pictures that are not drawn by matplotlib.
FONT = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"


def material_colour(material: str) -> tuple[float, float, float]:
    """The colour of the particles of a material, RGB; that of others for one that is not known."""
    return MATERIALS[material].colour if material in MATERIALS else OTHER_COLOUR


def material_label(material: str, parameters: Mapping[str, float]) -> str:
    """Material and parameters in short, such as 'sand, E 370 kPa, ν 0.18, φ 30°'; parameters alone if it is empty."""
    words = [material] if material else []
    for name, value in parameters.items():
        words.append(PARAMETERS[name].shown(value) if name in PARAMETERS else f"{name} {value:.3g}")
    return ", ".join(words)


def axis_label(name: str) -> tuple[str, float]:
    """Symbol and unit of a parameter for the axis of a picture, and the factor from SI units to that one."""
    if name not in PARAMETERS:
        return name, 1.0
    return PARAMETERS[name].label, PARAMETERS[name].display_factor
