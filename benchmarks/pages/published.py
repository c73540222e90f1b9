"""The errors that the paper reports."""

from collections.abc import Mapping

# Our tasks that are nearest to the paper's: the training motion, twice its length, other shapes, unseen parameters (the
# mean of the paper's two objects; ours has a third one).
PAPER_TASKS: tuple[str, ...] = ("reconstruction", "long_term", "geometry", "unseen")
# Our rows beside the paper's.
PAPER_ROWS = {"multi": "the paper's -M", "single": "the paper's -S"}

_ERRORS: Mapping[str, Mapping[str, tuple[float | None, ...]]] = {
    "elasticity": {
        "spline": (2.4e-1, 2.6e-1, 3.5e-1, None),
        "gns": (2.1e-2, 3.3e-2, 1.6e-1, None),
        "nclaws": (2.4e-4, 9.8e-4, 4.1e-4, None),
        "single": (5.9e-5, 1.4e-4, 3.2e-4, None),
        "multi": (2.6e-4, 2.2e-3, 2.1e-3, 4.1e-4),
    },
    "plasticine": {
        "spline": (3.0e-1, 3.0e-1, 3.1e-1, None),
        "gns": (8.7e-3, 1.1e-2, 3.7e-2, None),
        "nclaws": (6.5e-5, 1.4e-4, 2.3e-4, None),
        "single": (8.6e-5, 2.6e-4, 4.5e-4, None),
        "multi": (4.1e-4, 5.2e-3, 4.0e-3, 3.25e-4),
    },
    "sand": {
        "spline": (3.2e-1, 3.5e-1, 3.6e-1, None),
        "gns": (1.1e-2, 1.5e-2, 3.4e-1, None),
        "nclaws": (2.6e-5, 4.2e-5, 3.6e-4, None),
        "single": (5.8e-5, 1.3e-4, 3.3e-4, None),
        "multi": (1.5e-4, 1.1e-3, 5.4e-4, 2.3e-4),
    },
}
# The paper's materials.
PAPER_MATERIALS = tuple(_ERRORS)


def paper_mse(material: str, row: str, task: str) -> float | None:
    """The paper's error [m^2] of its law -M (row multi) or -S (single) or a baseline, None where it gives none."""
    errors = _ERRORS.get(material, {}).get(row, ())
    return dict(zip(PAPER_TASKS, errors, strict=False)).get(task)
