"""Links of the page, which start from its folder."""

import os
from pathlib import Path


def picture_link(text: str, path: Path, base: Path) -> str:
    """A link to a file; with '!' in front of it, the picture itself."""
    return f"[{text}]({relative(path, base)})"


def relative(path: Path, base: Path) -> str:
    """The path as seen from the folder `base`, with '/' on every system."""
    return Path(os.path.relpath(path, base)).as_posix()
