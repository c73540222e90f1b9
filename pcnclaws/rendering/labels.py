"""Words and colours of pictures."""

from collections.abc import Mapping
from pathlib import Path

import matplotlib

# Letters of the pictures that are not drawn by matplotlib.
FONT = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"
COLOURS = {"sand": (0.90, 0.74, 0.45), "plasticine": (0.86, 0.50, 0.42), "elasticity": (0.45, 0.66, 0.88)}
OTHER_COLOUR = (0.62, 0.66, 0.70)

_SHORT = {
    "youngs_modulus": ("E", 1e-3, " kPa"),
    "poissons_ratio": ("\N{GREEK SMALL LETTER NU}", 1.0, ""),
    "friction_angle": ("\N{GREEK SMALL LETTER PHI}", 1.0, "°"),
    "yield_stress": ("yield stress", 1e-3, " kPa"),
}


def material_label(material: str, parameters: Mapping[str, float]) -> str:
    """Material and parameters in short, such as 'sand, E 370 kPa, ν 0.18, φ 30°'; parameters alone if it is empty."""
    words = [material] if material else []
    for name, value in parameters.items():
        symbol, scale, unit = _SHORT.get(name, (name, 1.0, ""))
        words.append(f"{symbol} {value * scale:.3g}{unit}")
    return ", ".join(words)


def axis_label(name: str) -> tuple[str, float]:
    """Symbol and unit of a parameter for the axis of a picture, and the factor from SI units to that one."""
    symbol, scale, unit = _SHORT.get(name, (name, 1.0, ""))
    return (f"{symbol} [{unit.strip()}]" if unit else symbol), scale
