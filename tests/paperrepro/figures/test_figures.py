"""Files hold what the pictures show; notebooks keep to their form."""

import ast
import base64
import json
import re
from io import BytesIO
from itertools import combinations, pairwise
from pathlib import Path

import matplotlib.colors
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

from paperrepro import figures
from paperrepro.figures import accuracy, calibration, flight, refinement, roofs, survey
from paperrepro.method.accuracy import Distribution, ground_spread, ring_spread
from paperrepro.method.georeference import georeference
from paperrepro.paper.published import TABLE1
from paperrepro.study.rows import ADJUSTED
from paperrepro.survey import Mounting, Rays

NOTEBOOKS = sorted((Path(__file__).resolve().parents[3] / "notebooks").glob("[0-9][0-9]_*.ipynb"))


@pytest.fixture(autouse=True)
def _style():
    with plt.rc_context():
        plt.switch_backend("agg")
        figures.use_style()
        yield
        plt.close("all")


@pytest.fixture
def ax():
    return figures.canvas("single", 60)[1]


def _bars():
    return pd.DataFrame({"scenario": ["before", "SL", "A"], "rmse_m": [0.38, 0.041, 0.052]})


def _offsets(rng):
    return pd.DataFrame(
        {
            "scenario": np.repeat(["before", "SL", "A"], 9),
            "stage": np.repeat(["", "calibration", "calibration"], 9),
            "offset_m": rng.normal(0, 0.1, 27),
        }
    )


# Files


def test_save_writes_png_svg_and_the_values(tmp_path, ax):
    accuracy.rmse_bars(ax, _bars(), 0.04)
    paths = figures.save(ax.figure, tmp_path, "fig07", _bars())
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "fig07.csv",
        "fig07.png",
        "fig07.svg",
    ]
    assert [path.suffix for path in paths] == [".png", ".svg", ".csv"]
    assert paths[0].read_bytes().startswith(b"\x89PNG")
    pd.testing.assert_frame_equal(pd.read_csv(paths[2]), _bars())


