"""The span of each physical parameter in the training data of a law, and who leaves it."""

from collections.abc import Iterable, Mapping

from pcnclaws.guards import count
from pcnclaws.laws.parameters import PARAMETERS


def outside_training_data(
    ranges: Mapping[str, tuple[float, float]], parameters: Iterable[Mapping[str, float]]
) -> str | None:
    """One line that names the parameters outside the ranges that a law was trained on; None if there are none."""
    faults: dict[str, None] = {}
    for values in parameters:
        for name, (low, high) in ranges.items():
            if name in values and not low * (1.0 - 1e-6) <= values[name] <= high * (1.0 + 1e-6):
                unit = "" if PARAMETERS[name].unit == "-" else f" {PARAMETERS[name].unit}"
                faults[f"{name}={values[name]:g} (trained on {low:g} to {high:g}{unit})"] = None
    count("parameters_outside_training_data", len(faults))
    return f"used outside its training data: {', '.join(faults)}" if faults else None
