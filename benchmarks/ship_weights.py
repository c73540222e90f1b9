"""Puts the laws of finished training runs into the package: python -m benchmarks.ship_weights RUN_FOLDER ...

pretrained/<material>/config.yaml          the material and the model
pretrained/<material>/weights.safetensors  the weights
pretrained/<material>/card.md              data, seed, command, errors, ranges and training time
"""

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from pcnclaws.atomic import replaced_file
from pcnclaws.commands.runs import METRICS, PRETRAINED, WEIGHTS, load_run
from pcnclaws.errors import UserError
from pcnclaws.laws.parameters import PARAMETERS
from pcnclaws.training.weights import read_weights, write_weights

CARD = "card.md"
KEPT = ("material", "model", "regime")
LARGEST_BYTES = 200_000


def ship(run: Path, into: Path = PRETRAINED) -> Path:
    """Copies what law=pretrained needs from a run folder, with a card; returns the folder.

    raises  UserError for a folder that holds no finished run, or weights larger than ship
    """
    loaded = load_run(run, "run")
    metrics_file = run / METRICS
    if not metrics_file.is_file():
        raise UserError(f"run={run}: {METRICS} is missing; accepted: a finished run")
    if (run / WEIGHTS).stat().st_size > LARGEST_BYTES:
        raise UserError(f"run={run}: {WEIGHTS} is larger than {LARGEST_BYTES} bytes, the most that ships")
    metrics = json.loads(metrics_file.read_text(encoding="utf-8"))
    weights, notes = read_weights(run / WEIGHTS)
    folder = into / loaded.material.name
    write_weights(folder / WEIGHTS, weights, notes)
    with replaced_file(folder / "config.yaml") as part:
        kept = {name: loaded.config[name] for name in KEPT if name in loaded.config}
        part.write(yaml.safe_dump(kept, sort_keys=False, encoding="utf-8"))
    with replaced_file(folder / CARD) as part:
        part.write(card(loaded.material.name, loaded.config, metrics).encode())
    return folder


def card(material: str, config: Mapping[str, Any], metrics: Mapping[str, Any]) -> str:
    """What the weights are, in Markdown, from the configuration and the results of their run."""
    training, origin, data = metrics["training"], metrics["provenance"], config["data"]
    lines = [
        f"# Neural law of {material}",
        "",
        f"- Command: `{origin['command']}`",
        f"- Data: {training['training_scenes']} training scenes of `python -m pcnclaws.generate material={material}` "
        f"(data.seed {data['seed']}), segments from "
        f"{'the initial state, positions only' if training['positions_only'] else 'recorded full states'}",
        f"- Seed {origin['seed']}, {training['iterations']} iterations, the weights of iteration "
        f"{training['best_iteration']}, best on {data['validation_scenes']} validation scenes "
        f"({training['validation_mse']:.1e} m²)",
        f"- Time: {metrics['seconds'] / 60.0:.1f} min, {origin['processor']}, {origin['threads']} thread(s), "
        f"{origin['precision']}, torch {origin['torch']}, commit {origin['commit'][:12]}",
        "- Parameters: "
        + ", ".join(
            f"{name} {low:g} to {high:g}" + ("" if PARAMETERS[name].unit == "-" else f" {PARAMETERS[name].unit}")
            for name, (low, high) in training["ranges"].items()
        ),
        "",
        "Errors on objects that it was not trained on, over 500 steps (mean squared distance a coordinate):",
        "",
        "| object | MSE [m²] | RMS [% of size] | relative stress error |",
        "|---|---|---|---|",
    ]
    for scene in metrics["scenes"]:
        stress = "-" if scene["stress_error"] is None else f"{scene['stress_error']:.1e}"
        lines.append(f"| {scene['name']} | {scene['mse']:.1e} | {scene['rms_percent']:.2g} | {stress} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """The command."""
    if not sys.argv[1:]:
        sys.exit("name at least one run folder: python -m benchmarks.ship_weights outputs/runs/sand_multi")
    for argument in sys.argv[1:]:
        try:
            print(f"wrote {ship(Path(argument))}")
        except UserError as fault:
            print(fault, file=sys.stderr)
            sys.exit(2)


if __name__ == "__main__":
    main()
