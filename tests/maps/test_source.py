"""What a user may write for ``map``, and which map that is."""

import ast
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import activeloc.maps
from activeloc.errors import ConfigError, MapError
from activeloc.maps import MapSource, from_text, save_map
from activeloc.maps.maze import Maze
from activeloc.maps.office import Office

HUT = from_text("#####\n#..?#\n#.#.#\n#####", name="hut")


def state(rng):
    return rng.bit_generator.state["state"]["state"]


def test_a_name_is_the_building_with_seed_0():
    source = MapSource.parse("office")
    grid = source.number(0)
    assert grid == Office().generate(np.random.default_rng(0))
    assert (grid.name, source.n_maps, source.is_fixed) == ("office-0", 1, True)


def test_a_seed_is_the_building_with_that_seed():
    source = MapSource.parse("maze:7")
    assert source.number(0) == Maze().generate(np.random.default_rng(7))
    assert (source.number(0).name, source.n_maps) == ("maze-7", 1)


def test_a_range_holds_its_ends():
    source = MapSource.parse("maze:2-5")
    assert (source.n_maps, source.is_fixed) == (4, False)
    assert [source.number(i).name for i in range(6)] == [
        f"maze-{seed}" for seed in (2, 3, 4, 5, 2, 3)
    ]
    rng = np.random.default_rng(0)
    assert {source.draw(rng).name for _ in range(60)} == {f"maze-{seed}" for seed in (2, 3, 4, 5)}


def test_endless_maps_come_from_the_stream_of_the_rng():
    source = MapSource.parse("maze(size=7):*")
    assert (source.n_maps, source.is_fixed) == (None, False)
    assert source.number(11) == Maze(size=7).generate(np.random.default_rng(11))
    rng, twin = np.random.default_rng(3), np.random.default_rng(3)
    names = [source.draw(rng).name for _ in range(5)]
    assert names == [source.draw(twin).name for _ in range(5)]
    assert len(set(names)) == 5
    assert source.draw(np.random.default_rng(3)) == source.number(int(names[0].split("-")[1]))


