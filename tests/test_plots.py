import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

from activeloc import plots
from activeloc.errors import ConfigError
from activeloc.plots import curves, mean_with_band, plot_entropy_curves, runs

pytest.importorskip("matplotlib")
CURVES = {
    "spin": np.array([[1.0, 0.8, 0.6, 0.4], [1.0, 0.4, np.nan, np.nan]]),
    "greedy": np.array([[1.0, 0.5, 0.2, 0.1], [0.8, 0.3, 0.2, np.nan]]),
}


@pytest.fixture
def drawn(monkeypatch):
    """The figures, instead of the files."""
    figures = []
    for module in (curves, runs):
        monkeypatch.setattr(module, "save", lambda figure, path: figures.append(figure))
    return figures


def test_lines_are_means_and_an_ended_episode_keeps_its_last_value(drawn):
    plot_entropy_curves(CURVES, "unused.png")
    (axes,) = drawn[0].axes
    spin, greedy = axes.get_lines()
    np.testing.assert_array_equal(spin.get_xdata(), [0, 1, 2, 3])
    np.testing.assert_allclose(spin.get_ydata(), [1.0, 0.6, 0.5, 0.4])
    np.testing.assert_allclose(greedy.get_ydata(), [0.9, 0.4, 0.2, 0.15])
    assert [spin.get_color(), greedy.get_color()] == list(plots.OKABE_ITO[:2])
    assert axes.get_xlabel() == "step"
    assert "fraction of the uniform" in axes.get_ylabel()


def test_labels_stand_at_their_lines_ends(drawn):
    plot_entropy_curves(CURVES, "unused.png")
    (axes,) = drawn[0].axes
    for line, label in zip(axes.get_lines(), axes.texts, strict=True):
        assert label.get_color() == line.get_color()
        assert label.xy[1] * axes.get_ylim()[1] == pytest.approx(line.get_ydata()[-1])
    assert [label.get_text() for label in axes.texts] == ["spin (n = 2)", "greedy (n = 2)"]


def test_the_share_right_has_a_panel_and_the_agents_keep_their_colours(drawn):
    right = {"greedy": np.array([0.0, 0.0, 0.5, 1.0]), "spin": np.array([[0, 0, 1, 1], [0] * 4])}
    plot_entropy_curves(CURVES, "unused.png", right)
    left, second = drawn[0].axes
    greedy, spin = second.get_lines()
    np.testing.assert_allclose(greedy.get_ydata(), [0.0, 0.0, 0.5, 1.0])
    np.testing.assert_allclose(spin.get_ydata(), [0.0, 0.0, 0.5, 0.5])
    assert [spin.get_color(), greedy.get_color()] == [x.get_color() for x in left.get_lines()]
    assert spin.get_color() == plots.OKABE_ITO[0]


def test_agents_beyond_the_colours_differ_by_stroke(drawn):
    plot_entropy_curves({f"agent {i}": np.ones((2, 3)) for i in range(9)}, "unused.png")
    looks = {(line.get_color(), line.get_linestyle()) for line in drawn[0].axes[0].get_lines()}
    assert len(looks) == 9


def test_the_band_is_the_means_interval():
    episodes = np.random.default_rng(0).normal(0.5, 0.1, (400, 3))
    mean, low, high = mean_with_band(episodes)
    np.testing.assert_allclose(mean, episodes.mean(axis=0))
    expected = 1.96 * episodes.std(axis=0) / np.sqrt(400)
    np.testing.assert_allclose(mean - low, expected, rtol=0.1)
    np.testing.assert_allclose(high - mean, expected, rtol=0.1)
    narrower = mean_with_band(episodes, coverage=0.5)
    np.testing.assert_allclose(narrower[2] - mean, expected * 0.6745 / 1.96, rtol=0.15)


def test_the_band_of_equal_episodes_is_their_line():
    mean, low, high = mean_with_band(np.tile([1.0, 0.3, 0.1], (5, 1)))
    np.testing.assert_allclose([low, high], [mean, mean])


def test_the_band_is_the_same_each_time():
    episodes = np.random.default_rng(1).random((10, 4))
    np.testing.assert_array_equal(mean_with_band(episodes), mean_with_band(episodes))


@pytest.mark.parametrize("seed", range(20))
def test_labels_are_moved_apart_in_order_and_no_further_than_needed(seed):
    rng = np.random.default_rng(seed)
    heights = rng.choice([0.0, 0.02, 0.5, 0.9], 6) + rng.uniform(0, 0.05, 6)
    placed = curves._apart(heights, 0.06)
    order = np.argsort(heights)
    assert np.diff(placed[order]).min() >= 0.06 - 1e-12
    assert placed.min() >= 0.0
    far = np.array([0.1, 0.9, 0.5])
    np.testing.assert_allclose(curves._apart(far, 0.06), far)
    np.testing.assert_allclose(curves._apart(np.array([0.5, 0.5]), 0.06), [0.47, 0.53])


