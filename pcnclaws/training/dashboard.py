"""What TensorBoard shows beside the curves: the time of an iteration, histograms, pictures and point clouds."""

import time
from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from typing import Any, cast

import numpy as np
import torch
from jaxtyping import Float
from lightning.pytorch import LightningModule, Trainer
from lightning.pytorch.callbacks import Callback
from lightning.pytorch.loggers import TensorBoardLogger
from torch import Tensor

from pcnclaws.data.dataset import SegmentBatch
from pcnclaws.rendering.comparison_sheet import Pair, comparison_picture
from pcnclaws.training.watched import WatchedModule

# Validation scenes that are drawn, and the width of each half of a picture [pixels].
MOST_SCENES, WIDTH = 4, 320
# Particles of a point cloud; of larger bodies some are left out.
MOST_POINTS = 5_000
# Colours of a point cloud: predicted particles, true ones, and the corners about them.
PREDICTED, TRUE, CORNER = (214, 96, 40), (150, 150, 150), (225, 225, 225)
# TensorBoard's camera is so near that it sees the middle of a cloud alone, unless corners this much further out belong
# to it.
FURTHER = 2.2
VIEW = {"camera": {"cls": "PerspectiveCamera", "fov": 75}, "material": {"cls": "PointsMaterial", "size": 0.01}}


class Dashboard(Callback):
    """Writes to TensorBoard at every check; with another logger, or none, only the time of an iteration is kept.

    histograms   weights/NAME, and features/LAW/NUMBER: what the networks of the last batch's laws were given
    images       motion/SCENE: the end of a validation scene, true at the left and predicted at the right
    meshes       points/SCENE: the same as points that can be turned, true ones grey
    pictures     whether images and meshes are written
    """

    def __init__(self, pictures: bool = True) -> None:
        self.pictures = pictures
        self._began = 0.0
        self._batch: Any = None

    def on_train_batch_start(self, trainer: Trainer, pl_module: LightningModule, batch: Any, batch_idx: int) -> None:
        self._began = time.perf_counter()

    def on_train_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        self._batch = batch
        pl_module.log("iteration_seconds", time.perf_counter() - self._began, batch_size=1)

    def on_validation_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        if not (trainer.is_global_zero and isinstance(trainer.logger, TensorBoardLogger)):
            return
        writer, step, module = trainer.logger.experiment, trainer.global_step, cast(WatchedModule, pl_module)
        for name, weight in module.model.named_parameters():
            if bool(torch.isfinite(weight).all()):
                writer.add_histogram(f"weights/{name}", weight.detach().cpu(), step)
        if isinstance(self._batch, SegmentBatch):
            for name, feature in _features(module, self._batch):
                writer.add_histogram(f"features/{name}", feature, step)
        if self.pictures:
            self._draw(writer, step, module)

    def _draw(self, writer: Any, step: int, module: WatchedModule) -> None:
        for true, position in list(zip(module.check.true, module.check.predicted, strict=False))[:MOST_SCENES]:
            if not np.isfinite(position).all():
                continue
            picture = comparison_picture(Pair(true, replace(true, position=position)), WIDTH)
            writer.add_image(f"motion/{true.name}", picture, step, dataformats="HWC")
            points, colours = _cloud(true.position[-1], position[-1])
            writer.add_mesh(f"points/{true.name}", points, colours, config_dict=VIEW, global_step=step)


def _features(module: WatchedModule, batch: SegmentBatch) -> Iterator[tuple[str, Tensor]]:
    """What the networks of isotropic laws are given where the segments of a batch begin, by law and number."""
    stretches = torch.linalg.svdvals(batch.start.state.deformation.detach().permute(2, 0, 1).double().cpu())
    hencky = list(stretches.log().unbind(1))
    for name, law in module.networks.items():
        features = getattr(law, "features", None)
        for number, feature in enumerate(features(hencky) if features else ()):
            yield f"{name}/{number}", feature


def _cloud(
    true: Float[np.ndarray, "particles 3"], predicted: Float[np.ndarray, "particles 3"]
) -> tuple[Tensor, Tensor]:
    """Points of both, (1, points, 3), and their colours, uint8; particles that were not observed are left out."""
    every = max(1, -(-len(true) // MOST_POINTS))
    seen = true[::every][np.isfinite(true[::every]).all(1)]
    both = np.concatenate((seen, predicted[::every])).astype(np.float32)
    low, high = both.min(0), both.max(0)
    corners = 0.5 * (low + high) + 0.5 * FURTHER * np.ptp(both, axis=0).max() * np.array(
        list(product((-1, 1), repeat=3))
    )
    points = torch.from_numpy(np.concatenate((both, corners)).astype(np.float32))
    colours = [TRUE] * len(seen) + [PREDICTED] * (len(both) - len(seen)) + [CORNER] * len(corners)
    return points[None], torch.tensor(colours, dtype=torch.uint8)[None]
