"""How a file of motion capture is to be read, from `observation.units`, `observation.frame` and `observation.start`."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pcnclaws.commands.typed_groups import Observed
from pcnclaws.data.length_units import UNITS
from pcnclaws.data.motion_capture import Capture
from pcnclaws.errors import UserError


def capture_of(observed: Observed) -> Capture | None:
    """Units, frame and clock of a CSV or C3D file; None where nothing is said of them."""
    if observed.units is None and observed.frame is None and observed.start is None:
        return None
    start = observed.start
    if start is not None and (isinstance(start, bool) or not isinstance(start, int | float)):
        raise UserError(f"observation.start={start} is not accepted; accepted: a time [s]")
    places = None if observed.frame is None else _frame_places(observed.frame)
    return Capture(_units_word(observed.units), places, observed.frame == "fit", start)


def _frame_places(frame: Any) -> dict[str, np.ndarray] | None:
    """`observation.frame` as places by marker [m]; None for fit.

    raises  UserError for what is neither
    """
    if frame == "fit":
        return None
    known = "fit, or places of three fixed markers, [{marker: name, place: [x, y, z]}, ...]"
    if not isinstance(frame, Sequence) or isinstance(frame, str) or not frame:
        raise UserError(f"observation.frame={frame} is not accepted; accepted: {known}")
    places: dict[str, np.ndarray] = {}
    for one in frame:
        if not isinstance(one, Mapping) or set(one) != {"marker", "place"} or str(one["marker"]) in places:
            raise UserError(f"observation.frame holds {one}; accepted: {known}, each marker once")
        place = one["place"]
        numbers = isinstance(place, Sequence) and not isinstance(place, str) and len(place) == 3
        if not numbers or not all(isinstance(x, float | int) and not isinstance(x, bool) for x in place):
            raise UserError(f"observation.frame: the place {place} is not accepted; accepted: three numbers [m]")
        places[str(one["marker"])] = np.array([float(x) for x in place])
    return places


def _units_word(units: Any) -> str | None:
    """`observation.units`; UserError for an unknown one."""
    if units is None:
        return None
    if units not in UNITS:
        raise UserError(f"observation.units={units} is not accepted; accepted: {', '.join(UNITS)}")
    return str(units)
