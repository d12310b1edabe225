"""A checkpoint comes back as it was, or is refused; nothing in it is ever run."""

import io
import json
import os
import pickle
import shutil
import zipfile

import numpy as np
import pytest
import torch

from activeloc.agents.sb3 import checkpoint as module
from activeloc.agents.sb3.algorithms import build_model, training_env
from activeloc.agents.sb3.checkpoint import (
    Checkpoint,
    find_checkpoint,
    latest_checkpoint,
    read_checkpoint,
    read_sb3_zip,
    write_checkpoint,
)
from activeloc.agents.sb3.resuming import load_weights, weights_of
from activeloc.agents.sb3.training import load_policy
from activeloc.errors import CheckpointError


class Payload:
    """What touches the canary when it is unpickled."""

    def __init__(self, canary):
        self.canary = str(canary)

    def __reduce__(self):
        return (os.mkdir, (self.canary,))


@pytest.fixture
def canary(tmp_path):
    """A path that must not come to be; the payload is shown to work first."""
    path = tmp_path / "canary"
    pickle.loads(pickle.dumps(Payload(path)))
    path.rmdir()
    yield path
    assert not path.exists()


def sample(config, seed=0):
    rng = np.random.default_rng(seed)
    return Checkpoint(
        {"training": config.plain(), "progress": {"num_timesteps": 5}},
        {"a.weight": rng.standard_normal((3, 2)).astype(np.float32), "a.bias": np.zeros(3)},
        {"0.step": np.array(4.0, dtype=np.float32)},
        {"actions": np.arange(6).reshape(3, 2), "random.gauss": np.array([np.nan])},
    )


def assert_equal(a, b):
    assert a.config == b.config
    for name in ("policy", "optimizer", "state"):
        one, other = getattr(a, name), getattr(b, name)
        assert one.keys() == other.keys()
        for key in one:
            assert (one[key].dtype, one[key].shape) == (other[key].dtype, other[key].shape)
            np.testing.assert_array_equal(one[key], other[key])


def test_it_comes_back_as_it_was(make_config, tmp_path):
    given = sample(make_config())
    path = write_checkpoint(tmp_path, 7, given)
    assert_equal(read_checkpoint(path), given)
    assert latest_checkpoint(tmp_path)[0] == path == find_checkpoint(tmp_path)


def test_the_last_two_and_the_best_are_kept(make_config, tmp_path):
    given = sample(make_config())
    for number in range(5):
        write_checkpoint(tmp_path, number, given)
        if number in (0, 2):
            write_checkpoint(tmp_path, number, given, best=True)
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == [
        "best",
        "best-000000000002",
        "latest",
        "step-000000000003",
        "step-000000000004",
    ]
    assert find_checkpoint(tmp_path).name == "best-000000000002"


@pytest.mark.parametrize("name", ["config.json", "policy.safetensors", "manifest.json"])
def test_a_broken_one_is_passed_over_with_a_warning(make_config, tmp_path, name):
    write_checkpoint(tmp_path, 1, sample(make_config(), 1))
    path = write_checkpoint(tmp_path, 2, sample(make_config(), 2))
    (path / name).write_bytes((path / name).read_bytes()[:-3])
    with pytest.warns(RuntimeWarning, match="trying the checkpoint before it"):
        found, stored = latest_checkpoint(tmp_path)
    assert found.name == "step-000000000001"
    assert_equal(stored, sample(make_config(), 1))


@pytest.mark.parametrize("at", ["write", "rename", "pointer"])
def test_a_full_disk_leaves_the_one_before(make_config, tmp_path, monkeypatch, at):
    write_checkpoint(tmp_path, 1, sample(make_config(), 1))

    def full(*_):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patched:
        if at == "pointer":
            patched.setattr(module, "write_atomically", full)
        else:
            patched.setattr(module.os, {"write": "fsync", "rename": "rename"}[at], full)
        with pytest.raises(OSError, match="No space"):
            write_checkpoint(tmp_path, 2, sample(make_config(), 2))
    assert not [*tmp_path.glob(".part-*")]
    assert_equal(latest_checkpoint(tmp_path)[1], sample(make_config(), 1))


# --- hostile folders


def rewrite(path, name, content):
    """Replace a file and make the manifest agree: only what is in the file is wrong."""
    import hashlib

    (path / name).write_bytes(content)
    manifest = json.loads((path / "manifest.json").read_text())
    manifest["files"][name] = {
        "size": len(content),
        "sha256": hashlib.sha256(content).hexdigest(),
    }
    (path / "manifest.json").write_text(json.dumps(manifest))


def edit_manifest(path, change):
    manifest = json.loads((path / "manifest.json").read_text())
    change(manifest)
    (path / "manifest.json").write_text(json.dumps(manifest))


def pickled_policy(path, canary):
    rewrite(path, "policy.safetensors", pickle.dumps(Payload(canary)))


