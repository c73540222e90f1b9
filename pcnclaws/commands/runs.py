"""Run folders: started, continued, finished, and read back as models. Reading one never runs code from its files."""

import json
import logging
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from difflib import get_close_matches
from pathlib import Path
from typing import Any, NamedTuple

import yaml

import pcnclaws
from pcnclaws.atomic import PARTIAL_SUFFIX, replaced_file
from pcnclaws.commands.models import build_model
from pcnclaws.commands.options import is_free
from pcnclaws.commands.plain_yaml import read_plain_yaml
from pcnclaws.data.law_packages import law_files, written_by
from pcnclaws.data.locks import LOCK
from pcnclaws.errors import UserError
from pcnclaws.laws.analytic import Laws, analytic_laws
from pcnclaws.laws.materials import Material, material_named
from pcnclaws.laws.training_ranges import outside_training_data
from pcnclaws.simulation.law_simulator import LawSimulator
from pcnclaws.simulation.motion import SceneSimulator
from pcnclaws.training.weights import read_weights, set_model_weights

log = logging.getLogger(__name__)

CONFIG, WEIGHTS, METRICS, CHECKPOINTS, EVENTS = (
    "config.yaml",
    "weights.safetensors",
    "metrics.json",
    "checkpoints",
    ("tensorboard", "csv", "wandb"),
)
ITERATIONS = "training.iterations"
PRETRAINED = Path(pcnclaws.__file__).parent / "pretrained"


class LoadedRun(NamedTuple):
    """A finished training run. ranges: the span of each physical parameter in its training data."""

    material: Material
    model: SceneSimulator
    config: dict[str, Any]
    ranges: Mapping[str, tuple[float, float]]

    @property
    def laws(self) -> Laws:
        """The model, which is one of laws; UserError for a model of motion."""
        return as_laws(self.model, "the run")


def load_run(folder: str | Path, option: str = "law") -> LoadedRun:
    """The model of a run folder or of a packaged law, ready to simulate.

    raises  UserError if a file is missing, damaged or unfit
    """
    path = Path(folder)
    if not path.exists():
        close = get_close_matches(str(path), ("analytic", "pretrained"), n=1)
        hint = f"; did you mean '{close[0]}'?" if close else ""
        raise UserError(
            f"{option}={path} is not a folder; accepted: analytic, pretrained, or the path of a run folder or of a "
            f"packaged law{hint}"
        )
    with law_files(path) as files:
        try:
            return _load(files, option)
        except UserError as fault:
            raise UserError(f"{fault}{written_by(files)}") from fault


def _load(folder: Path, option: str) -> LoadedRun:
    """The model of a folder with the files of a run."""
    config = read_config(folder)
    if not isinstance(config.get("material"), dict) or not isinstance(config.get("model"), dict):
        raise UserError(f"{option}={folder}: {CONFIG} names no material or no model")
    with _naming_plugins(config):
        material = material_named(str(config["material"].get("name")), f"{option}={folder}: material")
        model = _model_of(material, config, f"{option}={folder / CONFIG}")
    weights, notes = read_weights(folder / WEIGHTS)
    set_model_weights(model, weights, f"{option}={folder}")
    if notes.get("unfinished"):
        log.warning(
            "%s=%s: the run is not finished; its weights are those of iteration %s, the best of its checks so far",
            option,
            folder,
            notes.get("best_iteration"),
        )
    return LoadedRun(material, model.requires_grad_(False), config, _ranges(notes, material))


def _model_of(material: Material, config: Mapping[str, Any], where: str) -> SceneSimulator:
    try:
        return build_model(material, config["model"])
    except UserError as fault:
        raise UserError(f"{where}: {fault}") from fault


@contextmanager
def _naming_plugins(config: Mapping[str, Any]) -> Iterator[None]:
    """What a plugin registers is known only where the user names the plugin: a run that needs one says which."""
    try:
        yield
    except UserError as fault:
        plugins = config.get("plugins")
        if not isinstance(plugins, list) or not plugins:
            raise
        modules = ",".join(str(module)[:60] for module in plugins[:8])
        raise UserError(
            f"{fault}; the run was made with plugins=[{modules}], which this command was not given"
        ) from fault


def laws_for(law: str, material: Material, parameters: Iterable[Mapping[str, float]] = ()) -> Laws:
    """As model_for, where laws are needed: UserError for a model of motion."""
    return as_laws(model_for(law, material, parameters), f"law={law}")


def as_laws(model: SceneSimulator, source: str) -> Laws:
    """The laws that a model simulates with; UserError naming `source` for a model without any."""
    laws = model.laws
    if laws is None:
        raise UserError(f"{source} is a model of motion without laws, which evaluate takes; accepted here: laws")
    return laws


def model_for(law: str, material: Material, parameters: Iterable[Mapping[str, float]] = ()) -> SceneSimulator:
    """The model that the option `law` names: analytic, pretrained, or a run folder of that material.

    parameters  the physical parameters they will be used with: one line warns of those outside the training data
    """
    folder = law_folder(law, material)
    if folder is None:
        return LawSimulator(analytic_laws(material))
    run = load_run(folder)
    if run.material.name != material.name:
        raise UserError(f"law={law} was trained for material={run.material.name}, not {material.name}")
    warning = outside_training_data(run.ranges, parameters)
    if warning:
        log.warning("law=%s: %s", law, warning)
    return run.model


def law_folder(law: str, material: Material) -> Path | None:
    """The folder of the option `law`, None for analytic; UserError where no weights ship for the material."""
    if law == "analytic":
        return None
    return shipped_folder(material) if law == "pretrained" else Path(law)


