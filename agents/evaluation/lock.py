"""One run at a time in one folder."""

from __future__ import annotations

import os
import socket
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from activeloc.errors import ConfigError

FILE_NAME = ".lock"


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold a folder; the lock of a process that has died is taken over.

    The lock is a file that says who holds it: process and host.

    Raises:
        ConfigError: If another run holds it.
        OSError: If the folder cannot be written to.
    """
    lock = folder / FILE_NAME
    _take(lock)
    try:
        yield
    finally:
        lock.unlink(missing_ok=True)


def _take(lock: Path) -> None:
    """Put the lock in its place with its content, in one step that fails if there is one."""
    with tempfile.NamedTemporaryFile("w", dir=lock.parent, prefix=".part-") as file:
        file.write(f"{os.getpid()} {socket.gethostname()}\n")
        file.flush()
        for _ in range(3):
            try:
                os.link(file.name, lock)
            except FileExistsError:
                _remove_stale(lock)
            else:
                return
    raise ConfigError(f"{lock.parent}: other runs are taking the lock {lock.name}; try again")


def _remove_stale(lock: Path) -> None:
    try:
        process, _, host = lock.read_text().strip().partition(" ")
    except FileNotFoundError:
        return
    if not process.isdecimal():
        raise ConfigError(f"{lock} is no lock of ours; remove it if no run is writing there")
    if host == socket.gethostname() and not _is_alive(int(process)):
        lock.unlink(missing_ok=True)
        return
    raise ConfigError(
        f"{lock.parent} is in use by process {process} on {host} (says {lock.name}); "
        "wait for it or choose another folder"
    )


def _is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        pass
    return True
