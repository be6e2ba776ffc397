"""What a file may be: the one budget of all readers, and the one way to open a file.

A file may be no file (a pipe, a device), claim to unpack to more than any memory holds, or nest its values
until Python gives up. Every reader opens files with `opened` and asks here before it believes what a file
claims. For large recordings, the ratio to the size of the file counts, and the memory that is available.
"""

from __future__ import annotations

import codecs
import io
import os
import re
import stat
import sys
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from skelsplat._atomic import opening
from skelsplat.exceptions import DatasetError

MOST_DOCUMENT = 2**21
"""Characters of a document that describes cameras, joints or options (TOML, YAML, XML)."""
MOST_LINE, MOST_COLUMNS = 2**22, 2**16
"""Characters of a line of a table, and its columns."""
MOST_NAME = 255
"""Characters of a camera's or joint's name in a file, as of the name of a file."""
MOST_CAMERAS = 4096
"""Cameras of a calibration, or what may belong to one in a file or folder: a dome has 521."""
_MOST_DEPTH = 64  # lists within lists: a pose in JSON has 6
_PART = r"""(?:"(?:[^"\\\n]|\\.){0,99}"|'[^'\n]{0,99}'|(?<![\w-])[\w-]+)\s*\.\s*"""
_DOTTED = re.compile(f"(?:{_PART}){{33}}")  # a key of many parts, of which the time grows with their square
# what is unpacked may be this, and this many times the size of the file: a recording in which hardly anything
# is detected is packed to a fiftieth, zeros to a thousandth
_ALWAYS, _RATIO = 2**27, 100
_UNCHECKED = 2**26  # bytes that need no look at the memory
_BRACKETS = bytes.maketrans(b"[{]}", b"\x01\x01\xff\xff")
_UNMARKED = bytes(set(range(256)) - set(b'"[]{}'))
_GROUP_LIMITS = ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes")


@contextmanager
def opened(path: Path, expected: str = "a readable file") -> Iterator[BinaryIO]:
    """Open a file that is no device or pipe; what the system says is a `DatasetError`."""
    # without waiting for the other end of a pipe
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    with opening(path, expected), open(os.open(path, flags), "rb") as stream:  # noqa: PTH123 - a descriptor
        if not stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
            raise DatasetError(path, "file", "a regular file", "a pipe or a device")
        yield stream


def amount(size: float) -> str:
    """Return a number of bytes in words."""
    return f"{size / 1e9:.1f} GB" if size >= 1e9 else f"{size / 1e6:.3g} MB"


def afford(path: Path, field: str, need: int) -> None:
    """Raise `DatasetError` if `need` bytes are not available."""
    there = _available() if need > _UNCHECKED else None
    if there is not None and need > there:
        expected = f"what fits into memory ({amount(there)} are available)"
        raise DatasetError(path, field, expected, f"values that need {amount(need)}")


def check_ratio(path: Path, field: str, need: int, held: int) -> None:
    """Raise `DatasetError` if `need` bytes are too much to come from `held` in a file."""
    if need > _ALWAYS + _RATIO * held:
        expected = f"at most {amount(_ALWAYS + _RATIO * held)} (or a file without packing)"
        raise DatasetError(path, field, expected, amount(need))


def zipped(path: Path, stream: BinaryIO) -> zipfile.ZipFile:
    """Return the zip file of a stream, unless what its members unpack to is too much."""
    if (wrong := damaged_zip(stream)) is not None:
        raise DatasetError(path, "file", "a complete npz file", wrong)
    archive = zipfile.ZipFile(stream)
    size = os.fstat(stream.fileno()).st_size
    check_ratio(path, "file", sum(info.file_size for info in archive.infolist()), size)
    return archive


def damaged_zip(stream: BinaryIO) -> str | None:
    """Say for a message what a stream is that is no complete zip file; None if it is one."""
    stream.seek(0)
    begins = stream.read(2)
    if zipfile.is_zipfile(stream):
        return None
    other = "another kind of file, or a damaged one" if begins else "an empty file"
    return "a damaged file, cut short" if begins == b"PK" else other


