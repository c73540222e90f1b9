"""Physical parameters: each is one object that says all there is to know about it.

Whoever needs a name, a bound, a unit, a word for a picture, or a way to search for a parameter reads it there.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from pcnclaws.errors import UserError, unknown_name


@dataclass(frozen=True)
class Parameter:
    """A physical parameter.

    name            the textbook's word, as in options, files and Python
    symbol          in plain letters, for names of files and scenes
    unit            '-' for none
    lower, upper    open interval of the accepted values, or closed at an end (lower_included, upper_included)
    glyph           symbol in pictures and tables, the plain one where empty
    display_unit    in pictures and tables, the unit itself where empty
    display_factor  from `unit` to `display_unit`
    logarithmic     values differ by factors, not by differences: searched, varied and drawn that way
    plausible       interval that maps of parameters and identification stay in, None for the accepted one
    search          interval that an estimation searches; a logarithmic parameter needs a positive one
    longest_step    of the search at once: of the logarithm, where logarithmic
    screening       interval of the starts of a search, None for a factor about the guess
    widest          widest interval that still says something: the ratio of its ends where logarithmic, else their
                    distance
    is_stress       whether a law divided by its moduli sees it as a strain, value / (2 mu)
    upper_included  whether `upper` itself is accepted
    """

    name: str
    symbol: str
    unit: str
    lower: float = 0.0
    upper: float = math.inf
    lower_included: bool = False
    glyph: str = ""
    display_unit: str = ""
    display_factor: float = 1.0
    logarithmic: bool = False
    plausible: tuple[float, float] | None = None
    search: tuple[float, float] | None = None
    longest_step: float = 1.0
    screening: tuple[float, float] | None = None
    widest: float = 2.0
    is_stress: bool = False
    upper_included: bool = False

    def __post_init__(self) -> None:
        if not self.lower < self.upper:
            raise UserError(f"parameter '{self.name}': lower={self.lower:g} is not below upper={self.upper:g}")
        low, high = self.searched
        if not (math.isfinite(low) and math.isfinite(high) and low < high and (low > 0.0 or not self.logarithmic)):
            raise UserError(
                f"parameter '{self.name}': search={self.search} is not accepted; accepted: two finite numbers, "
                "increasing, positive where logarithmic"
            )

    def accepts(self, value: float) -> bool:
        above = value >= self.lower if self.lower_included else value > self.lower
        below = value <= self.upper if self.upper_included else value < self.upper
        return math.isfinite(value) and above and below

    @property
    def accepted(self) -> str:
        """The accepted values in words."""
        lower = f"{'at least' if self.lower_included else 'above'} {self.lower:g}"
        below = "at most" if self.upper_included else "below"
        upper = "" if math.isinf(self.upper) else f" and {below} {self.upper:g}"
        return f"a finite number {lower}{upper}" + (f" {self.unit}" if self.unit != "-" else "")

    @property
    def searched(self) -> tuple[float, float]:
        """The interval that an estimation searches."""
        if self.search is not None:
            return self.search
        return (1e-6, 1e12) if self.logarithmic else (self.lower, min(self.upper, 1e12))

    @property
    def shown_unit(self) -> str:
        """The unit of pictures and tables, empty for none."""
        return self.display_unit or ("" if self.unit == "-" else self.unit)

    @property
    def header(self) -> str:
        """Symbol and unit in plain letters, as over a column: 'E [kPa]'; values are multiplied by display_factor."""
        unit = self.unit if self.display_factor == 1.0 else self.display_unit
        return self.symbol if unit in ("", "-") else f"{self.symbol} [{unit}]"

    @property
    def label(self) -> str:
        """Symbol and unit as in pictures and pages: 'E [kPa]'."""
        return f"{self.glyph or self.symbol} [{self.shown_unit}]" if self.shown_unit else self.glyph or self.symbol

    def shown(self, value: float) -> str:
        """A value with symbol and unit: 'E 370 kPa'."""
        unit = self.shown_unit if self.shown_unit in ("", "°") else f" {self.shown_unit}"
        return f"{self.glyph or self.symbol} {value * self.display_factor:.3g}{unit}"


YOUNGS_MODULUS = Parameter(
    "youngs_modulus", "E", "Pa", display_unit="kPa", display_factor=1e-3, logarithmic=True, search=(1e2, 1e9)
)
# Away from 0.5, where the stiffness against compression is infinite, in searches and maps.
POISSONS_RATIO = Parameter(
    "poissons_ratio",
    "nu",
    "-",
    lower=-1.0,
    upper=0.5,
    glyph="\N{GREEK SMALL LETTER NU}",
    plausible=(0.0, 0.48),
    search=(-0.4, 0.49),
    longest_step=0.1,
    screening=(0.02, 0.45),
    widest=0.3,
)
FRICTION_ANGLE = Parameter(
    "friction_angle",
    "phi",
    "deg",
    upper=90.0,
    lower_included=True,
    glyph="\N{GREEK SMALL LETTER PHI}",
    display_unit="°",
    plausible=(0.0, 85.0),
    search=(0.5, 75.0),
    longest_step=8.0,
    screening=(5.0, 50.0),
    widest=20.0,
)
YIELD_STRESS = Parameter(
    "yield_stress",
    "tau_Y",
    "Pa",
    lower_included=True,
    glyph="τ_Y",
    display_unit="kPa",
    display_factor=1e-3,
    logarithmic=True,
    search=(1.0, 1e7),
    is_stress=True,
)
# Dynamic viscosity.
VISCOSITY = Parameter(
    "viscosity", "eta", "Pa s", lower_included=True, glyph="η", logarithmic=True, search=(1e-3, 1e6), widest=2.0
)


def _share(name: str, symbol: str) -> Parameter:
    """How much of a kind is in a material that holds several, from 0 to 1."""
    return Parameter(
        name,
        symbol,
        "-",
        upper=1.0,
        lower_included=True,
        upper_included=True,
        plausible=(0.0, 1.0),
        search=(0.0, 1.0),
        screening=(0.05, 0.95),
        widest=0.5,
    )


PLASTICINE_SHARE = _share("plasticine_share", "w_plasticine")
SAND_SHARE = _share("sand_share", "w_sand")

# All that are known, by name: those of the registered materials (materials.py).
PARAMETERS: dict[str, Parameter] = {
    parameter.name: parameter
    for parameter in (YOUNGS_MODULUS, POISSONS_RATIO, FRICTION_ANGLE, YIELD_STRESS, PLASTICINE_SHARE, SAND_SHARE)
}


def validate_parameters(values: Mapping[str, float], names: Sequence[str], option: str = "parameters") -> None:
    """Refuses missing, unknown, non-numeric and unphysical parameters with a UserError that names them."""
    for name in values:
        if name not in names:
            raise unknown_name(option, name, names)
    for name in names:
        if name not in values:
            raise UserError(f"{option}.{name} is missing; accepted: {PARAMETERS[name].accepted}")
        value = values[name]
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not PARAMETERS[name].accepts(float(value)):
            raise UserError(f"{option}.{name}={value} is not accepted; accepted: {PARAMETERS[name].accepted}")


def compression_wave_speed(youngs_modulus: float, poissons_ratio: float, density: float) -> float:
    """Speed of compression waves c = sqrt((lambda + 2 mu) / rho) [m/s]."""
    p_wave_modulus = youngs_modulus * (1.0 - poissons_ratio) / ((1.0 + poissons_ratio) * (1.0 - 2.0 * poissons_ratio))
    return math.sqrt(p_wave_modulus / density)
