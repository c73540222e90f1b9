"""Training segments and validation scenes as a Lightning data module."""

from collections.abc import Iterator, Sequence
from typing import Any

import torch
from lightning.pytorch import LightningDataModule
from torch.utils.data import DataLoader, Dataset, Sampler

from pcnclaws.data.dataset import SegmentDataset
from pcnclaws.data.segments import SegmentPlan
from pcnclaws.errors import UserError
from pcnclaws.simulation.records import SceneRecord


class EpochSampler(Sampler[int]):
    """Iterations of one epoch: e n, e n + 1, ..., e n + n - 1. Lightning tells it the epoch, also after a restart."""

    def __init__(self, length: int) -> None:
        self.length, self.epoch = length, 0

    def __len__(self) -> int:
        return self.length

    def __iter__(self) -> Iterator[int]:
        yield from range(self.epoch * self.length, (self.epoch + 1) * self.length)

    def set_epoch(self, epoch: int) -> None:
        self.epoch = epoch


class CheckedDataModule(LightningDataModule):
    """Batches for training; whole recorded scenes for the checks between.

    An epoch is the `check_every` iterations from one check to the next. An iteration is one step of the optimiser,
    after one batch, or after so many as Lightning accumulates gradients of.

    dataset  batch i is its item i
    """

    def __init__(
        self, dataset: Dataset[Any], iterations: int, validation: Sequence[SceneRecord], check_every: int
    ) -> None:
        super().__init__()
        if check_every < 1 or iterations % check_every:
            raise UserError(
                f"training.check_every={check_every} is not accepted; "
                f"accepted: a divisor of training.iterations={iterations}"
            )
        self.dataset, self.iterations = dataset, iterations
        self.validation = list(validation)
        self.check_every = check_every

    @property
    def epochs(self) -> int:
        """Number of checks of a run."""
        return self.iterations // self.check_every

    def train_dataloader(self) -> DataLoader[Any]:
        of_iteration = 1 if self.trainer is None else self.trainer.accumulate_grad_batches
        return DataLoader(self.dataset, batch_size=None, sampler=EpochSampler(self.check_every * of_iteration))

    def val_dataloader(self) -> DataLoader[list[SceneRecord]]:
        """One batch: the list of all validation scenes."""
        return DataLoader(_WholeScenes(self.validation), batch_size=None, collate_fn=_unchanged)

    def transfer_batch_to_device(self, batch: Any, device: torch.device, dataloader_idx: int) -> Any:
        """Batches move to the device; records stay the files' arrays."""
        return batch if isinstance(batch, list) else super().transfer_batch_to_device(batch, device, dataloader_idx)


class TrajectoryDataModule(CheckedDataModule):
    """Batches of segments of recorded scenes."""

    dataset: SegmentDataset

    def train_dataloader(self) -> DataLoader[Any]:
        """Batches, of which each of several processes has its share."""
        if self.trainer is not None:
            self.dataset.process = self.trainer.global_rank, self.trainer.world_size
            self.dataset.of_iteration = self.trainer.accumulate_grad_batches
        return super().train_dataloader()

    def __init__(
        self,
        training: Sequence[SceneRecord],
        validation: Sequence[SceneRecord],
        plan: SegmentPlan,
        check_every: int,
        dtype: torch.dtype = torch.float32,
    ) -> None:
        super().__init__(SegmentDataset(training, plan, dtype), plan.iterations, validation, check_every)


class _WholeScenes(Dataset[list[SceneRecord]]):
    """All scenes as its only item."""

    def __init__(self, records: list[SceneRecord]) -> None:
        self.records = records

    def __len__(self) -> int:
        return 1

    def __getitem__(self, index: int) -> list[SceneRecord]:
        return self.records


def _unchanged(batch: list[SceneRecord]) -> list[SceneRecord]:
    return batch