def _available() -> int | None:
    """Return the bytes that can be used, as the core counts them; None where the system does not say."""
    found = []
    with suppress(OSError):
        text = Path("/proc/meminfo").read_text(encoding="ascii")
        free = re.findall(r"^(?:MemAvailable|SwapFree): *(\d+) kB$", text, re.MULTILINE)
        found += [1024 * sum(map(int, free))] if free else []
    for limit in _GROUP_LIMITS:
        with suppress(OSError, ValueError):  # "max"
            found.append(int(Path(limit).read_text(encoding="ascii")))
    with suppress(ImportError, OSError):  # Windows has none
        import resource

        own = resource.getrlimit(resource.RLIMIT_AS)[0]
        found += [own] if own != resource.RLIM_INFINITY else []
    return min(found, default=None)


def read_bytes(path: Path) -> bytes:
    """Return the content of a file."""
    with opened(path) as stream:
        afford(path, "file", 2 * os.fstat(stream.fileno()).st_size)
        return stream.read()


def read_text(path: Path) -> str:
    """Return the text of a UTF-8 file; a byte-order mark is dropped."""
    content = read_bytes(path)
    if b"\0" in content:
        raise no_text(path, content, content.index(b"\0"))
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise no_text(path, content, error.start) from error
    return text.replace("\r\n", "\n").replace("\r", "\n")


def no_text(path: Path, content: bytes, at: int, before: int = 0) -> DatasetError:
    """Return the error for the byte ``at`` a place in content with ``before`` bytes before it in the file."""
    if not before and content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return DatasetError(path, "file", "text in UTF-8", "text in UTF-16: save it as UTF-8")
    return DatasetError(path, "file", "text in UTF-8", f"byte 0x{content[at]:02x} at {before + at}")


def read_lines(path: Path) -> Iterator[str]:
    """Yield the lines of a UTF-8 file of any length, with their ends, one at a time."""
    with opened(path) as stream:
        text = io.TextIOWrapper(stream, encoding="utf-8-sig")
        try:
            for number, line in enumerate(iter(lambda: text.readline(MOST_LINE + 1), ""), start=1):
                if len(line) > MOST_LINE:
                    expected = f"at most {MOST_LINE:,} characters"
                    raise DatasetError(path, f"line {number}", expected, "more")
                yield line
        except UnicodeDecodeError as error:
            raise no_text(path, error.object, error.start, stream.tell() - len(error.object)) from error


def check_json(path: Path, document: str, text: str) -> None:
    """Raise `DatasetError` for JSON nested too deeply for a `document`, or with values beyond the memory."""
    opens = text.count("[") + text.count("{")
    afford(path, "JSON", 72 * opens + 36 * text.count(","))
    if opens <= _MOST_DEPTH:
        return
    raw = re.sub(r"\\.", "", text, flags=re.DOTALL).encode("ascii", "replace")
    outside = re.sub(rb'"[^"]*"', b"", raw.translate(None, _UNMARKED)).partition(b'"')[0]
    steps = np.frombuffer(outside.translate(_BRACKETS), dtype=np.int8)
    if np.cumsum(steps, dtype=np.int32).max(initial=0) > _MOST_DEPTH:
        raise DatasetError(path, "JSON", document, f"lists nested too deeply (at most {_MOST_DEPTH} deep)")


def check_document(path: Path, text: str) -> None:
    """Raise `DatasetError` for a document longer than any that describes cameras, joints or options."""
    if len(text) > MOST_DOCUMENT:
        raise DatasetError(path, "file", f"at most {MOST_DOCUMENT:,} characters", f"{len(text):,}")


def parse_toml(path: Path, text: str) -> dict[str, Any]:
    """Return the TOML document that ``path`` holds as ``text``, or raise `DatasetError`."""
    if sys.version_info >= (3, 11):  # imported here, as most runs read no TOML
        import tomllib
    else:
        import tomli as tomllib
    check_document(path, text)
    if _DOTTED.search(text):
        raise DatasetError(path, "TOML", "keys of at most 32 parts", "more")
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # a number of thousands of digits is no TOMLDecodeError
        raise DatasetError(path, "TOML", "valid TOML", str(error).partition(";")[0]) from error


def read_toml(path: Path) -> dict[str, Any]:
    """Return the document of a TOML file, or raise `DatasetError`."""
    return parse_toml(path, read_text(path))


@contextmanager
def within_memory(path: Path) -> Iterator[None]:
    """Raise `DatasetError` where reading a file in this block runs out of memory or of depth."""
    try:
        yield
    except (MemoryError, RecursionError) as error:
        reason = "more" if isinstance(error, MemoryError) else "values nested too deeply"
        raise DatasetError(path, "content", "what fits into memory", reason) from error
