"""What holds of every generator, and what of the buildings only."""

from dataclasses import FrozenInstanceError, fields
from functools import cache

import numpy as np
import pytest
from scipy import ndimage

from activeloc.errors import ConfigError
from activeloc.grid import OccupancyGrid
from activeloc.maps import GENERATORS, cave, office, rooms
from activeloc.maps.cave import Cave
from activeloc.maps.office import Office
from activeloc.maps.parameters import is_symmetric
from activeloc.maps.rooms import Rooms

SEEDS = range(6)
BUILDINGS = [
    pytest.param(Office(), id="office"),
    pytest.param(
        Office(corridors=1, rooms=3, door=0.6, changes=2, resolution=0.1), id="one-corridor"
    ),
    pytest.param(Office(corridors=3, rooms=4, corridor=1.0, changes=12), id="three-corridors"),
    pytest.param(Office(room_width=2.4, room_depth=2.4, wall=0.1, changes=19), id="small-offices"),
    pytest.param(Rooms(), id="rooms"),
    pytest.param(Rooms(smallest=1.6, door=0.6, furniture=9, resolution=0.1), id="small-rooms"),
    pytest.param(Rooms(width=5.0, height=14.0, p_second_door=1.0), id="tall-home"),
    pytest.param(Cave(), id="cave"),
    pytest.param(Cave(width=9.0, height=14.0, rounds=1, resolution=0.1), id="rough-cave"),
]


@cache
def draw(generator, seed):
    return generator.generate(np.random.default_rng(seed))


@pytest.mark.parametrize("name", GENERATORS)
def test_a_seed_gives_one_map_and_another_seed_another(name):
    generator = GENERATORS[name]()
    maps = [draw(generator, seed) for seed in SEEDS]
    assert maps == [generator.generate(np.random.default_rng(seed)) for seed in SEEDS]
    assert len({grid.digest for grid in maps}) == len(maps)
    assert maps[0].name == name


@pytest.mark.parametrize("name", GENERATORS)
def test_draws_follow_each_other_in_one_stream(name):
    rng = np.random.default_rng(5)
    assert GENERATORS[name]().generate(rng) != GENERATORS[name]().generate(rng)


@pytest.mark.parametrize("name", GENERATORS)
def test_is_frozen_and_equal_by_parameters(name):
    generator = GENERATORS[name]()
    assert generator == GENERATORS[name]()
    assert hash(generator) == hash(GENERATORS[name]())
    with pytest.raises(FrozenInstanceError):
        generator.resolution = 1.0


@pytest.mark.parametrize("generator", BUILDINGS)
def test_a_robot_gets_everywhere_it_fits(generator):
    for seed in SEEDS:
        grid = draw(generator, seed)
        fits = grid.clearance >= 0.2
        np.testing.assert_array_equal(grid.passable(0.2), fits)
        # It sweeps nearly all of the floor: no room is shut, though a slot may be too narrow.
        reached = ndimage.distance_transform_edt(~fits) * grid.resolution <= 0.3
        assert (reached & grid.free).sum() > 0.96 * grid.free.sum()


@pytest.mark.parametrize("generator", BUILDINGS)
def test_is_walled_in(generator):
    for seed in SEEDS:
        grid = draw(generator, seed)
        n = round(0.1 / grid.resolution)
        inside = grid.blocked.copy()
        inside[n:-n, n:-n] = True
        assert inside.all()


@pytest.mark.parametrize("generator", BUILDINGS[:-2])
def test_walls_are_a_tenth_of_a_metre_thick(generator):
    for seed in SEEDS:
        grid = draw(generator, seed)
        thick = np.ones((round(0.1 / grid.resolution),) * 2)
        blocked = np.pad(grid.blocked, 9, constant_values=True)
        np.testing.assert_array_equal(ndimage.binary_opening(blocked, thick), blocked)


@pytest.mark.parametrize("generator", BUILDINGS)
def test_is_unlike_its_rotation_and_its_mirror_images(generator):
    for seed in SEEDS:
        cells = draw(generator, seed).cells
        for twin in (cells[::-1], cells[:, ::-1], np.rot90(cells, 2)):
            assert not np.array_equal(cells, twin)


def test_symmetry_is_seen():
    plain = np.zeros((2, 3), np.uint8)
    assert is_symmetric(plain)
    assert is_symmetric(np.array([[0, 1, 0], [0, 0, 0]], np.uint8))
    assert is_symmetric(np.array([[0, 1, 1], [0, 1, 1]], np.uint8))
    assert is_symmetric(np.array([[0, 1, 1], [1, 1, 0]], np.uint8))
    assert not is_symmetric(np.array([[0, 1, 1], [0, 0, 0]], np.uint8))


@pytest.mark.parametrize(
    ("module", "generator", "name"),
    [
        pytest.param(office, Office(), "is_symmetric", id="office-symmetric"),
        pytest.param(office, Office(), "is_one_space", id="office-shut"),
        pytest.param(rooms, Rooms(), "is_symmetric", id="rooms-symmetric"),
        pytest.param(rooms, Rooms(), "is_one_space", id="rooms-shut"),
        pytest.param(cave, Cave(), "is_one_space", id="cave-shut"),
    ],
)
def test_a_building_that_will_not_do_is_drawn_again(monkeypatch, module, generator, name):
    rng = np.random.default_rng(0)
    generator.generate(rng)
    second = generator.generate(rng)
    verdicts = iter([name == "is_symmetric", name != "is_symmetric"])
    monkeypatch.setattr(module, name, lambda _: next(verdicts))
    assert generator.generate(np.random.default_rng(0)) == second


def passable_area(grid: OccupancyGrid) -> float:
    return float(grid.passable(0.2).sum()) * grid.resolution**2


