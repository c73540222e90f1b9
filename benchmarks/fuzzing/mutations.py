"""Mutations of files and of command lines: pure functions of random numbers, from bytes to bytes."""

import io
import random
import struct
import warnings
import zipfile
from collections.abc import Callable, Sequence

# Numbers that readers trip over.
INTEGERS = (0, 1, 2, 3, 7, 8, 127, 128, 255, 256, 65535, 2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**63 - 1, 2**64 - 1)
WORDS = (
    *("nan", "inf", "-inf", "1e309", "-0", "0", "-1", "1e-300", "9" * 40, "0x10", "1_000", "true", "null", "~", "None"),
    *(
        "",
        " ",
        "a" * 5000,
        "\x00",
        "\ufffd",
        "'",
        '"',
        "[",
        "]",
        "{",
        "}",
        ":",
        ",",
        "=",
        "#",
        "%",
        "&a",
        "*a",
        "!!map",
    ),
    *("../../x", "/dev/zero", "${oc.env:HOME}", "${now:}", "!!python/object/apply:os.system ['true']", "- - - -"),
)
MOST_BYTES = 2**20


def mutated(content: bytes, others: Sequence[bytes], draw: random.Random) -> bytes:
    """A content with one to eight changes, of its bytes, its words, or, where it is an archive, of its members.

    others  contents of the same kind, of which parts may be taken over
    """
    ways: list[Callable[[bytes, Sequence[bytes], random.Random], bytes]] = [_bytes_changed]
    if _is_text(content):
        ways += [_words_changed, _words_changed, _lines_changed]
    if content[:4] == b"PK\x03\x04":
        ways += [_members_changed, _members_changed]
    way = draw.choice(ways)
    for _ in range(draw.choice((1, 1, 1, 2, 2, 4, 8))):
        content = way(content, others, draw)
    return content[:MOST_BYTES]


def mutated_arguments(arguments: Sequence[str], words: Sequence[str], draw: random.Random) -> list[str]:
    """Arguments with one to four changes: words of other commands, values that are none, characters.

    words  arguments to take over
    """
    found = list(arguments)
    for _ in range(draw.choice((1, 1, 2, 4))):
        place = draw.randrange(len(found)) if found else 0
        kind = draw.randrange(6)
        if kind == 0 and found:
            del found[place]
        elif kind == 1:
            found.insert(place, draw.choice(words))
        elif kind == 2 and found:
            name, _, _ = found[place].partition("=")
            found[place] = f"{name}={draw.choice(WORDS)}"
        elif kind == 3 and found:
            _, _, value = draw.choice(words).partition("=")
            found[place] = f"{found[place].partition('=')[0]}={value}"
        elif found:
            changed = _bytes_changed(found[place].encode(), [], draw) if kind == 4 else _words_of(found[place], draw)
            found[place] = changed.decode("utf-8", errors="replace") if isinstance(changed, bytes) else changed
    return [one.replace("\x00", "") for one in found]


def _is_text(content: bytes) -> bool:
    return b"\x00" not in content[:4096] and bool(content)


def _bytes_changed(content: bytes, others: Sequence[bytes], draw: random.Random) -> bytes:
    changed = bytearray(content)
    if not changed:
        return bytes(draw.randrange(256) for _ in range(draw.randrange(64)))
    place, length = draw.randrange(len(changed)), draw.choice((1, 1, 2, 4, 8, 16, 64, 512))
    kind = draw.randrange(8)
    if kind == 0:
        changed[place] ^= 1 << draw.randrange(8)
    elif kind == 1:
        changed[place] = draw.choice((0, 1, 127, 128, 255, draw.randrange(256)))
    elif kind == 2:
        size, order = draw.choice((1, 2, 4, 8)), draw.choice("<>")
        number = draw.choice(INTEGERS) & (2 ** (8 * size) - 1)
        changed[place : place + size] = struct.pack(order + {1: "B", 2: "H", 4: "I", 8: "Q"}[size], number)
    elif kind == 3:
        del changed[place : place + length]
    elif kind == 4:
        del changed[place:]
    elif kind == 5:
        changed[place:place] = changed[place : place + length]
    elif kind == 6 and others:
        other = draw.choice(others)
        start = draw.randrange(max(len(other), 1))
        changed[place : place + length] = other[start : start + length]
    else:
        changed[place : place + length] = bytes(draw.randrange(256) for _ in range(length))
    return bytes(changed)


def _lines_changed(content: bytes, others: Sequence[bytes], draw: random.Random) -> bytes:
    lines = content.splitlines(keepends=True)
    place = draw.randrange(len(lines)) if lines else 0
    kind = draw.randrange(4)
    if kind == 0 and lines:
        del lines[place]
    elif kind == 1 and lines:
        lines[place:place] = [lines[place]] * draw.choice((1, 2, 100))
    elif kind == 2 and lines:
        other = draw.randrange(len(lines))
        lines[place], lines[other] = lines[other], lines[place]
    elif others:
        lines.insert(place, draw.choice(draw.choice(others).splitlines(keepends=True) or [b"\n"]))
    return b"".join(lines)


def _words_changed(content: bytes, others: Sequence[bytes], draw: random.Random) -> bytes:
    return _words_of(content.decode("utf-8", errors="surrogateescape"), draw).encode("utf-8", errors="surrogateescape")


def _words_of(text: str, draw: random.Random) -> str:
    """A text in which one stretch of letters and digits is another word."""
    ends = [k for k in range(1, len(text)) if text[k - 1].isalnum() != text[k].isalnum()]
    bounds = [0, *ends, len(text)]
    at = draw.randrange(len(bounds) - 1)
    return text[: bounds[at]] + draw.choice(WORDS) + text[bounds[at + 1] :]


def _members_changed(content: bytes, others: Sequence[bytes], draw: random.Random) -> bytes:
    """An archive with a member changed, renamed, left out or there twice, its checksums right."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            members = [(one.filename, archive.read(one)) for one in archive.infolist()]
    except Exception:  # a damaged archive, of an earlier change
        return _bytes_changed(content, others, draw)
    if not members:
        return content
    place = draw.randrange(len(members))
    name, inside = members[place]
    kind = draw.randrange(6)
    if kind == 0:
        del members[place]
    elif kind == 1:
        members.append((name, inside))
    elif kind == 2:
        members[place] = (f"{name[:-4]}{draw.choice(WORDS[:40])[:60]}{name[-4:]}", inside)
    else:
        members[place] = (name, _bytes_changed(inside, [one for _, one in members], draw))
    made = io.BytesIO()
    with (
        warnings.catch_warnings(action="ignore"),
        zipfile.ZipFile(made, "w", draw.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED))) as archive,
    ):
        for name, inside in members:
            archive.writestr(zipfile.ZipInfo(name.replace("\x00", "") or "x"), inside)
    return made.getvalue()