def torch_policy(path, canary):
    file = io.BytesIO()
    torch.save({"a": Payload(canary)}, file)
    rewrite(path, "policy.safetensors", file.getvalue())


def pickled_config(path, canary):
    rewrite(path, "config.json", pickle.dumps(Payload(canary)))


def truncated(path, canary):
    content = (path / "policy.safetensors").read_bytes()
    rewrite(path, "policy.safetensors", content[: len(content) // 2])


def wrong_sha(path, canary):
    content = bytearray((path / "policy.safetensors").read_bytes())
    content[-1] ^= 1
    (path / "policy.safetensors").write_bytes(content)


def newer(path, canary):
    edit_manifest(path, lambda manifest: manifest.update(format=2))


def foreign_member(path, canary):
    (path / "extra.pkl").write_bytes(pickle.dumps(Payload(canary)))
    edit_manifest(path, lambda m: m["files"].update({"extra.pkl": {"sha256": ""}}))


def dots_in_names(path, canary):
    edit_manifest(
        path,
        lambda m: m["files"].update({"../config.json": m["files"].pop("config.json")}),
    )


def cut_json(path, canary):
    content = (path / "config.json").read_bytes()
    rewrite(path, "config.json", content[: len(content) // 2])


def deep_json(path, canary):
    rewrite(path, "config.json", b"[" * 100_000)


def nan_json(path, canary):
    rewrite(path, "config.json", b'{"a": NaN}')


def link(path, canary):
    target = path.parent / "elsewhere"
    shutil.copy(path / "config.json", target)
    (path / "config.json").unlink()
    (path / "config.json").symlink_to(target)


def fifo(path, canary):
    (path / "config.json").unlink()
    os.mkfifo(path / "config.json")


def missing(path, canary):
    (path / "state.safetensors").unlink()


def nan_weights(path, canary):
    from safetensors.numpy import save

    rewrite(path, "policy.safetensors", save({"a": np.array([1.0, np.nan])}))


def huge(path, canary):
    with open(path / "config.json", "wb") as file:
        file.truncate(2**40)


HOSTILE = {
    pickled_policy: "no safetensors file",
    torch_policy: "no safetensors file",
    pickled_config: "no JSON",
    truncated: "no safetensors file",
    wrong_sha: "sha256 is not the manifest's",
    newer: "written by a newer activeloc",
    foreign_member: "must list",
    dots_in_names: "must list",
    cut_json: "no JSON",
    deep_json: "no JSON",
    nan_json: "no JSON",
    link: "cannot be read",
    fifo: "no regular file",
    missing: "cannot be read",
    nan_weights: "not finite",
    huge: "at most",
}


@pytest.mark.parametrize("spoil", HOSTILE, ids=lambda spoil: spoil.__name__)
def test_hostile_folders_are_refused(make_config, tmp_path, canary, spoil):
    path = write_checkpoint(tmp_path / "run", 1, sample(make_config()))
    read_checkpoint(path)
    spoil(path, canary)
    with pytest.raises(CheckpointError, match=HOSTILE[spoil]):
        read_checkpoint(path)


def test_a_link_to_a_folder_is_refused(make_config, tmp_path):
    path = write_checkpoint(tmp_path / "run", 1, sample(make_config()))
    (tmp_path / "link").symlink_to(path)
    with pytest.raises(CheckpointError, match="must be a folder"):
        read_checkpoint(tmp_path / "link")


def test_pickles_beside_the_files_are_ignored(make_config, tmp_path, canary):
    path = write_checkpoint(tmp_path / "run", 1, sample(make_config()))
    (path / "policy.pkl").write_bytes(pickle.dumps(Payload(canary)))
    assert_equal(read_checkpoint(path), sample(make_config()))


@pytest.mark.parametrize("pointer", [b"../../etc", b"", b"\xff" * 40, b"step-000000000009\n"])
def test_a_pointer_to_nowhere_is_no_matter(make_config, tmp_path, pointer):
    path = write_checkpoint(tmp_path, 1, sample(make_config()))
    (tmp_path / "latest").write_bytes(pointer)
    assert latest_checkpoint(tmp_path)[0] == path


# --- weights and a model


@pytest.fixture
def model(make_config):
    config = make_config()
    return build_model(config, training_env(config))


def weights(model):
    return {name: tensor.clone() for name, tensor in model.policy.state_dict().items()}


def is_same(before, model):
    return all(torch.equal(before[name], t) for name, t in model.policy.state_dict().items())


def test_weights_of_other_shapes_are_refused(model):
    policy, optimizer = weights_of(model)
    before = weights(model)
    name = next(name for name in policy if name.endswith("weight"))
    with pytest.raises(CheckpointError, match=rf"{name}: expected shape"):
        load_weights(model, policy | {name: policy[name][:, :-1]}, optimizer)
    with pytest.raises(CheckpointError, match="got None"):
        load_weights(model, {key: policy[key] for key in policy if key != name})
    with pytest.raises(CheckpointError, match=r"optimizer: 0\.exp_avg"):
        load_weights(model, policy, {"0.exp_avg": np.zeros(1)})
    with pytest.raises(CheckpointError, match="unknown name"):
        load_weights(model, policy, {"0.hook": np.zeros(1)})
    assert is_same(before, model)


@pytest.mark.parametrize(
    "change",
    [
        {"env": "nowhere"},
        {"algorithm": "dqn"},
        {"seed": "1"},
        {"settings": {"map": "nothing"}},
        {"settings": 3},
        {"hyperparameters": {"hidden": [-1]}},
        {"hyperparameters": [], "algorithm": []},
        {"surplus": 1},
    ],
)
def test_configurations_from_files_are_checked_like_any(make_config, tmp_path, change):
    plain = make_config().plain() | change
    given = sample(make_config())
    path = write_checkpoint(
        tmp_path, 1, Checkpoint({"training": plain}, given.policy, given.optimizer, given.state)
    )
    with pytest.raises(ValueError, match=r"\S") as refused:
        load_policy(path)
    assert type(refused.value).__module__ == "activeloc.errors"


# --- other people's zip files


def honest(path, model):
    model.save(path)
    return zipfile.ZipFile(path)


def repacked(path, archive, change, compression=zipfile.ZIP_STORED):
    members = {name: archive.read(name) for name in archive.namelist()}
    change(members)
    with zipfile.ZipFile(path, "w", compression) as out:
        for name, content in members.items():
            out.writestr(name, content)


def saved(value):
    file = io.BytesIO()
    torch.save(value, file)
    return file.getvalue()


def with_shape(model):
    return {n: torch.zeros(2) for n in model.policy.state_dict()}


def with_nan(model):
    return {n: torch.full_like(t, torch.nan) for n, t in model.policy.state_dict().items()}


ZIPS = {
    "payload in policy.pth": lambda c, m: {"policy.pth": saved({"a": Payload(c)})},
    "plain pickle as policy.pth": lambda c, m: {"policy.pth": pickle.dumps(Payload(c))},
    "payload in pytorch_variables": lambda c, m: {"pytorch_variables.pth": saved(Payload(c))},
    "payload in optimizer": lambda c, m: {"policy.optimizer.pth": saved([Payload(c)])},
    "foreign member": lambda c, m: {"payload.pkl": pickle.dumps(Payload(c))},
    "foreign .pth": lambda c, m: {"env.pth": saved({})},
    "dots in a name": lambda c, m: {"../policy.pth": b""},
    "absolute name": lambda c, m: {"/etc/passwd": b""},
    "wrong shapes": lambda c, m: {"policy.pth": saved(with_shape(m))},
    "weights that are not finite": lambda c, m: {"policy.pth": saved(with_nan(m))},
    "no network at all": lambda c, m: {"policy.pth": saved([1, 2])},
}


@pytest.mark.parametrize("name", ZIPS)
def test_hostile_zips_are_refused_and_the_model_is_as_before(model, tmp_path, canary, name):
    archive = honest(tmp_path / "good.zip", model)
    bad = tmp_path / "bad.zip"
    repacked(bad, archive, lambda members: members.update(ZIPS[name](canary, model)))
    before = weights(model)
    with pytest.raises(CheckpointError):
        read_sb3_zip(bad, model)
    assert is_same(before, model)


def test_an_honest_zip_is_read_and_its_pickles_are_not(make_config, model, tmp_path, canary):
    import base64

    config = make_config(seed=9)
    other = build_model(config, training_env(config))
    archive = honest(tmp_path / "good.zip", other)
    serialized = base64.b64encode(pickle.dumps(Payload(canary))).decode()
    data = json.dumps({"a": {":type:": "x", ":serialized:": serialized}}).encode()
    repacked(tmp_path / "mixed.zip", archive, lambda members: members.update({"data": data}))
    assert not is_same(weights(other), model)
    read_sb3_zip(tmp_path / "mixed.zip", model)
    assert is_same(weights(other), model)


def test_a_bomb_is_refused_by_its_table_of_contents(model, tmp_path):
    archive = honest(tmp_path / "good.zip", model)
    bomb = tmp_path / "bomb.zip"
    with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as out:
        out.writestr("policy.pth", archive.read("policy.pth"))
        with out.open("data", "w") as member:
            for _ in range(200):
                member.write(bytes(2**20))
    with pytest.raises(CheckpointError, match="would unpack"):
        read_sb3_zip(bomb, model)


def test_what_is_no_zip_is_refused(model, tmp_path):
    (tmp_path / "text.zip").write_text("no zip")
    model.save(tmp_path / "cut.zip")
    content = (tmp_path / "cut.zip").read_bytes()
    (tmp_path / "cut.zip").write_bytes(content[: len(content) // 2])
    for name in ("text.zip", "cut.zip", "none.zip"):
        with pytest.raises(CheckpointError, match=r"no zip file|no regular file|unknown member"):
            read_sb3_zip(tmp_path / name, model)
