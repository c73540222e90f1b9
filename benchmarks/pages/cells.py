"""Words, numbers and tables of the page, in Markdown."""

from collections.abc import Sequence

from benchmarks.pages.documents import Document, Row

# Rows in the order of the page, and what they are called.
ROWS = {
    "multi": "-M",
    "energy": "-M, stored energy, by Gauss-Newton",
    "single": "-S",
    "multi_positions": "-M, positions only",
    "long_positions": "-M, positions only, three times as long",
    "free_flow_positions": "the same with free flow",
    "multi_paper": "-M, the paper's networks",
    "single_paper": "-S, the paper's networks",
    "quick_paper": "-M, the paper's networks before their units, short training",
    "kalman": "-M, by a Kalman filter (`training=kalman`)",
    "short": "-M, short training (`training=short`)",
    "quick": "-M, 200 iterations without averages (`training=keyframes`)",
    "no_prior": "-M without the prior",
    "structure": "structure alone, untrained",
}


def row_name(row: str) -> str:
    """What a row is called."""
    return ROWS.get(row, row.replace("_", " "))


def words(name: str) -> str:
    """The name of a task or a material in words."""
    return {"neo_hookean": "neo-Hookean"}.get(name, name.replace("_", " "))


def title(material: str) -> str:
    """A material as a heading."""
    name = words(material)
    return name[0].upper() + name[1:]


def number(value: float | None) -> str:
    """An error, empty where there is none."""
    return "" if value is None else f"{value:.1e}"


def short(value: float | None, unit: str = "") -> str:
    """A number in two digits with its unit, empty where there is none."""
    if value is None:
        return ""
    return (f"{value:.0f}" if abs(value) >= 10.0 else f"{value:.2g}") + unit


def percent(fraction: float | None) -> str:
    """A fraction in percent, empty where there is none."""
    return "" if fraction is None else short(1e2 * fraction, " %")


def error(document: Document | None) -> str:
    """The MSE of an evaluation, in brackets the stress error, and how much diverged; empty without evaluation."""
    if document is None:
        return ""
    if document["mse"] is None:
        return "diverged"
    scenes = document.get("scenes", [])
    diverged = sum(scene.get("mse") is None for scene in scenes)
    note = f", {diverged} of {len(scenes)} diverged" if diverged else ""
    stress = document.get("stress_error")
    return number(document["mse"]) + (f" ({percent(stress)})" if stress is not None else "") + note


def minutes(row: Row) -> str:
    """Time of the training command in minutes, empty where it is not known."""
    seconds = (row.training or {}).get("seconds")
    return "" if seconds is None else f"{seconds / 60.0:.1f}"


def trained(row: Row, name: str) -> float | None:
    """A number that the training noted, such as its validation error."""
    return (row.training or {}).get("training", {}).get(name)


def table(header: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    """A table of Markdown."""
    return "\n".join(_line(cells) for cells in (header, ["---"] * len(header), *lines))


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"
