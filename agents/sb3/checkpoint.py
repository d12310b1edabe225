"""Checkpoints: folders that are whole or not there, and that are read without unpickling.

A run keeps them side by side::

    checkpoints/
        step-000000065536/
            config.json             what the run is and how far it is
            policy.safetensors      weights
            optimizer.safetensors   moments of the optimiser
            state.safetensors       states of the random generators, actions to replay, ...
            manifest.json           version of the format, size and sha256 of each file
        best-000000032768/          the same; of the best evaluation
        latest                      name of the newest folder, written last
        best                        name of the best folder

A folder is written under another name, synced, and renamed; a reader believes no file whose digest
is not in the manifest. Old folders go, but for the last two and the best.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import stat
import tempfile
import warnings
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load as load_tensors
from safetensors.numpy import save as save_tensors
from stable_baselines3.common.base_class import BaseAlgorithm

from activeloc.errors import CheckpointError
from activeloc.files import write_atomically

FORMAT = 1
MANIFEST, CONFIG = "manifest.json", "config.json"
TENSORS = ("policy", "optimizer", "state")
MIB = 2**20
#: Largest size of each file [byte]; the state may hold a replay buffer.
LIMITS = {
    CONFIG: MIB,
    "policy.safetensors": 256 * MIB,
    "optimizer.safetensors": 512 * MIB,
    "state.safetensors": 8192 * MIB,
}
KEPT = 2
LATEST, BEST = "latest", "best"
PART = ".part-"
NAME = re.compile(r"(step|best)-[0-9]{12}")
ZIP_MEMBERS = {
    "data",
    "pytorch_variables.pth",
    "policy.pth",
    "policy.optimizer.pth",
    "_stable_baselines3_version",
    "system_info.txt",
}
ZIP_LIMIT, ZIP_RATIO = 512 * MIB, 200

Arrays = dict[str, NDArray[Any]]


@dataclass(frozen=True)
class Checkpoint:
    """What a checkpoint holds, as plain data.

    Attributes:
        config: What the run is and how far it is, as JSON has it.
        policy: The network's arrays, by name.
        optimizer: The optimiser's.
        state: All else that the run needs to go on.
    """

    config: Mapping[str, Any]
    policy: Arrays
    optimizer: Arrays
    state: Arrays


# --- writing


def write_checkpoint(
    folder: Path, num_timesteps: int, checkpoint: Checkpoint, *, best: bool = False
) -> Path:
    """Add a checkpoint to a run's, and drop those that are no longer kept.

    Args:
        folder: Of the run's checkpoints; made if there is none.
        num_timesteps: How far the run is; the name says it.
        checkpoint: What to keep.
        best: Whether it is the best so far; else it is the latest.

    Returns:
        Where it is.

    Raises:
        OSError: If it cannot be written; older checkpoints are untouched then, nothing is left.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{'best' if best else 'step'}-{num_timesteps:012d}"
    part = Path(tempfile.mkdtemp(dir=folder, prefix=PART))
    try:
        _write_files(part, checkpoint)
        # A run that went on from before here may have come by again, with the same content.
        if not _same_content(part, path):
            if path.exists():
                os.rename(path, Path(tempfile.mkdtemp(dir=folder, prefix=PART)) / "old")
            os.rename(part, path)
        _sync(folder)
    except BaseException:
        shutil.rmtree(part, ignore_errors=True)
        raise
    write_atomically(folder / (BEST if best else LATEST), f"{path.name}\n".encode())
    _sync(folder)
    _prune(folder)
    return path