def shipped_folder(material: Material) -> Path:
    """The run folder that ships for a material; UserError where none does."""
    folder = PRETRAINED / material.name
    if not folder.is_dir():
        raise UserError(
            f"law=pretrained: no weights ship for {material.name}; train some with "
            f"'python -m pcnclaws.train material={material.name}' and name its run folder"
        )
    return folder


def is_finished(folder: Path, config: Mapping[str, Any]) -> bool:
    """Whether the folder holds the finished run of this configuration; False for a new folder or an unfinished run.

    A run that is asked for more iterations than it had is not finished.

    raises  UserError if the folder holds something else, or a run whose configuration differs
    """
    if folder.exists() and not folder.is_dir():
        raise UserError(f"output={folder} is a file; accepted: a new folder or a run folder")
    if not (folder / CONFIG).is_file():
        if folder.is_dir() and any(_is_foreign(entry) for entry in folder.iterdir()):
            raise UserError(f"output={folder} is not empty and holds no run; accepted: a new folder or a run folder")
        return False
    if not any((folder / name).exists() for name in (CHECKPOINTS, WEIGHTS)):
        return False
    there = read_config(folder)
    difference = _difference(there, config)
    if difference:
        raise UserError(
            f"output={folder} holds a run of another configuration ({difference}); "
            "accepted: the same configuration, another output, or overwrite=true"
        )
    return not _asks_for_more(there, config) and (folder / METRICS).is_file() and (folder / WEIGHTS).is_file()


def goes_on(folder: Path, config: Mapping[str, Any]) -> bool:
    """Whether the folder holds a run that is asked for more iterations than it was."""
    return (folder / CONFIG).is_file() and _asks_for_more(read_config(folder), config)


def run_errors(folder: Path) -> dict[str, float | None]:
    """The errors of a finished run [m^2]: of the validation that chose its weights, and on the test scenes."""
    try:
        metrics = json.loads((folder / METRICS).read_text(encoding="utf-8"))
        errors = {"validation_mse": metrics["training"]["validation_mse"], "test_mse": metrics["mse"]}
        return {name: error if error is None else float(error) for name, error in errors.items()}
    except (OSError, ValueError, LookupError, TypeError, OverflowError, RecursionError) as fault:
        raise UserError(
            f"{folder / METRICS} is damaged or was not written by pcnclaws ({type(fault).__name__}); accepted: that of "
            "a finished run, or overwrite=true"
        ) from fault


def start_run(folder: Path, config: Mapping[str, Any], overwrite: bool = False) -> None:
    """Claims a run folder for this configuration. overwrite removes what another run left in it."""
    if overwrite and (folder / CONFIG).is_file():
        _clear(folder)
    with replaced_file(folder / CONFIG) as part:
        part.write(yaml.safe_dump(dict(config), sort_keys=False, encoding="utf-8"))


def read_config(folder: Path) -> dict[str, Any]:
    """The configuration of a run folder, plain values only."""
    if not (folder / CONFIG).exists():
        raise UserError(f"{folder} is no run folder: {CONFIG} is missing")
    config = read_plain_yaml(folder / CONFIG)
    if not isinstance(config, dict):
        raise UserError(f"{folder / CONFIG} is not the configuration of a run")
    return config


def _is_foreign(entry: Path) -> bool:
    """Whether an entry of a folder keeps a run from starting there: not a lock, a leftover, or the job of a sweep."""
    return entry.name != LOCK and entry.suffix != PARTIAL_SUFFIX and not (entry / CONFIG).is_file()


def _clear(folder: Path) -> None:
    """Removes what a run leaves in its folder, and nothing else."""
    for name in (CHECKPOINTS, *EVENTS):
        shutil.rmtree(folder / name, ignore_errors=True)
    for entry in folder.iterdir():
        if entry.is_file() and entry.suffix in (".png", ".gif", PARTIAL_SUFFIX, ".safetensors", ".json", ".yaml"):
            entry.unlink()


def _ranges(notes: Mapping[str, Any], material: Material) -> dict[str, tuple[float, float]]:
    """The ranges noted beside the weights; the material's own where the note is missing."""
    noted = notes.get("ranges")
    noted = noted if isinstance(noted, dict) else {}
    return {name: _span(noted[name], name) if name in noted else span for name, span in material.ranges.items()}


def _span(noted: Any, name: str) -> tuple[float, float]:
    try:
        low, high = (float(end) for end in noted)
    except (ValueError, TypeError, OverflowError) as fault:
        raise UserError(f"the note of the range of {name} beside the weights is not two numbers") from fault
    return low, high


def _difference(old: Mapping[str, Any], new: Mapping[str, Any]) -> str:
    """The first option that differs, in words; empty if none does."""
    before, after = _flat(old), _flat(new)
    more = _asks_for_more(old, new)
    for option in sorted(before.keys() | after.keys()):
        if not is_free(option) and not (more and option == ITERATIONS) and before.get(option) != after.get(option):
            return f"{option}: {before.get(option)} there, {after.get(option)} asked for"
    return ""


def _asks_for_more(old: Mapping[str, Any], new: Mapping[str, Any]) -> bool:
    before, after = (_flat(config).get(ITERATIONS) for config in (old, new))
    return isinstance(before, int) and isinstance(after, int) and 0 < before < after


def _flat(config: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested options as 'group.option': value."""
    flat: dict[str, Any] = {}
    for name, value in config.items():
        if isinstance(value, Mapping):
            flat |= _flat(value, f"{prefix}{name}.")
        else:
            flat[f"{prefix}{name}"] = value
    return flat
