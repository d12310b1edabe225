"""The replay as people see it: in a browser, where there is one."""

import re

import numpy as np
import pytest

from activeloc.envs.rendering import frames_of, write_mp4, write_page
from activeloc.envs.rendering.marks import BELIEF_COLOURS

FLOOR, DARK_FLOOR, WALL, UNKNOWN = (255, 255, 255), (23, 26, 32), (43, 50, 61), (201, 205, 210)


@pytest.fixture
def opened(chromium, tmp_path):
    """Opens recordings as a page; at the end the page must have had nothing to complain of."""
    contexts, complaints = [], []

    def open_page(recordings, after="", **settings):
        path = tmp_path / "replay.html"
        write_page(recordings, path)
        context = chromium.new_context(**{"viewport": {"width": 1200, "height": 900}, **settings})
        contexts.append(context)
        page = context.new_page()
        page.on("console", lambda said: said.type != "error" or complaints.append(said.text))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("request", lambda request: path.name in request.url or complaints.append(request))
        page.goto(path.as_uri() + after)
        page.locator("html[data-ready]").wait_for()
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert complaints == []


def move_to(page, step):
    page.locator("#scrubber").fill(str(step))


def readout(page):
    return page.locator(".entropy").all_text_contents()


def colours(page, places, which=0):
    """Of places of the map [m], as they are on the screen."""
    script = """([which, places]) => {
      const canvas = document.querySelectorAll(".pane canvas")[which];
      const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
      return places.map(([x, y]) => {
        const col = Math.floor((x + 3) / 20 * canvas.width);
        const row = Math.floor((14 - y) / 12 * canvas.height);
        const at = 4 * (row * canvas.width + col);
        return [...data.slice(at, at + 3)];
      });
    }"""
    return [tuple(pixel) for pixel in page.evaluate(script, [which, places])]


def colour(page, x, y):
    return colours(page, [(x, y)])[0]


def only(page, *layers):
    script = """(layers) => document.querySelectorAll("#layers input").forEach((box) => {
      if (box.checked !== layers.includes(box.id.slice(6))) box.click();
    })"""
    page.evaluate(script, layers)


def test_the_scrubber_shows_the_entropy_of_each_step(opened, recording_of):
    recordings = [recording_of("left", steps=6), recording_of("right", steps=3, seed=1)]
    page = opened(recordings)
    for step in (0, 2, 6, 3):
        move_to(page, step)
        expected = []
        for recording in recordings:
            s = min(step, len(recording) - 1)
            nats, share = recording.entropy[s], 100 * recording.entropy_fraction[s]
            expected.append(f"{nats:.2f} nat ({share:.0f} %)")
        assert readout(page) == expected
        assert page.locator("#at").text_content() == f"step {step} of 6"
        cursor = float(page.locator(".cursor").get_attribute("x1"))
        dots = [float(dot.get_attribute("cx")) for dot in page.locator("#curve circle").all()]
        assert dots[0] == pytest.approx(cursor)
        assert (dots[1] == pytest.approx(cursor)) == (step <= 3)
    assert page.locator(".pane dl").last.text_content().endswith("Actiondrive 3")
    move_to(page, 4)
    assert page.locator(".pane dl").last.text_content().endswith("Actionended")


def test_the_belief_lies_where_it_is(opened, recording_of):
    recording = recording_of(steps=5)
    page = opened([recording])
    only(page, "belief")
    for step in (0, 3):
        move_to(page, step)
        row, col = np.argwhere(recording.shades[step])[0]
        left, bottom = recording.origin
        x, y = (
            left + (col + 0.5) * recording.resolution,
            bottom + (row + 0.5) * recording.resolution,
        )
        assert (x, y) == (12.25 + 0.5 * step, 4.25)
        others = [(x + 1.0, y), (x, y + 1.0), (x, 16.0 - y), (14.0 - x, y)]
        here, *there = colours(page, [(x, y), *others])
        np.testing.assert_allclose(here, BELIEF_COLOURS[255], atol=3)
        assert set(there) == {FLOOR}
    assert colours(page, [(0.5, 12.5), (9.5, 7.25)]) == [WALL, UNKNOWN]
    only(page)
    assert colour(page, x, y) == FLOOR


