"""Model card of a trained law: what its weights are, in Markdown, from the configuration and the results of its run."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from pcnclaws.laws.parameters import PARAMETERS

CARD = "card.md"


def card(material: str, config: Mapping[str, Any], metrics: Mapping[str, Any]) -> str:
    """Data, seed, command, training time, ranges of the parameters, and errors on the test scenes.

    config   of the run
    metrics  what its metrics.json holds
    raises   LookupError, TypeError or ValueError where they do not hold what a finished training leaves
    """
    training, origin, data = metrics["training"], metrics["provenance"], config["data"]
    own = data.get("trajectories") is not None
    lines = [
        f"# Neural law of {material}",
        "",
        f"- Command: `{origin['command']}`",
        f"- Data: {training['training_scenes']} training scenes of "
        f"{'own trajectories' if own else _generated(material, data)}, segments from "
        f"{'the initial state, positions only' if training['positions_only'] else 'recorded full states'}",
        f"- Seed {origin['seed']}, {training['iterations']} iterations, the weights of iteration "
        f"{training['best_iteration']}, best on {'' if own else str(data['validation_scenes']) + ' '}validation scenes "
        f"({training['validation_mse']:.1e} m²)",
        f"- Time: {metrics['seconds'] / 60.0:.1f} min, {origin['processor']}, {origin['threads']} thread(s), "
        f"{origin['precision']}, torch {origin['torch']}, {_version(origin)}",
        f"- Parameters: {', '.join(_ranges(training['ranges']))}",
        "",
        "Errors on the test scenes (mean squared distance a coordinate):"
        if own
        else "Errors on objects that it was not trained on, over 500 steps (mean squared distance a coordinate):",
        "",
        "| object | MSE [m²] | RMS [% of size] | relative stress error |",
        "|---|---|---|---|",
    ]
    for scene in metrics["scenes"]:
        numbers = (("mse", ".1e"), ("rms_percent", ".2g"), ("stress_error", ".1e"))
        cells = ["-" if scene[name] is None else format(scene[name], form) for name, form in numbers]
        lines.append(f"| {' | '.join([scene['name'], *cells])} |")
    return "\n".join(lines) + "\n"


def _generated(material: str, data: Mapping[str, Any]) -> str:
    faster = "".join(f" data.{name}={data[name]:g}" for name in ("speed", "spin") if name in data)
    return f"`python -m pcnclaws.generate material={material}{faster}` (data.seed {data['seed']})"


def _version(origin: Mapping[str, Any]) -> str:
    """The commit that trained it, in a checkout; else the version."""
    return f"commit {origin['commit'][:12]}" if origin["commit"] else f"pcnclaws {origin['pcnclaws']}"


def _ranges(ranges: Mapping[str, Sequence[float]]) -> Iterator[str]:
    for name, (low, high) in ranges.items():
        unit = PARAMETERS[name].unit if name in PARAMETERS else "-"
        yield f"{name} {low:g} to {high:g}" + ("" if unit == "-" else f" {unit}")
