"""Packaged laws: one .zip with the weights of a law, its card, and what it needs; read without running code from it.

law.json             format, version, versions of programs, material, plugins, ranges of the parameters
config.yaml          the material and the model, as in a run folder
weights.safetensors  the weights, as in a run folder
card.md              data, errors, ranges and training, for people
metrics.json         errors and training, where the run left them
estimation.json      the error of the law that estimates need, where it was calibrated
"""

import json
import platform
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import torch

from pcnclaws.atomic import replaced_file
from pcnclaws.errors import UserError
from pcnclaws.version import __version__

ENDING = ".zip"
FORMAT, VERSION = "pcnclaws law", 1
ABOUT = "law.json"
# Members that are read, with the most bytes of each.
TEXT, WEIGHTS = 2**20, 2**26
MEMBERS = {
    ABOUT: TEXT,
    "config.yaml": TEXT,
    "weights.safetensors": WEIGHTS,
    "card.md": TEXT,
    "metrics.json": TEXT,
    "estimation.json": TEXT,
}
NEEDED = (ABOUT, "config.yaml", "weights.safetensors")
MOST_BYTES, MOST_MEMBERS = WEIGHTS + 2**23, 64
# The end of the list of members: 22 bytes where nobody comments, and before it nothing for files beyond 4 GiB.
END, END_LENGTH, LARGE_END, LARGE_END_LENGTH = b"PK\x05\x06", 22, b"PK\x06\x07", 20
NOT_ONE = "is no packaged law"
ACCEPTED = "what python -m pcnclaws.export law=... output=law.zip has written"


def write_law_package(path: Path, about: Mapping[str, Any], members: Mapping[str, bytes]) -> None:
    """Writes a packaged law, whole or not at all; the same law gives the same bytes.

    about    plain values of law.json beside format and versions
    members  the other files by name
    raises   UserError for members that would not be read again
    """
    said = {"format": FORMAT, "version": VERSION, "versions": versions(), **about}
    files = {ABOUT: f"{json.dumps(said, indent=2)}\n".encode(), **members}
    for name, content in files.items():
        if len(content) > MEMBERS[name]:
            raise UserError(f"{name} has {len(content)} bytes; accepted in a packaged law: at most {MEMBERS[name]}")
    with replaced_file(path) as part, zipfile.ZipFile(part, "w") as archive:
        for name, content in files.items():
            archive.writestr(zipfile.ZipInfo(name), content, zipfile.ZIP_DEFLATED)


def versions() -> dict[str, str]:
    """Of what writes a package."""
    return {"pcnclaws": __version__, "torch": str(torch.__version__), "python": platform.python_version()}


@contextmanager
def law_files(path: Path) -> Iterator[Path]:
    """The folder with the files of a law: that of a run, or a temporary one with what a package holds.

    raises  UserError, one line that names the package, for whatever is wrong with it, also in the block
    """
    if not path.is_file():
        yield path
        return
    with tempfile.TemporaryDirectory(prefix="pcnclaws-") as folder:
        for name, content in read_law_package(path).items():
            (Path(folder) / name).write_bytes(content)
        try:
            yield Path(folder)
        except UserError as fault:
            raise UserError(str(fault).replace(folder, str(path))) from fault


def read_law_package(path: Path) -> dict[str, bytes]:
    """The members of a packaged law by name, of those that are known.

    raises  UserError, one line: no package, damaged, of a newer format, larger than laws are
    """
    try:
        members = _members(path)
    except UserError:
        raise
    except Exception as fault:  # zip and zlib raise whatever a damaged file makes them meet
        raise UserError(f"law={path} {NOT_ONE}, or damaged ({_words(fault)}); accepted: {ACCEPTED}") from fault
    try:
        about = json.loads(members[ABOUT])
    except (ValueError, RecursionError) as fault:
        raise UserError(f"law={path}: {ABOUT} cannot be read ({_words(fault)})") from fault
    _check_format(path, about)
    return members


def written_by(folder: Path) -> str:
    """Which version wrote a package, from its files, as the end of a sentence; empty for this one, and for runs."""
    if not (folder / ABOUT).is_file():
        return ""
    made = json.loads((folder / ABOUT).read_bytes()).get("versions")
    version, ours = str(made.get("pcnclaws", ""))[:20] if isinstance(made, dict) else "", __version__
    return "" if version in ("", ours) else f"; pcnclaws {version} wrote it, this is {ours}"


def _members(path: Path) -> dict[str, bytes]:
    if path.stat().st_size > MOST_BYTES:
        raise UserError(f"law={path} {NOT_ONE}: it is larger than {MOST_BYTES / 2**20:g} MiB; accepted: {ACCEPTED}")
    content = path.read_bytes()
    _check_end(path, content)
    with zipfile.ZipFile(BytesIO(content)) as archive:
        names = archive.namelist()
        for name in names:
            if "/" in name or "\\" in name or name in (".", "..") or names.count(name) > 1:
                raise UserError(f"law={path} {NOT_ONE}: it has a member {name[:60]!a}; accepted: {ACCEPTED}")
        for name in NEEDED:
            if name not in names:
                raise UserError(f"law={path} {NOT_ONE}: {name} is missing; accepted: {ACCEPTED}")
        return {name: _content(path, archive, name) for name in MEMBERS if name in names}


def _check_end(path: Path, content: bytes) -> None:
    """Refuses lists of members that are long before they are read."""
    end = content[-END_LENGTH:]
    large = content[-END_LENGTH - LARGE_END_LENGTH : -END_LENGTH].startswith(LARGE_END)
    if len(end) < END_LENGTH or not end.startswith(END) or large:
        raise UserError(f"law={path} {NOT_ONE}; accepted: {ACCEPTED}, or the path of a run folder")
    length = int.from_bytes(end[12:16], "little")
    if int.from_bytes(end[10:12], "little") > MOST_MEMBERS or length > MOST_MEMBERS * 512:
        raise UserError(f"law={path} {NOT_ONE}: it has more than {MOST_MEMBERS} members; accepted: {ACCEPTED}")


def _content(path: Path, archive: zipfile.ZipFile, name: str) -> bytes:
    """A member, of which no more is unpacked than it may have, whatever it claims."""
    most, method = MEMBERS[name], archive.getinfo(name).compress_type
    if method not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):  # others may ask for any memory
        raise UserError(f"law={path}: {name} is compressed by method {method}; accepted: 0 and 8")
    with archive.open(name) as file:
        content = file.read(most + 1)
    if len(content) > most:
        raise UserError(f"law={path}: {name} is larger than {most / 2**20:g} MiB, which no law is")
    return content


def _check_format(path: Path, about: Any) -> None:
    if not isinstance(about, dict) or about.get("format") != FORMAT or type(about.get("version")) is not int:
        raise UserError(f"law={path} {NOT_ONE}: {ABOUT} says something else; accepted: {ACCEPTED}")
    if about["version"] > VERSION:
        made = about.get("versions")
        program = str(made.get("pcnclaws", "a later version") if isinstance(made, dict) else "a later version")[:20]
        raise UserError(
            f"law={path} is of format {about['version']}, which pcnclaws {program} has written; pcnclaws "
            f"{__version__} reads up to format {VERSION}; accepted: a later version of pcnclaws"
        )


def _words(fault: BaseException) -> str:
    return " ".join(str(fault).split())[:100] or type(fault).__name__