def test_walls_of_large_cells_have_sharp_edges(opened, recording_of):
    page = opened([recording_of(steps=1)])
    only(page)
    # A wall of cells of 0.5 m ends at x = 1.5 m and y = 13 m.
    inside, outside = [(1.45, 12.5), (0.5, 12.95)], [(1.55, 12.5), (0.5, 13.05)]
    assert set(colours(page, inside)) == {WALL}
    assert set(colours(page, outside)) == {FLOOR}


def test_a_slice_shows_the_belief_of_its_heading(opened, recording_of):
    page = opened([recording_of(steps=5)])
    only(page, "belief")
    sectors = page.locator("input[name=sector]")
    assert [box.locator("..").text_content() for box in sectors.all()] == [
        "any", "0\u00b0", "90\u00b0", "180\u00b0", "270\u00b0",
    ]  # fmt: skip
    move_to(page, 2)  # All of it is in the third of eight bins: it points down and to the right.
    seen = {}
    for box in sectors.all()[1:]:
        box.check()
        page.wait_for_timeout(50)  # The first time, the slices are unpacked.
        seen[box.locator("..").text_content()] = colour(page, 13.25, 4.25) != FLOOR
    assert seen == {"0\u00b0": False, "90\u00b0": False, "180\u00b0": False, "270\u00b0": True}
    sectors.first.check()
    assert colour(page, 13.25, 4.25) != FLOOR


def test_layers_can_be_switched(opened, recording_of):
    page = opened([recording_of(steps=2)])
    only(page)
    move_to(page, 2)
    places = {
        "truth": (2.0, 4.0),
        "scan": (2.6, 3.81),
        "path": (1.5, 4.0),
        "estimate": (13.25, 4.25),
    }
    for layer, (x, y) in places.items():
        reach = 0.8 if layer == "estimate" else 0.1
        nearby = [(x, y + dy) for dy in np.linspace(-reach, reach, 17).tolist()]
        only(page)
        assert set(colours(page, nearby)) == {FLOOR}
        only(page, layer)
        assert set(colours(page, nearby)) != {FLOOR}


def test_particles_have_a_layer_where_there_are_any(opened, recording_of):
    assert opened([recording_of()]).locator("#layer-particles").count() == 0
    page = opened([recording_of(particles=True)])
    only(page, "particles")
    # They were drawn between 0 and 1 m; the map begins at y = 2 m, so they lie along its edge.
    along = np.linspace(0.0, 1.0, 60).tolist()
    assert set(colours(page, [(x, 2.01) for x in along])) != {FLOOR}
    assert set(colours(page, [(x, 2.3) for x in along])) == {FLOOR}


def test_keys_and_a_deep_link(opened, recording_of):
    page = opened([recording_of(steps=6)], after="#step=4")
    at = page.locator("#at")
    assert at.text_content() == "step 4 of 6"
    for key, step in (
        ("ArrowRight", 5),
        ("ArrowLeft", 4),
        ("Home", 0),
        ("ArrowLeft", 0),
        ("End", 6),
    ):
        page.keyboard.press(key)
        assert at.text_content() == f"step {step} of 6"
    page.get_by_text("Step 6 of 6. left: drive 6; entropy 2.78 nat").wait_for(state="attached")
    assert page.locator("#scrubber").get_attribute("aria-valuetext") == "step 6 of 6"


