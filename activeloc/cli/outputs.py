"""Files that a subcommand writes: refused before the work rather than after it."""

from __future__ import annotations

import os
from pathlib import Path

from activeloc.errors import ConfigError


def check_output(path: Path, suffixes: tuple[str, ...]) -> None:
    """Refuse a file that could not be written.

    Raises:
        ConfigError: If its suffix is none of these, it is a folder, or its folder does not exist
            or cannot be written to.
    """
    if path.suffix.lower() not in suffixes:
        raise ConfigError(f"--out {path}: must end in {' or '.join(suffixes)}")
    if path.is_dir():
        raise ConfigError(f"--out {path}: is a folder")
    if not path.parent.is_dir():
        raise ConfigError(f"--out {path}: there is no folder {path.parent}")
    if not os.access(path.parent, os.W_OK):
        raise ConfigError(f"--out {path}: the folder {path.parent} cannot be written to")


def check_folder(path: Path, names: tuple[str, ...], overwrite: bool) -> None:
    """Refuse a folder that could not be written to, or that holds one of these files already.

    Raises:
        ConfigError: If it is a file, has no folder above it that can be written to, or holds
            earlier results and ``overwrite`` is false.
    """
    if path.exists() and not path.is_dir():
        raise ConfigError(f"--out {path}: is a file; the results need a folder")
    nearest = next(parent for parent in (path, *path.absolute().parents) if parent.exists())
    if not nearest.is_dir() or not os.access(nearest, os.W_OK):
        raise ConfigError(f"--out {path}: {nearest} is no folder that can be written to")
    there = [name for name in names if (path / name).exists()]
    if there and not overwrite:
        raise ConfigError(f"--out {path}: holds {there[0]} already; replace it with --overwrite")