@pytest.mark.parametrize("spec", ["maze", "maze:4", HUT, "hut.yaml"], ids=str)
def test_one_map_leaves_the_rng_alone_and_is_made_once(spec, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save_map(HUT, tmp_path / "hut.yaml")
    source = MapSource.parse(spec)
    rng = np.random.default_rng(0)
    before = state(rng)
    assert source.draw(rng) is source.draw(rng) is source.number(5)
    assert state(rng) == before


def test_equal_sources_share_their_buildings():
    one, other = MapSource.parse("maze(size=9):0-3"), MapSource.parse("maze( size = 9 ) : 3")
    assert one.number(3) is other.number(0)
    assert one.number(3) is not MapSource.parse("maze:3").number(0)


def test_parameters_go_to_the_generator():
    source = MapSource.parse("office(rooms=6,door=0.8):2")
    assert source.generator == Office(rooms=6, door=0.8)
    assert MapSource.parse("office()").generator == Office()


@pytest.mark.parametrize("name", ["hut.yaml", "my maps/hüt.yml", "hut.v2.txt"])
def test_files(tmp_path, name):
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    save_map(HUT, path)
    for spec in (path, str(path)):
        source = MapSource.parse(spec)
        np.testing.assert_array_equal(source.number(0).cells, HUT.cells)
        assert source.number(0).name == path.stem
        assert source.spec == str(path)


def test_a_source_is_taken_as_it_is():
    source = MapSource.parse("maze:1")
    assert MapSource.parse(source) is source
    assert MapSource.parse(HUT).draw(np.random.default_rng(0)) is HUT


BAD = {
    "misspelt": ("ofice", "no generator 'ofice'; did you mean 'office'"),
    "unknown": (
        "warehouse",
        "no generator 'warehouse'; there are cave, maze, office, rooms, or a file",
    ),
    "case": ("Office", "no generator 'Office'; did you mean 'office'"),
    "empty": ("", "no generator ''"),
    "no-name": (":3", "no generator ''"),
    "open-bracket": ("office(rooms=6", "expected NAME"),
    "after-bracket": ("office(rooms=6)7", "expected NAME"),
    "nested": ("office((rooms=6))", "expected NAME"),
    "seed-word": ("office:abc", "seeds must be a whole number, FIRST-LAST or .*, got 'abc'"),
    "seed-empty": ("office:", "seeds must be .* got ''"),
    "seed-float": ("office:1.5", "seeds must be .* got '1.5'"),
    "seed-exponent": ("office:1e3", "seeds must be .* got '1e3'"),
    "seed-negative": ("office:-1", "seeds must be .* got '-1'"),
    "seed-backwards": ("office:3-1", "seeds must run upwards .* got '3-1'"),
    "seed-huge": ("office:9999999999999999999", "seeds must run upwards and to"),
    "seed-too-long": ("office:" + "9" * 5000, "seeds must be a whole number"),
    "seed-list": ("office:1,2", "seeds must be .* got '1,2'"),
    "parameter-misspelt": (
        "office(room=6)",
        "office has no parameter 'room'; did you mean 'rooms'",
    ),
    "parameter-unknown": ("maze(zzz=6)", "no parameter 'zzz'; there are size, resolution"),
    "parameter-twice": ("maze(size=7,size=9)", "size is given twice"),
    "parameter-bare": ("maze(7)", "parameter '7'; expected NAME=VALUE"),
    "parameter-empty": ("maze(size=)", "parameter 'size='; expected NAME=VALUE"),
    "parameter-comma": ("maze(size=7,)", "parameter ''; expected NAME=VALUE"),
    "parameter-float": ("maze(size=7.0)", "size must be a whole number, got '7.0'"),
    "parameter-word": ("maze(resolution=fine)", "resolution must be a number, got 'fine'"),
    "parameter-nan": ("maze(resolution=nan)", "resolution must be a number, got 'nan'"),
    "parameter-infinite": ("maze(resolution=1e999)", "maze resolution must be a number .* got inf"),
    "parameter-range": ("maze(size=8)", "size must be odd, got 8"),
    "none": (None, "map must be a string, a path or a map, got None"),
    "number": (3, "map must be a string, a path or a map, got 3"),
}


@pytest.mark.parametrize(("spec", "message"), BAD.values(), ids=BAD)
def test_refuses(spec, message):
    with pytest.raises(ConfigError, match=message) as refusal:
        MapSource.parse(spec)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("spec", ["nowhere/hut.yaml", "nowhere.png", "./office", Path("office")])
def test_refuses_files_that_are_not_there(spec):
    with pytest.raises(MapError, match=r"No such file|a map file ends in"):
        MapSource.parse(spec)


def test_refuses_a_negative_number():
    with pytest.raises(ConfigError, match="at least 0, got -1"):
        MapSource.parse("maze:*").number(-1)


def test_refuses_a_source_of_nothing():
    with pytest.raises(ConfigError, match="either a grid or a generator"):
        MapSource("nothing")
    with pytest.raises(ConfigError, match="range of seeds is empty"):
        MapSource("none", generator=Maze(), seeds=range(0))


def test_maps_are_drawn_evenly():
    source = MapSource.parse("maze(size=5):0-2")
    rng = np.random.default_rng(1)
    drawn = [source.draw(rng).name for _ in range(600)]
    for name in ("maze-0", "maze-1", "maze-2"):
        assert abs(drawn.count(name) - 200) < 4 * np.sqrt(600 * 2 / 9)
    assert any(one == other for one, other in pairwise(drawn))


def test_imports_nothing_heavy():
    heavy = {"gymnasium", "torch", "matplotlib", "pygame", "stable_baselines3"}
    imported = set()
    for path in Path(activeloc.maps.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                imported |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                imported.add(str(node.module).split(".")[0])
    assert "scipy" in imported
    assert imported.isdisjoint(heavy)