def test_it_plays_to_the_end(opened, recording_of):
    page = opened([recording_of(steps=9)])
    play = page.locator("#play")
    page.locator("#speed").select_option("30")
    page.keyboard.press(" ")
    assert play.get_attribute("aria-label") == "Pause"
    page.get_by_text("step 9 of 9", exact=True).wait_for()
    assert play.get_attribute("aria-label") == "Play"


def test_it_plays_on_from_the_start_and_can_be_paused(opened, recording_of):
    page = opened([recording_of(steps=100)], after="#step=100")
    play, at = page.locator("#play"), page.locator("#at")
    page.locator("#speed").select_option("5")
    play.click()
    page.get_by_text(re.compile(r"^step [1-9]\d? of 100$")).wait_for()
    play.click()
    paused = at.text_content()
    page.wait_for_timeout(450)
    assert at.text_content() == paused
    assert play.get_attribute("aria-label") == "Play"


def test_the_curve_is_a_way_to_a_step(opened, recording_of):
    page = opened([recording_of(steps=6)])
    box = page.locator("#curve").bounding_box()
    page.mouse.click(box["x"] + 46 + (box["width"] - 58) * 4 / 6, box["y"] + 60)
    assert page.locator("#at").text_content() == "step 4 of 6"


def test_the_table_has_every_step(opened, recording_of):
    recordings = [recording_of("left", steps=6), recording_of("right", steps=3)]
    page = opened(recordings)
    page.locator("#table summary").click()
    rows = page.locator("#table tbody tr")
    rows.first.wait_for()
    assert rows.count() == 7 + 4
    assert rows.nth(3).text_content() == "1right4.63 nat (80 %)10 %11.25 m, 6\u00b0drive 1"


def test_light_and_dark(opened, recording_of):
    page = opened([recording_of()], color_scheme="dark")
    only(page)
    assert colour(page, 9.0, 12.0) == DARK_FLOOR
    page.locator("#theme").select_option("light")
    assert colour(page, 9.0, 12.0) == FLOOR
    page.emulate_media(color_scheme="light")
    page.locator("#theme").select_option("")
    assert colour(page, 9.0, 12.0) == FLOOR


def test_it_fits_a_phone(opened, recording_of):
    recordings = [recording_of("left"), recording_of("right")]
    page = opened(recordings, viewport={"width": 360, "height": 640}, is_mobile=True)
    assert page.evaluate("document.scrollingElement.scrollWidth") <= 360
    assert page.locator("#play").is_visible()
    assert page.locator("#play").bounding_box()["height"] >= 40
    assert page.locator(".bar").bounding_box()["height"] < 140


def test_axe_finds_nothing(opened, recording_of, axe_script):
    page = opened([recording_of("left", steps=2), recording_of("right", steps=2)])
    page.locator("#table summary").click()
    page.locator("#table tbody tr").first.wait_for()
    page.evaluate(axe_script)
    light = page.evaluate("axe.run()")
    page.locator("#theme").select_option("dark")
    dark = page.evaluate("axe.run({runOnly: ['color-contrast']})")
    assert len(light["passes"]) > 30
    found = light["violations"] + dark["violations"]
    assert [(rule["id"], rule["nodes"][0]["html"]) for rule in found] == []


def test_an_mp4_plays(chromium, recording_of, tmp_path):
    pytest.importorskip("imageio_ffmpeg", reason="imageio-ffmpeg is not installed")
    write_mp4(frames_of([recording_of(steps=4)], 300), tmp_path / "film.mp4", fps=10.0)
    page = chromium.new_page()
    page.goto((tmp_path / "film.mp4").as_uri())
    film = page.locator("video")
    film.evaluate("""film => new Promise((done, fail) => {
      film.onerror = () => fail(film.error);
      film.muted = true;
      film.onended = done;
      film.play();
    })""")
    size = film.evaluate("film => [film.videoWidth, film.videoHeight, film.duration]")
    height, width, _ = next(frames_of([recording_of()], 300)).shape
    assert size == [width, height, pytest.approx(2.5)]
    page.close()