def _write_files(part: Path, checkpoint: Checkpoint) -> None:
    text = json.dumps(checkpoint.config, indent=1, allow_nan=False)
    contents = {CONFIG: text.encode()}
    for name in TENSORS:
        arrays = {key: np.asarray(a, order="C") for key, a in getattr(checkpoint, name).items()}
        contents[f"{name}.safetensors"] = save_tensors(arrays)
    files = {
        name: {"size": len(content), "sha256": hashlib.sha256(content).hexdigest()}
        for name, content in contents.items()
    }
    contents[MANIFEST] = json.dumps({"format": FORMAT, "files": files}, indent=1).encode()
    for name, content in contents.items():
        with open(part / name, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
    os.chmod(part, 0o755)
    _sync(part)


def _same_content(part: Path, path: Path) -> bool:
    """Whether a folder is there already, whole and with the files of another."""
    try:
        read_checkpoint(path)
    except CheckpointError:
        return False
    return (part / MANIFEST).read_bytes() == (path / MANIFEST).read_bytes()


def _sync(folder: Path) -> None:
    """Make renames in a folder outlive a power cut."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _prune(folder: Path) -> None:
    """Drop all folders but the last two, the best, and those that the pointers name."""
    names = _names(folder, "step")
    kept = {*names[:KEPT], _pointed(folder, BEST), _pointed(folder, LATEST)}
    for name in [*names, *_names(folder, "best")]:
        if name not in kept:
            shutil.rmtree(folder / name, ignore_errors=True)
    for path in folder.glob(f"{PART}*"):
        shutil.rmtree(path, ignore_errors=True)


# --- reading


def latest_checkpoint(folder: Path) -> tuple[Path, Checkpoint]:
    """The newest checkpoint that is whole; warns of those that are not.

    Args:
        folder: Of the run's checkpoints.

    Raises:
        CheckpointError: If there is none.
    """
    names = _names(folder, "step")
    pointed = _pointed(folder, LATEST)
    if pointed in names:
        names.remove(pointed)
        names.insert(0, pointed)
    for name in names:
        try:
            return folder / name, read_checkpoint(folder / name)
        except CheckpointError as error:
            warnings.warn(f"{error}; trying the checkpoint before it", RuntimeWarning, stacklevel=2)
    raise CheckpointError(f"{folder}: no checkpoint that can be read")


def find_checkpoint(path: Path) -> Path:
    """The folder of a checkpoint: of itself, or the best (else the latest) of a run.

    Raises:
        CheckpointError: If there is none.
    """
    if (path / MANIFEST).exists():
        return path
    folder = path / "checkpoints" if (path / "checkpoints").is_dir() else path
    for pointer in (BEST, LATEST):
        name = _pointed(folder, pointer)
        if name is not None and (folder / name).is_dir():
            return folder / name
    raise CheckpointError(f"{path}: no checkpoint here, nor a run that has one")


def read_checkpoint(path: Path) -> Checkpoint:
    """A checkpoint, after its manifest has been found to hold.

    Nothing is unpickled; links are not followed; sizes are bounded.

    Raises:
        CheckpointError: If anything is missing, too large, cut, changed, or of a newer version.
    """
    if path.is_symlink() or not path.is_dir():
        raise CheckpointError(f"{path}: a checkpoint must be a folder")
    manifest = _parsed(path / MANIFEST, _read(path / MANIFEST, MIB))
    version, files = manifest.get("format"), manifest.get("files")
    if not isinstance(version, int) or isinstance(version, bool) or version < 1:
        raise CheckpointError(f"{path}: {MANIFEST} says no format; got {version!r:.80}")
    if version > FORMAT:
        raise CheckpointError(
            f"{path}: of format {version}, written by a newer activeloc; this one reads {FORMAT}"
        )
    if not isinstance(files, dict) or set(files) != set(LIMITS):
        raise CheckpointError(
            f"{path}: {MANIFEST} must list {', '.join(LIMITS)}; got {files!r:.200}"
        )
    contents = {}
    for name, limit in LIMITS.items():
        contents[name] = _read(path / name, limit)
        expected = files[name].get("sha256") if isinstance(files[name], dict) else None
        if hashlib.sha256(contents[name]).hexdigest() != expected:
            raise CheckpointError(f"{path / name}: its sha256 is not the manifest's")
    config = _parsed(path / CONFIG, contents[CONFIG])
    arrays = {name: _tensors(path, name, contents[f"{name}.safetensors"]) for name in TENSORS}
    return Checkpoint(config, **arrays)


def _read(path: Path, limit: int) -> bytes:
    """A regular file's content; links are not followed."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    except OSError as error:
        raise CheckpointError(f"{path}: cannot be read: {error.strerror}") from None
    with open(descriptor, "rb") as file:
        about = os.fstat(descriptor)
        if not stat.S_ISREG(about.st_mode):
            raise CheckpointError(f"{path}: is no regular file")
        if about.st_size > limit:
            raise CheckpointError(f"{path}: has {about.st_size} bytes; at most {limit} are read")
        return file.read(limit + 1)


def _parsed(path: Path, content: bytes) -> dict[str, Any]:
    try:
        value = json.loads(content.decode("utf-8"), parse_constant=_no_constant)
    except (ValueError, RecursionError):
        raise CheckpointError(f"{path}: is no JSON") from None
    if not isinstance(value, dict):
        raise CheckpointError(f"{path}: must hold an object; got {value!r:.80}")
    return value


def _no_constant(name: str) -> None:
    raise ValueError(name)


def _tensors(path: Path, name: str, content: bytes) -> Arrays:
    try:
        arrays = load_tensors(content)
    except (SafetensorError, ValueError, KeyError, TypeError):
        raise CheckpointError(f"{path / name}.safetensors: is no safetensors file") from None
    if name != "state":
        for key, array in arrays.items():
            if array.dtype.kind == "f" and not np.isfinite(array).all():
                raise CheckpointError(f"{path}: {name}: {key} holds numbers that are not finite")
    return arrays


def _names(folder: Path, kind: str) -> list[str]:
    """Names of the folders of one kind, ``step`` or ``best``, newest first."""
    if not folder.is_dir():
        return []
    own = (path for path in folder.glob(f"{kind}-*") if NAME.fullmatch(path.name))
    found = (path for path in own if not path.is_symlink())
    return sorted((path.name for path in found if path.is_dir()), reverse=True)


def _pointed(folder: Path, pointer: str) -> str | None:
    try:
        text = _read(folder / pointer, 64).decode("ascii", "replace").strip()
    except CheckpointError:
        return None
    return text if NAME.fullmatch(text) else None


# --- other people's files


def read_sb3_zip(path: Path, model: BaseAlgorithm) -> None:
    """Take over the weights of a file that SB3's ``save`` wrote, whoever wrote it.

    Its ``data`` member, which holds pickles, is never looked at; the weights are read by torch's
    loader that makes nothing but tensors.

    Args:
        path: The zip file.
        model: Of the same algorithm and network; unchanged if the file is refused.

    Raises:
        CheckpointError: If the file is no such zip, holds members of other names, would unpack to
            too much, or its weights do not go with the model.
    """
    _check_members(path)
    before = model.get_parameters()
    kept = {name: _copied(value) for name, value in before.items()}
    try:
        model.set_parameters(str(path), exact_match=True, device="cpu")
        weights = model.policy.state_dict()
        if not all(bool(tensor.isfinite().all()) for tensor in weights.values()):
            raise CheckpointError(f"{path}: weights are not finite")
    except Exception as error:
        model.set_parameters(kept, exact_match=True, device="cpu")
        if isinstance(error, CheckpointError):
            raise
        reason = " ".join(str(error).split())[:200]
        raise CheckpointError(f"{path}: does not go with this model: {reason}") from None


def _copied(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _copied(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_copied(item) for item in value]
    return value.clone() if hasattr(value, "clone") else value


def _check_members(path: Path) -> None:
    """Refuse a zip by its table of contents, before anything is unpacked."""
    if path.is_symlink() or not path.is_file():
        raise CheckpointError(f"{path}: is no regular file")
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
    except (zipfile.BadZipFile, ValueError, NotImplementedError, OSError):
        raise CheckpointError(f"{path}: is no zip file") from None
    names = [member.filename for member in members]
    if wrong := sorted(set(names) - ZIP_MEMBERS):
        raise CheckpointError(f"{path}: unknown member {wrong[0]!r:.80}")
    if len(set(names)) < len(names) or "policy.pth" not in names:
        raise CheckpointError(f"{path}: members must be there once, policy.pth among them")
    size = sum(member.file_size for member in members)
    packed = sum(member.compress_size for member in members)
    if size > ZIP_LIMIT or size > ZIP_RATIO * max(packed, 1):
        raise CheckpointError(f"{path}: would unpack to {size} bytes; at most {ZIP_LIMIT}, 200:1")
