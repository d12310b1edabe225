"""Files read with a limit and replaced at once."""

from __future__ import annotations

import stat
from pathlib import Path

from activeloc import files
from activeloc.errors import MapError


def read_bytes(path: Path, max_bytes: int, what: str) -> bytes:
    """The contents of a regular file.

    Args:
        path: The file.
        max_bytes: How long it may be.
        what: How to call it in an error.

    Raises:
        MapError: If it is absent, unreadable, no regular file (a folder, a device) or too long.
    """
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise MapError(f"{path}: {what} must be a regular file, not a folder or a device")
        with path.open("rb") as file:
            content = file.read(max_bytes + 1)
    except (OSError, ValueError) as error:
        if isinstance(error, MapError):
            raise
        raise MapError(f"{path}: cannot read {what}: {reason_of(error)}") from None
    if len(content) > max_bytes:
        raise MapError(f"{path}: {what} has more than {max_bytes} bytes, the most allowed")
    return content


def write_atomically(path: Path, content: bytes) -> None:
    """Give a file new content: readers see the old file or the new one, never a part of it.

    Raises:
        MapError: If it cannot be written; an older file is untouched then.
    """
    try:
        files.write_atomically(path, content)
    except (OSError, ValueError) as error:
        raise MapError(f"{path}: cannot write the map: {reason_of(error)}") from None


def reason_of(error: Exception) -> str:
    """What an error says, on one line."""
    text = getattr(error, "strerror", None) or str(error) or type(error).__name__
    return " ".join(str(text).split())[:200]
