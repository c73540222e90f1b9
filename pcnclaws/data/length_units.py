"""Units of length of files of others, and which of them a ratio of lengths speaks for."""

UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254, "ft": 0.3048}
# As programs spell them, in small letters; of words also without the s of several.
SPELT: dict[str, str] = dict.fromkeys(("m", "metre", "meter"), "m")
SPELT |= dict.fromkeys(("cm", "centimetre", "centimeter"), "cm")
SPELT |= dict.fromkeys(("mm", "millimetre", "millimeter"), "mm")
SPELT |= dict.fromkeys(("um", "micrometre", "micrometer", "micron"), "um")
SPELT |= dict.fromkeys(("in", "inch", "inches"), "in")
SPELT |= dict.fromkeys(("ft", "foot", "feet"), "ft")
# How far a ratio may be from that of two units.
LIKE = 1.15


def unit_named(word: str) -> str | None:
    """The unit that a word stands for, whatever its letters; None for an unknown word."""
    small = word.strip().lower()
    return SPELT.get(small) or SPELT.get(small.removesuffix("s") if len(small) > 3 else small)


def unit_of_ratio(ratio: float, units: str, among: float = LIKE) -> str | None:
    """The unit that lengths are in, where they have to be multiplied by a ratio in the unit that was said; None for it.

    among  factor by which the ratio may differ from that of the units
    """
    if 1.0 / among < ratio < among:
        return None
    wanted = UNITS[units] * ratio
    near = min(UNITS, key=lambda unit: max(wanted / UNITS[unit], UNITS[unit] / wanted))
    off = max(wanted / UNITS[near], UNITS[near] / wanted)
    return near if near != units and off < among else None