def test_the_default_office_is_the_size_of_the_task():
    areas = [passable_area(draw(Office(), seed)) for seed in SEEDS]
    assert 250.0 < min(areas) <= max(areas) < 260.0


def test_office_is_alike_where_nothing_was_changed():
    """Of 7 x 3 rooms less two, most of the outer rows show the same floor in the same frame."""
    pitch, depth, wall = 71, 68, 3
    for seed in SEEDS:
        cells = draw(Office(changes=5), seed).cells
        floors = []
        for bottom, faces_up in ((wall, True), (cells.shape[0] - wall - depth, False)):
            # The room and the wall in front of it.
            rows = (
                slice(bottom, bottom + depth + wall)
                if faces_up
                else slice(bottom - wall, bottom + depth)
            )
            for column in range(7):
                left = wall + column * pitch
                room = cells[rows, left : left + 68]
                floors.append((room if faces_up else np.rot90(room, 2)).tobytes())
        commonest = max(floors.count(floor) for floor in floors)
        assert commonest >= 14 - 5 - 1
        assert commonest < 14


def test_each_change_changes_the_office():
    """With as many changes as kinds, each kind is used once; two offices then differ in number."""
    maps = [draw(Office(changes=n), 3) for n in (1, 2, 3, 4, 5)]
    assert len({grid.digest for grid in maps}) == 5


def test_office_doors_are_as_wide_as_asked():
    """In the wall in front of the lowest row, what is free is doors."""
    grid = draw(Office(door=1.0, corridors=1, changes=1), 0)
    front = grid.free[3 + 68 + 1]
    edges = np.flatnonzero(np.diff(front.astype(int)))
    widths = (edges[1::2] - edges[::2]) * grid.resolution
    assert len(widths) == 7
    np.testing.assert_allclose(widths, 1.0)


def test_cave_keeps_the_share_asked_for():
    for seed in SEEDS:
        assert draw(Cave(min_share=0.5), seed).free.mean() >= 0.5


def test_buildings_of_the_first_seed_stay_what_they_are():
    """A change here changes every result that names a building: say so in the changelog."""
    digests = {
        name: draw(GENERATORS[name](), 0).digest[:12] for name in ("maze", "office", "rooms")
    }
    assert digests == {"maze": "2b8494cdfe34", "office": "dcddddb37a15", "rooms": "5ee16203dd73"}


BAD = {
    "office-door-wider-than-room": (Office, {"door": 3.0}, "office: door must be at most .* 2.8 m"),
    "office-door-too-narrow": (Office, {"door": 0.3}, "office door must be a number in .* got 0.3"),
    "office-no-rooms": (Office, {"rooms": 0}, "office rooms must be an integer"),
    "office-rooms-float": (Office, {"rooms": 6.5}, "office rooms must be an integer .* got 6.5"),
    "office-rooms-bool": (Office, {"rooms": True}, "office rooms must be an integer .* got True"),
    "office-few-rooms": (Office, {"rooms": 3}, "rooms must be at least 4, got 3"),
    "office-thin-walls": (Office, {"wall": 0.05}, "office wall must be"),
    "office-nan": (Office, {"corridor": float("nan")}, "office corridor must be .* got nan"),
    "office-wide-links": (Office, {"corridor": 4.0}, "corridor must be at most room_width"),
    "office-no-changes": (Office, {"changes": 0}, "office changes must be"),
    "office-many-changes": (Office, {"changes": 20}, "number of rooms, 19, got 20"),
    "office-coarse": (Office, {"resolution": 0.5}, "office resolution must be"),
    "office-endless": (
        Office,
        {"rooms": 200, "corridors": 20, "resolution": 0.01},
        "cells; at most",
    ),
    "rooms-small": (Rooms, {"smallest": 1.0}, "rooms smallest must be"),
    "rooms-door": (Rooms, {"smallest": 1.5, "door": 1.2}, "rooms: door must be at most 1 m"),
    "rooms-narrow": (Rooms, {"height": 3.0, "smallest": 2.9}, "smallest must be at most 2.6 m"),
    "rooms-odds": (Rooms, {"p_second_door": 1.5}, "rooms p_second_door must be"),
    "rooms-furniture": (Rooms, {"furniture": -1}, "rooms furniture must be an integer"),
    "rooms-infinite": (Rooms, {"width": float("inf")}, "rooms width must be"),
    "rooms-text": (Rooms, {"width": "16"}, "rooms width must be .* got '16'"),
    "rooms-endless": (Rooms, {"width": 1e3, "height": 1e3, "resolution": 0.05}, "cells; at most"),
    "cave-rock": (Cave, {"rock": 0.9}, "cave rock must be"),
    "cave-rounds": (Cave, {"rounds": 1.0}, "cave rounds must be an integer"),
    "cave-grain": (Cave, {"grain": 0.1, "resolution": 0.1}, "grain must be at least twice"),
    "cave-endless": (Cave, {"width": 1e3, "height": 1e3}, "cells; at most"),
}


@pytest.mark.parametrize(("generator", "parameters", "message"), BAD.values(), ids=BAD)
def test_refuses(generator, parameters, message):
    with pytest.raises(ConfigError, match=message) as refusal:
        generator(**parameters)
    assert "\n" not in str(refusal.value)


def test_gives_up_where_no_draw_can_be_right():
    solid = Cave(width=4.0, height=4.0, rock=0.6, min_share=0.9)
    with pytest.raises(ConfigError, match=r"100 draws gave no cave with 0\.9 of the map free"):
        draw(solid, 0)


@pytest.mark.parametrize("name", GENERATORS)
def test_every_parameter_is_documented(name):
    generator = GENERATORS[name]
    assert [f.name for f in fields(generator) if f"    {f.name}: " not in generator.__doc__] == []
