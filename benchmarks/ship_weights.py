"""Puts the laws of finished training runs into the package: python -m benchmarks.ship_weights RUN_FOLDER ...

pretrained/<material>/config.yaml          the material and the model
pretrained/<material>/weights.safetensors  the weights
pretrained/<material>/card.md              data, seed, command, errors, ranges and training time
"""

import json
import sys
from pathlib import Path

import yaml

from pcnclaws.atomic import replaced_file
from pcnclaws.commands.law_card import CARD, card
from pcnclaws.commands.runs import METRICS, PRETRAINED, WEIGHTS, load_run
from pcnclaws.errors import UserError
from pcnclaws.training.weights import read_weights, write_weights

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
