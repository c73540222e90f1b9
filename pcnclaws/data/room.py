"""Room in memory for what a file claims to hold, looked at before any is taken."""

import resource
from pathlib import Path

from pcnclaws.errors import UserError

# What is read is converted, and there twice meanwhile.
COPIES = 2
# Below this nobody looks [bytes].
SMALL = 64 * 1024**2


def require_room(size: int, what: str) -> None:
    """Refuses an array that this machine, or this process, has no room for with a UserError.

    size  [bytes], as claimed
    what  claims it, for the message
    """
    if size <= SMALL:
        return
    free = free_bytes()
    if free is not None and COPIES * size > free:
        raise UserError(
            f"{what}: claims {size / 1024**3:.3g} GiB, too much for the memory here; accepted: at most "
            f"{free / COPIES / 1024**3:.3g} GiB"
        )


def free_bytes() -> int | None:
    """Memory that this process may still take [bytes]; None where the system does not say."""
    found = []
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        found += [int(line.split()[1]) * 1024 for line in lines if line.startswith("MemAvailable:")]
        limit, _ = resource.getrlimit(resource.RLIMIT_AS)
        if limit != resource.RLIM_INFINITY:
            pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
            found.append(max(limit - pages * resource.getpagesize(), 0))
    except (OSError, ValueError, IndexError):
        return None
    return min(found, default=None)