def test_writes_a_png_and_nothing_else(tmp_path):
    before = {agent: values.copy() for agent, values in CURVES.items()}
    plot_entropy_curves(CURVES, tmp_path / "one.png")
    plot_entropy_curves(CURVES, tmp_path / "two.png", {"spin": np.array([0.0, 1.0])})
    with Image.open(tmp_path / "one.png") as one, Image.open(tmp_path / "two.png") as two:
        assert one.size == (960, 630)  # 6.4 x 4.2 inches at 150 dpi
        assert two.size == (1920, 630)
        assert np.asarray(one.convert("L")).std() > 5
    assert sorted(file.name for file in tmp_path.iterdir()) == ["one.png", "two.png"]
    for agent, values in before.items():
        np.testing.assert_array_equal(CURVES[agent], values)


def test_a_figure_that_fails_leaves_the_old_one(tmp_path, monkeypatch):
    path = tmp_path / "curves.png"
    path.write_bytes(b"old")

    def fail(*_):
        raise OSError("disk")

    monkeypatch.setattr("activeloc.files.os.replace", fail)
    with pytest.raises(OSError, match="disk"):
        plot_entropy_curves(CURVES, path)
    assert path.read_bytes() == b"old"
    assert [file.name for file in tmp_path.iterdir()] == ["curves.png"]


def test_matplotlib_is_imported_late_and_pyplot_never(tmp_path):
    program = (
        "import sys, numpy as np; from activeloc import plots\n"
        "assert 'matplotlib' not in sys.modules\n"
        f"plots.plot_entropy_curves({{'a': np.ones((2, 3))}}, {str(tmp_path / 'a.png')!r})\n"
        "assert 'matplotlib.pyplot' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


@pytest.mark.parametrize(
    ("curves", "right", "message"),
    [
        ({}, None, "at least one agent"),
        ({"a": np.zeros((2, 3, 4))}, None, r"a: curves must be .*\(2, 3, 4\)"),
        ({"a": np.zeros((0, 4))}, None, "a: curves must be"),
        ({"a": np.array([[np.nan, 1.0]])}, None, "a: each curve must start with a number"),
        ({"a": np.array([[1.0, np.inf]])}, None, "no infinity"),
        ({"a": np.ones((1, 2))}, {"b": np.array([0.0, 1.2])}, r"b: shares must lie in \[0, 1\]"),
    ],
)
def test_refuses_what_is_no_curve(curves, right, message, tmp_path):
    with pytest.raises(ConfigError, match=message):
        plot_entropy_curves(curves, tmp_path / "curves.png", right)
    assert not list(tmp_path.iterdir())


def run_of(n=6):
    scans = np.array([3, 4, 5, 9, 10, 11])
    reference = np.column_stack([np.arange(n), np.zeros(n), np.zeros(n)]) + 0.5
    estimate = reference + np.array([0.1, 0.0, 0.0])
    right = np.array([True, True, False, True, True, True])
    return scans, estimate, reference, right


def test_paths_end_where_the_robot_was_carried_and_crosses_are_wrong_estimates(drawn):
    scans, estimate, reference, right = run_of()
    cells = np.zeros((2, 7), dtype=np.uint8)
    plots.plot_paths(cells, (0, 7, 0, 2), scans, estimate, reference, right, "unused.png")
    (axes,) = drawn[0].axes
    lines = {line.get_label(): line for line in axes.get_lines()}
    np.testing.assert_allclose(
        lines["reference"].get_xdata(), [0.5, 1.5, 2.5, np.nan, 3.5, 4.5, 5.5]
    )
    np.testing.assert_allclose(
        lines["estimate"].get_xdata(), [0.6, 1.6, np.nan, np.nan, 3.6, 4.6, 5.6]
    )
    np.testing.assert_allclose(lines["wrong (1)"].get_xdata(), [2.6])
    np.testing.assert_allclose(lines["carried"].get_xdata(), [2.5, 3.5])
    np.testing.assert_allclose(lines["start"].get_xdata(), [0.5])
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x [m]", "y [m]")


def test_errors_have_a_panel_each_with_what_is_allowed(drawn):
    scans, *_ = run_of()
    errors = {"error [m]": (np.array([1.0, 0.1, 0.0, 0.2, 0.3, 0.4]), 0.5)}
    plots.plot_errors(scans, errors, np.arange(6.0), "unused.png")
    top, bottom = drawn[0].axes
    np.testing.assert_allclose(top.get_lines()[0].get_xdata(), [3, 4, 5, np.nan, 9, 10, 11])
    np.testing.assert_allclose(
        top.get_lines()[0].get_ydata(), [1.0, 0.1, 0.005, np.nan, 0.2, 0.3, 0.4]
    )
    assert top.get_lines()[1].get_ydata()[0] == 0.5
    assert (top.get_ylabel(), bottom.get_ylabel()) == ("error [m]", "entropy [nat]")
    assert bottom.get_xlabel() == "scan"


def test_runs_that_do_not_fit_together_are_refused(tmp_path):
    scans, estimate, reference, right = run_of()
    cells = np.zeros((2, 7), dtype=np.uint8)
    with pytest.raises(ConfigError, match="of the length of the scans"):
        plots.plot_paths(
            cells, (0, 7, 0, 2), scans, estimate[1:], reference, right, tmp_path / "a.png"
        )
    with pytest.raises(ConfigError, match="errors and entropy must be"):
        plots.plot_errors(scans, {"e": (np.zeros(5), 1.0)}, np.zeros(6), tmp_path / "a.png")
    assert not list(tmp_path.iterdir())
