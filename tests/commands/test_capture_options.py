"""The options of motion capture: what they say, and what is refused."""

from typing import Any

import numpy as np
import pytest

from pcnclaws.commands.capture_options import capture_of
from pcnclaws.commands.typed_groups import Observed
from pcnclaws.errors import UserError

NOTHING = {"file": "a.csv", "scene": None, "units": None, "frame": None, "start": None, "window": None, "noise": None}


def said(**options: Any) -> Observed:
    return Observed(**{"kind": "markers", **NOTHING, **options})


def test_options_say_units_frame_and_start() -> None:
    assert capture_of(said()) is None
    found = capture_of(said(units="mm", frame=[{"marker": "a", "place": [0, 1, 2.5]}], start=0.7))
    assert found is not None
    assert found.places is not None
    np.testing.assert_array_equal(found.places["a"], [0.0, 1.0, 2.5])
    assert (found.units, found.on_shape, found.start) == ("mm", False, 0.7)
    fitted = capture_of(said(frame="fit"))
    assert fitted is not None
    # metres of a table, and of a C3D file what it says
    assert (fitted.units, fitted.places, fitted.on_shape) == (None, None, True)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"units": "inch"}, "observation.units=inch is not accepted; accepted: m, cm, mm, um, in, ft"),
        ({"frame": "left"}, "observation.frame=left is not accepted; accepted: fit, or"),
        ({"frame": [{"marker": "a"}]}, "observation.frame holds .* accepted: fit, or"),
        ({"frame": 2 * [{"marker": "a", "place": [0, 0, 0]}]}, "each marker once"),
        ({"frame": [{"marker": "a", "place": [0, "x", 0]}]}, "accepted: three numbers"),
        ({"start": "now"}, "observation.start=now is not accepted; accepted: a time"),
    ],
)
def test_what_is_not_accepted_is_one_line(options: dict[str, Any], message: str) -> None:
    with pytest.raises(UserError, match=message):
        capture_of(said(**options))
