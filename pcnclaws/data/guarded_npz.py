"""Arrays of an .npz, read without running code from it and without more room than it holds."""

import math
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from pcnclaws.data.room import require_room
from pcnclaws.errors import UserError

MAXIMUM_BYTES = 4 * 1024**3


@contextmanager
def opened_arrays(path: Path) -> Iterator["np.lib.npyio.NpzFile"]:
    """The arrays by name, each read when it is asked for. Objects are refused: reading one would run code.

    raises  UserError, one line, for whatever is wrong with the file, also in the block
    """
    if not path.is_file():
        raise UserError(f"{path}: no such file")
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(member.file_size for member in archive.infolist())
            if size > MAXIMUM_BYTES:
                raise UserError(f"{path}: claims more than {MAXIMUM_BYTES / 1024**3:g} GiB of arrays")
            require_room(size, str(path))
            _check_headers(archive)
        with np.load(path, allow_pickle=False) as file:
            yield file
    except UserError:
        raise
    except Exception as error:  # zip, zlib and NumPy raise whatever a damaged file makes them meet
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise UserError(f"{path}: not an .npz file of numbers, or damaged ({reason})") from error


def _check_headers(archive: zipfile.ZipFile) -> None:
    """Raises ValueError for an array whose header claims more than its member holds: NumPy makes room for it first."""
    for member in archive.infolist():
        if not member.filename.endswith(".npy"):
            continue
        with archive.open(member) as file:
            version = np.lib.format.read_magic(file)
            read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
            shape, _, dtype = read(file)
        if math.prod(shape) * max(dtype.itemsize, 1) > member.file_size:
            raise ValueError(f"{member.filename[:60]!a} claims the shape {shape}, more than it holds")