def test_save_without_a_folder_writes_nothing(tmp_path, ax, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert figures.save(ax.figure, "", "fig07", _bars()) == []
    assert list(tmp_path.iterdir()) == []


def test_save_that_fails_leaves_what_was_there(tmp_path, ax):
    figures.save(ax.figure, tmp_path, "fig07", _bars())
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    ax.set_title("another")

    class Unwritable:
        def to_csv(self, *args, **kwargs):
            raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        figures.save(ax.figure, tmp_path, "fig07", Unwritable())
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_the_same_figure_gives_the_same_bytes(tmp_path):
    for folder in ("one", "other"):
        figure, ax = figures.canvas("single", 60)
        accuracy.offset_strips(ax, _offsets(np.random.default_rng(0)), {"bound": 0.3})
        figures.save(figure, tmp_path / folder, "fig11")
    for path in (tmp_path / "one").iterdir():
        assert path.read_bytes() == (tmp_path / "other" / path.name).read_bytes()


# Colours and sizes


def test_scenarios_and_strips_have_colours_of_their_own():
    names = {"before", "SL", "A", "B", "C", "D", ADJUSTED, "truth"}
    assert set(figures.SCENARIO_COLOURS) == names
    assert set(figures.STRIP_COLOURS) == {strip for pair in TABLE1 for strip in pair}
    for colours in (figures.SCENARIO_COLOURS, figures.STRIP_COLOURS):
        rgb = [np.array(matplotlib.colors.to_rgb(colour)) for colour in colours.values()]
        assert min(np.abs(a - b).max() for a, b in combinations(rgb, 2)) > 0.15


@pytest.mark.parametrize(("width", "inches"), [("single", 88 / 25.4), ("double", 180 / 25.4)])
def test_canvas_has_a_journal_s_width(width, inches):
    figure, _ = figures.canvas(width, 50)
    np.testing.assert_allclose(figure.get_size_inches(), (inches, 50 / 25.4))


def test_thinned_points_are_few_the_same_and_in_order():
    points = np.arange(1000).reshape(-1, 1)
    few = figures.thinned(points, 100)
    assert len(few) == 100
    assert (np.diff(few[:, 0]) > 0).all()
    np.testing.assert_array_equal(few, figures.thinned(points, 100))
    assert figures.thinned(points, 1000) is points
    assert figures.thinned(pd.DataFrame(points), 100)[0].tolist() == few[:, 0].tolist()


# What is drawn is what is handed in


def test_fig07_bars_are_the_rmse_in_centimetres(ax):
    accuracy.rmse_bars(ax, _bars(), 0.04)
    np.testing.assert_allclose([bar.get_height() for bar in ax.patches], 100 * _bars().rmse_m)
    faces = [matplotlib.colors.to_hex(bar.get_facecolor()) for bar in ax.patches]
    assert faces == [figures.SCENARIO_COLOURS[name] for name in _bars().scenario]
    assert ax.lines[0].get_ydata()[0] == pytest.approx(4.0)


def test_fig08_histogram_is_a_density_with_its_normal_curve(ax):
    distances = np.random.default_rng(0).normal(0.02, 0.04, 200_000)
    table = accuracy.histogram_table({"B": distances}, limit_m=0.3, width_m=0.01)
    assert (table.density * (table.right_m - table.left_m)).sum() == pytest.approx(1.0)
    assert np.abs(table.density - table.normal).max() < 0.05 * table.normal.max()
    shape = Distribution.of(distances)
    accuracy.histogram(ax, table, "B", shape)
    steps = ax.patches[0].get_data()
    np.testing.assert_allclose(steps.values, table.density / 100)
    np.testing.assert_allclose(steps.edges[:-1], 100 * table.left_m)
    x, normal = ax.lines[0].get_data()
    assert x[np.argmax(normal)] == pytest.approx(100 * shape.mean, abs=0.1)
    assert np.trapezoid(normal, x) == pytest.approx(1.0)


def test_fig08_bars_span_the_means_of_other_surveys_and_no_panel_is_cut():
    distances = {"before": 0.4, "B": 0.04, "C": 0.02}
    rng = np.random.default_rng(0)
    distances = {name: rng.normal(0.03, sigma, 50_000) for name, sigma in distances.items()}
    table = accuracy.histogram_table(distances, limit_m=0.3, width_m=0.01)
    shapes = {name: Distribution.of(values) for name, values in distances.items()}
    _, axes = figures.canvas("double", 60, nrows=1, ncols=3, squeeze=False)
    accuracy.histograms(axes, table, shapes, {"C": (-0.05, 0.08)})
    bars = [line for ax in axes.ravel() for line in ax.lines if line.get_linewidth() == 2.0]
    assert [bar.axes for bar in bars] == [axes[0, 2]]
    np.testing.assert_allclose(bars[0].get_xdata(), (-5.0, 8.0))
    assert axes[0, 1].get_ylim()[1] > table.density[table.scenario == "C"].max() / 100
    assert axes[0, 1].get_ylim() == axes[0, 2].get_ylim()


def test_histogram_s_bins_are_whole_and_symmetric():
    table = accuracy.histogram_table({"B": np.arange(3.0)}, limit_m=0.3, width_m=0.01)
    assert len(table) == 60
    assert table.left_m.iloc[0] == pytest.approx(-table.right_m.iloc[-1])


def test_fig11_dots_are_absolute_offsets_and_bars_their_means(ax):
    table = _offsets(np.random.default_rng(0))
    accuracy.offset_strips(ax, table, {"bound": 0.3})
    dots = np.concatenate([line.get_ydata() for line in ax.lines if line.get_marker() == "o"])
    np.testing.assert_allclose(dots, 100 * table.offset_m.abs())
    means = [line.get_ydata()[0] for line in ax.lines if line.get_linewidth() == 1.1]
    expected = table.offset_m.abs().groupby(table.scenario, sort=False).mean()
    np.testing.assert_allclose(means, 100 * expected)


def test_angle_errors_show_estimate_minus_truth(ax):
    table = pd.DataFrame(
        {"scenario": ["SL"] * 3, "angle": ["omega", "phi", "kappa"],
         "error_deg": [0.01, -0.02, 0.03], "sigma_deg": [0.001] * 3}
    )  # fmt: skip
    calibration.angle_errors(ax, table)
    dots = next(line for line in ax.lines if line.get_marker() == "o")
    np.testing.assert_allclose(dots.get_ydata().astype(float), table.error_deg)


def test_offset_table_removes_each_set_s_mean():
    offsets = np.linspace(-0.02, 0.03, 16)
    table = calibration.offset_table(offsets, {"B": (offsets + 0.05, np.full(16, 0.001))})
    wide = table.pivot(index="ring", columns="scenario")
    np.testing.assert_allclose(wide.offset_m.B - wide.offset_m.truth, 0.05)
    np.testing.assert_allclose(wide.centred_m.B, wide.centred_m.truth, atol=1e-15)


def test_match_matrix_prints_counts_above_and_false_ones_below(ax):
    names = ["F1", "F2"]
    counts = pd.DataFrame([[0, 7], [0, 0]], names, names)
    roofs.match_matrix(ax, counts, pd.DataFrame([[0, 0], [3, 0]], names, names))
    assert {(text.get_position(), text.get_text()) for text in ax.texts} == {
        ((1, 0), "7"),
        ((0, 1), "3"),
    }


def test_ring_spread_is_between_the_means_of_rings():
    distance = np.array([0.0, 0.02, 0.10, 0.12])
    assert ring_spread(distance, np.array([0, 0, 1, 1])) == pytest.approx(0.10)


def test_section_of_a_ridge_meets_both_planes():
    slope = np.radians(25)
    left = np.array([-np.sin(slope), 0, np.cos(slope), 5.0])
    right = np.array([np.sin(slope), 0, np.cos(slope), 5.0])
    section = refinement.Section.of_ridge(left, right, np.array([1.0, 7.0, 0.0]))
    np.testing.assert_allclose(section.origin, [0, 7, 5 / np.cos(slope)], atol=1e-12)
    line = section.gable_line(np.array([left, right]), 4.0)
    fall = 4 * np.tan(slope)
    np.testing.assert_allclose(line[:, 1] - section.origin[2], [-fall, 0, -fall], atol=1e-12)
    table = section.table(
        {"C": np.array([[1.0, 7.2, 3.0], [1.0, 9.0, 3.0]])}, np.array(["F1", "F2"]), 0.5
    )
    assert table.strip.tolist() == ["F1"]
    assert abs(table.across_m[0]) == pytest.approx(1.0)


def test_density_counts_points_per_square_metre():
    across = {"F1": np.random.default_rng(0).uniform(-60, 60, 12_000)}
    table = survey.density_table(across, length_m=10.0)
    assert table.density.mean() == pytest.approx(10.0)


# A profile that moves


def _moving(rng):
    """Points straight below a scanner that flies level, each on a level plane of its own."""
    n, mounting = 400, Mounting(lever_arm=np.zeros(3))
    pose = np.zeros((n, 6))
    pose[:, 2] = 30.0
    azimuth = rng.uniform(-0.2, 0.2, n) + np.pi / 2
    rays = Rays(pose, np.zeros(n, int), azimuth, np.zeros(n), np.full(n, 25.0))
    p_m = georeference(rays, mounting)
    planes = np.column_stack([np.zeros((n, 2)), np.ones(n), p_m[:, 2]])
    section = refinement.Section(np.zeros(3), np.array([0, 1.0, 0]), np.array([1.0, 0, 0]))
    line = np.array([[-3.0, 4.0], [0.0, 5.0], [3.0, 4.0]])
    return refinement.MovingProfile(rays, np.full(n, "F1"), planes, mounting, section, line, 50.0)


def test_moving_profile_has_no_rmse_where_it_should_lie():
    moving = _moving(np.random.default_rng(0))
    rmse = {angles: moving.rmse(moving.points(angles)) for angles in np.ndindex(2, 1, 2)}
    assert rmse[0, 0, 0] == pytest.approx(0, abs=1e-12)
    assert rmse[0, 0, 1] < rmse[1, 0, 0]


def test_a_slider_redraws_the_picture():
    moving = _moving(np.random.default_rng(0))
    box = refinement.Sliders(moving, [0.0, 0.0, 0.0])
    *sliders, picture = box.children
    before = bytes(picture.value)
    sliders[0].value = 0.5
    after, anew = picture.value, refinement.Sliders(moving, [0.5, 0.0, 0.0], 1.0).children[-1]
    assert after == anew.value != before
    sliders[0].value = 0.0
    assert picture.value == before
    assert not plt.get_fignums()


def test_sliders_are_a_picture_where_nothing_runs():
    box = refinement.Sliders(_moving(np.random.default_rng(0)), [0.0, 0.0, 0.0])
    shown, about = box._repr_mimebundle_()
    pixels = plt.imread(BytesIO(base64.b64decode(shown["image/png"])))
    assert pixels.shape[1] == 2 * about["image/png"]["width"]
    assert "VBox" not in shown["text/plain"]


def test_a_difference_image_has_the_mean_of_each_cell(ax):
    """East to the right, north up, and nothing where no point is."""
    p_m = np.array([[0.0, 0.0, 5.0], [0.5, 0.5, 5.0], [2.5, 0.5, 5.0], [0.5, 1.5, 5.0]])
    image = flight.difference_image(ax, p_m, np.array([0.01, 0.03, -0.05, 0.07]), 0.1)
    values = np.ma.filled(image.get_array(), np.nan)
    np.testing.assert_allclose(values[:2, :3], [[2, np.nan, -5], [7, np.nan, np.nan]])
    assert image.origin == "lower"
    assert image.get_extent()[0] == image.get_extent()[2] == 0.0
    assert image.get_clim() == (-10.0, 10.0)


def test_ground_spread_is_that_within_cells():
    rng = np.random.default_rng(0)
    p_m = np.column_stack([rng.uniform(0, 10, (20_000, 2)), rng.normal(0, 0.05, 20_000)])
    p_m[:, 2] += 3.0 * np.floor(p_m[:, 0])
    assert ground_spread(p_m) == pytest.approx(0.05, rel=0.03)


# The notebooks' form


@pytest.fixture(params=NOTEBOOKS, ids=lambda path: path.stem)
def notebook(request):
    return json.loads(request.param.read_text(encoding="utf-8"))


def _code(notebook):
    return [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]


def _outputs(notebook):
    return [output for cell in _code(notebook) for output in cell["outputs"]]


def test_there_is_a_start_and_notebooks_one_to_seven():
    assert [path.name[:2] for path in NOTEBOOKS][:8] == [f"0{k}" for k in range(8)]


def test_notebook_runs_on_the_kernel_everybody_has(notebook):
    assert notebook["metadata"]["kernelspec"]["name"] == "python3"


def test_first_code_cell_holds_annotated_plain_parameters(notebook):
    first = _code(notebook)[0]
    assert first["metadata"]["tags"] == ["parameters"]
    known = {}
    for line in "".join(first["source"]).splitlines():
        name, kind, value = re.fullmatch(r"(\w+): (\w+) = (\S+)(?:  # .+)?", line).groups()
        known[name] = (kind, value)
    assert {"preset", "profile", "seed", "noise_scale"} <= set(known)
    assert known["figures_dir"] == ("str", '""')
    assert known["profile"] == ("str", '"quick"')


def test_second_code_cell_refuses_parameters_that_the_first_has_not(notebook):
    assert "require_declared(globals())" in "".join(_code(notebook)[1]["source"])


def test_notebook_is_thin(notebook):
    source = ["".join(cell["source"]) for cell in _code(notebook)]
    assert len(source) <= 11
    assert not any(re.search(r"^\s*(def|class|import matplotlib)\b", code, re.M) for code in source)
    assert not any("matplotlib.use" in code or "MPLBACKEND" in code for code in source)


def test_notebook_imports_the_front_door_the_pictures_and_the_simulator(notebook):
    """Deeper things are reached through ``pr``."""
    tree = ast.parse("\n".join("".join(cell["source"]) for cell in _code(notebook)))
    of_ours = ("paperrepro", "data_synth")
    found = {(node.module, alias.name) for node in ast.walk(tree)
             if isinstance(node, ast.ImportFrom) for alias in node.names}  # fmt: skip
    found = {(module, name) for module, name in found if module.split(".")[0] in of_ours}
    plain = {(alias.name, alias.asname) for node in ast.walk(tree) if isinstance(node, ast.Import)
             for alias in node.names if alias.name.split(".")[0] in of_ours}  # fmt: skip
    assert plain <= {("paperrepro", "pr")}
    assert {module for module, _ in found if module.startswith("paperrepro.")} <= {
        "paperrepro.figures"
    }
    assert {name for module, name in found if module == "paperrepro"} <= {"figures"}


def test_text_stands_before_every_picture(notebook):
    for before, cell in pairwise(notebook["cells"]):
        if cell["cell_type"] == "code" and "figures.canvas" in "".join(cell["source"]):
            assert before["cell_type"] == "markdown"


def test_notebook_is_executed_without_error_warning_or_noise(notebook):
    assert all(cell["execution_count"] for cell in _code(notebook))
    assert not any(output["output_type"] == "error" for output in _outputs(notebook))
    assert not any(output.get("name") == "stderr" for output in _outputs(notebook))


def test_outputs_name_no_path_of_a_machine(notebook):
    shown = [
        "".join(text)
        for output in _outputs(notebook)
        for kind, text in {**output.get("data", {}), "text": output.get("text", "")}.items()
        if not kind.startswith("image/")
    ]
    assert not re.search(r"/(work|root|tmp|home|usr)/", " ".join(shown))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_is_small(path):
    assert path.stat().st_size < 520_000
