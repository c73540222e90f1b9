"""Physical parameters: names, units, what values are accepted, and the moduli that follow from them."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from pcnclaws.errors import UserError, unknown_name
from pcnclaws.tensor_types import Parameters, Scalars


@dataclass(frozen=True)
class Parameter:
    """One physical parameter and the open or half-open interval of its accepted values."""

    name: str
    symbol: str
    unit: str
    lower: float
    upper: float
    lower_included: bool = False

    def accepts(self, value: float) -> bool:
        above = value >= self.lower if self.lower_included else value > self.lower
        return math.isfinite(value) and above and value < self.upper

    @property
    def accepted(self) -> str:
        """The accepted values in words."""
        lower = f"{'at least' if self.lower_included else 'above'} {self.lower:g}"
        upper = "" if math.isinf(self.upper) else f" and below {self.upper:g}"
        return f"a finite number {lower}{upper}" + (f" {self.unit}" if self.unit != "-" else "")


PARAMETERS = {
    parameter.name: parameter
    for parameter in (
        Parameter("youngs_modulus", "E", "Pa", 0.0, math.inf),
        Parameter("poissons_ratio", "nu", "-", -1.0, 0.5),
        Parameter("friction_angle", "phi", "deg", 0.0, 90.0, lower_included=True),
        Parameter("yield_stress", "tau_Y", "Pa", 0.0, math.inf, lower_included=True),
    )
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


def lame_constants(parameters: Parameters) -> tuple[Scalars, Scalars]:
    """Lame's lambda and the shear modulus mu [Pa], from youngs_modulus and poissons_ratio."""
    youngs_modulus, poissons_ratio = parameters["youngs_modulus"], parameters["poissons_ratio"]
    mu = youngs_modulus / (2.0 * (1.0 + poissons_ratio))
    return 2.0 * mu * poissons_ratio / (1.0 - 2.0 * poissons_ratio), mu


def compression_wave_speed(youngs_modulus: float, poissons_ratio: float, density: float) -> float:
    """Speed of compression waves c = sqrt((lambda + 2 mu) / rho) [m/s]."""
    p_wave_modulus = youngs_modulus * (1.0 - poissons_ratio) / ((1.0 + poissons_ratio) * (1.0 - 2.0 * poissons_ratio))
    return math.sqrt(p_wave_modulus / density)
