"""Hyperparameters of TensorBoard's page HPARAMS: the options of a run beside its errors."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lightning.pytorch.loggers import TensorBoardLogger

from pcnclaws.atomic import one_line_writing


def log_hyperparameters(folder: Path, options: Mapping[str, Any], errors: Mapping[str, float | None]) -> None:
    """Writes one session of HPARAMS beside the curves of a run folder.

    options  by their dotted names; numbers, words and switches stay what they are, others become text
    errors   by name [m^2]; those that are missing or infinite are left out
    """
    plain = {
        name: value if isinstance(value, (bool, int, float, str)) else str(value) for name, value in options.items()
    }
    finite = {
        f"hparams/{name}": float(error) for name, error in errors.items() if error is not None and math.isfinite(error)
    }
    with one_line_writing(folder / "tensorboard"):
        logger = TensorBoardLogger(folder, name="tensorboard", version="", default_hp_metric=False)
        logger.log_hyperparams(plain, finite)
        # the fit that came before has written an empty one
        Path(logger.log_dir, logger.NAME_HPARAMS_FILE).unlink(missing_ok=True)
        logger.save()
        logger.finalize("success")
