"""``paperrepro calibrate`` from files to files: contents, exit codes, nothing half-written."""

import json
import re
import shutil
import tomllib
from dataclasses import replace

import laspy
import numpy as np
import pytest

from data_synth.operator import Site, write_survey
from data_synth.raycast import Raycaster
from data_synth.scene import ObjectClass
from paperrepro.cli import main
from paperrepro.flight.sbet import read_accuracy
from paperrepro.frames import boresight_matrix
from tests.paperrepro.labelled import NAVIGATION


@pytest.fixture(scope="module")
def folder(flown, tmp_path_factory):
    """Four strips of the simulated survey as an operator has them."""
    folder = tmp_path_factory.mktemp("flight")
    kept = [
        k for k, strip in enumerate(flown.survey.strips) if strip.name in ("F1", "F2", "F7", "F8")
    ]
    survey = replace(flown.survey, strips=tuple(flown.survey.strips[k] for k in kept))
    write_survey(folder, survey, flown.truth, Site(-25.75, -49.4, 900.0, None), 1e-4)
    return folder


def calibrate(folder, out, *more, strips=("F1", "F2", "F7", "F8")):
    return main(
        [
            "calibrate", *(str(folder / f"{name}.laz") for name in strips), "--trajectory",
            str(folder / "mission.sbet"), "--mounting", str(folder / "mounting.toml"),
            "--out", str(out), *more,
        ]
    )  # fmt: skip


@pytest.fixture(scope="module")
def done(folder, tmp_path_factory):
    out = tmp_path_factory.mktemp("done") / "calibrated"
    assert calibrate(folder, out, "--write-strips", "--write-trajectory") == 0
    return out


def test_the_truth_is_within_three_sigma(folder, done):
    truth = json.loads((folder / "truth.json").read_text())["boresight_deg"]
    found = json.loads((done / "calibration.json").read_text())
    for angle, value in truth.items():
        assert abs(found["boresight_deg"][angle] - value) < 3 * found["sigma_deg"][angle]
    variance = np.diag(found["covariance_deg2"])
    np.testing.assert_allclose(np.sqrt(variance), list(found["sigma_deg"].values()))


def test_the_result_holds_what_is_promised(done):
    found = json.loads((done / "calibration.json").read_text())
    assert found["scenario"] == "D"
    assert len(found["range_offsets_m"]) == 16
    assert found["rmse_after_m"] < 0.3 * found["rmse_before_m"]
    assert found["n_planes"] > 8
    assert found["n_points"] > 1000
    assert found["iterations"] >= 1
    assert 0.8 < found["sigma0"] < 1.2
    assert found["observability"]["rank"] == 3
    assert found["observability"]["condition"] > 1
    assert found["observability"]["weakest_direction"] in ("roll", "pitch", "yaw")
    assert len(found["strip_pairs"]) == 6
    after, adjusted = (
        np.mean([pair[f"rms_{when}_m"] for pair in found["strip_pairs"]])
        for when in ("after", "adjusted")
    )
    assert adjusted < after


def test_the_report_is_one_page_with_everything_on_it(done):
    page = (done / "report.html").read_text(encoding="utf-8")
    for heading in ("Observability", "Strips, trajectory, planes", "Distances between strips",
                    "Planes", "Correlations", "What was rejected"):  # fmt: skip
        assert f"<h2>{heading}</h2>" in page
    assert page.count('src="data:image/svg+xml') == 5
    assert page.count("<img") == page.count("alt=") == 5
    assert "http" not in page.replace("http://www.w3.org", "")
    assert "F1 – F2" in page
    views = page[page.index("<h3>Reliability</h3>") :]
    lines = views[: views.index("</table>")].split("<tr>")[2:]
    planes = json.loads((done / "calibration.json").read_text())["n_planes"]
    assert len(lines) == planes
    sizes = [float(re.findall(r'"number">(.*?)</td>', line)[1]) for line in lines]
    assert sizes == sorted(sizes, reverse=True)  # where a gross error hides best stands first
    assert "nan" not in page.lower().split("</style>")[1].split("data:image")[0]


def test_adjusted_strips_are_beside_them(done):
    names = sorted(path.name for path in done.iterdir())
    assert names == [
        "F1.laz", "F2.laz", "F7.laz", "F8.laz", "calibration.json", "report.html",
        "trajectory.sbet", "trajectory.smrmsg",
    ]  # fmt: skip


def test_the_adjusted_trajectory_has_rate_and_span_of_the_given_one(folder, done):
    found = json.loads((done / "calibration.json").read_text())
    files = [folder / "mission.sbet", done / found["trajectory"]["sbet"]]
    before, after = (np.fromfile(file, "<f8").reshape(-1, 17) for file in files)
    np.testing.assert_allclose(before[:, 0] - after[:, 0], found["clock"]["delay"], atol=1e-9)
    np.testing.assert_array_equal(before[:, [4, 5, 6, *range(10, 17)]],
                                  after[:, [4, 5, 6, *range(10, 17)]])  # fmt: skip
    moved = np.abs(after - before)
    assert 1e-3 < moved[:, 3].max() < 0.3
    assert 1e-5 < np.degrees(moved[:, 9]).max() < 0.5
    accuracy = np.fromfile(done / found["trajectory"]["accuracy"], "<f8").reshape(-1, 10)
    np.testing.assert_array_equal(accuracy[:, 0], after[:, 0])
    navigation = read_accuracy(done / found["trajectory"]["accuracy"], NAVIGATION, after[:, 0])
    assert (navigation.attitude_sigma < 2 * NAVIGATION.attitude_sigma).all()


def apply(folder, done, out, *more):
    strips = [str(folder / f"{name}.laz") for name in ("F1", "F2", "F7", "F8")]
    return main(
        [
            "apply", *strips, "--trajectory", str(folder / "mission.sbet"), "--mounting",
            str(folder / "mounting.toml"), "--calibration", str(done / "calibration.json"),
            "--out", str(out), *more,
        ]
    )  # fmt: skip


def test_apply_takes_mounting_and_trajectory_or_the_mounting_alone(folder, done, tmp_path):
    assert apply(folder, done, tmp_path / "both") == 0
    assert apply(folder, done, tmp_path / "alone", "--mounting-only") == 0
    written, both, alone = (laspy.read(d / "F2.laz").xyz for d in
                            (done, tmp_path / "both", tmp_path / "alone"))  # fmt: skip
    assert np.abs(both - written).max() < 3e-4  # of a coordinate's resolution
    assert 0.005 < np.linalg.norm(alone - written, axis=1).max() < 1.0


def test_a_second_calibration_finds_zero(folder, done, tmp_path):
    """On the adjusted strips, under the adjusted trajectory and the calibrated mounting."""
    found = json.loads((done / "calibration.json").read_text())
    given = tomllib.loads((folder / "mounting.toml").read_text())["nominal"]
    angles = np.radians([found["boresight_deg"][name] for name in ("omega", "phi", "kappa")])
    rotation = boresight_matrix(angles, np.array(given["rotation"], float))
    lines = f"rotation = {rotation.tolist()}\nlever_arm_m = {found['lever_arm_m']}\n"
    for name in ("F1", "F2", "F7", "F8"):
        shutil.copy(done / f"{name}.laz", tmp_path)
    shutil.copy(done / "trajectory.sbet", tmp_path / "mission.sbet")
    (tmp_path / "mounting.toml").write_text(f"[nominal]\n{lines}")
    assert calibrate(tmp_path, tmp_path / "again") == 0
    again = json.loads((tmp_path / "again/calibration.json").read_text())
    for angle, value in again["boresight_deg"].items():
        assert abs(value) < found["sigma_deg"][angle]
    assert np.abs(again["range_offsets_m"]).max() < 0.002
    assert abs(again["rmse_after_m"] - again["rmse_before_m"]) < 0.002


def test_an_adjusted_trajectory_of_another_flight_is_refused(folder, done, tmp_path, capfd):
    for name in ("calibration.json", "trajectory.sbet"):
        shutil.copy(done / name, tmp_path)
    table = np.fromfile(tmp_path / "trajectory.sbet", "<f8").reshape(-1, 17)
    table[:, 3] += 50.0
    table.tofile(tmp_path / "trajectory.sbet")
    assert apply(folder, tmp_path, tmp_path / "out") == 2
    assert "another flight" in capfd.readouterr().err


def test_scenario_a_has_no_range_offsets_and_sl_says_what_its_sigma_are(folder, tmp_path):
    assert calibrate(folder, tmp_path / "a", "--scenario", "A") == 0
    assert json.loads((tmp_path / "a/calibration.json").read_text())["range_offsets_m"] is None
    assert calibrate(folder, tmp_path / "sl", "--scenario", "SL") == 0
    assert "too small" in (tmp_path / "sl/report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("strips", "more", "said"),
    [
        (("F1",), (), "at least two"),
        (("F1", "F1"), (), "given twice"),
        (("F1", "F9"), (), "F9.laz: no such file"),
        (("F1", "F2"), ("--scenario", "SL", "--write-trajectory"), "needs scenario D"),
        (("F1", "F2"), ("--scenario", "E"), "scenario 'E': expected one of SL, A, B, C, D"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(folder, tmp_path, capfd, strips, more, said):
    assert calibrate(folder, tmp_path / "out", *more, strips=strips) == 2
    lines = capfd.readouterr().err.splitlines()
    assert len(lines) == 1
    assert said in lines[0]
    assert list(tmp_path.iterdir()) == []


def test_strips_are_not_overwritten(folder, capfd):
    before = (folder / "F1.laz").read_bytes()
    assert calibrate(folder, folder, "--write-strips") == 2
    assert "would be overwritten" in capfd.readouterr().err
    assert (folder / "F1.laz").read_bytes() == before


def test_too_few_planes_is_exit_one(folder, tmp_path, capfd, monkeypatch):
    monkeypatch.setattr("paperrepro.method.coarse_to_fine.MOST_PLANES", 2)
    assert calibrate(folder, tmp_path / "out", "--planes", "any") == 1
    assert "at least 4" in capfd.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.fixture(scope="module")
def points(folder, flown):
    """CSV of 12 points on the ground, from the reference cloud's own lines, and one far away."""
    site, scene = Site(-25.75, -49.4, 900.0, None), flown.truth.scene
    xy = np.random.default_rng(0).uniform(-1, 1, (60, 2)) * 40
    origin = np.column_stack([xy, np.full(60, 60.0)])
    distance, triangle = Raycaster(scene).cast(origin, np.tile([0.0, 0.0, -1.0], (60, 1)))
    on = np.flatnonzero(scene.triangle_class[triangle] == ObjectClass.GROUND)[:12]
    p_m = np.column_stack([xy, 60.0 - distance])[on]
    rows = [f"P{k},{x!r},{y!r},{z!r},0.01" for k, (x, y, z) in enumerate(site.mapped(p_m).tolist())]
    x, y, z = site.mapped(np.array([[2000.0, 0.0, 0.0]]))[0].tolist()
    path = folder / "points.csv"
    path.write_text("\n".join(["name,x,y,z,sigma", *rows, f"far,{x!r},{y!r},{z!r},0.01"]) + "\n")
    return path


@pytest.fixture(scope="module")
def checked(folder, points, tmp_path_factory):
    out = tmp_path_factory.mktemp("checked") / "calibrated"
    more = ["--checkpoints", str(points), "--control", str(points), "--write-trajectory"]
    assert calibrate(folder, out, *more) == 0
    return out


def test_heights_over_checkpoints_reach_file_and_report(checked):
    found = json.loads((checked / "calibration.json").read_text())
    heights = found["checkpoints"]
    assert heights["off_strips"] == ["far"]
    assert [point["name"] for point in heights["points"]] == [*(f"P{k}" for k in range(12)), "far"]
    for cloud in ("before", "mounting", "trajectory"):
        said, offsets = heights[cloud], [p[f"{cloud}_m"] for p in heights["points"]]
        offsets = np.array([offset for offset in offsets if offset is not None])
        assert said["n"] == len(offsets) >= 9
        assert said["mean_m"] == pytest.approx(offsets.mean())
        assert said["rmse_m"] == pytest.approx(np.sqrt(np.mean(offsets**2)))
        assert said["at_95_m"] == pytest.approx(1.96 * said["rmse_m"])
    # the same points are control: the adjusted cloud goes through them
    assert heights["trajectory"]["rmse_m"] < 0.015
    assert heights["trajectory"]["rmse_m"] < heights["before"]["rmse_m"]
    assert any(words.startswith("Control: Points not used") for words in found["remarks"])
    page = (checked / "report.html").read_text()
    assert 'id="checkpoints"' in page
    assert "off the strips" in page


def test_apply_says_the_same_of_its_checkpoints(folder, points, checked, tmp_path, capsys):
    capsys.readouterr()
    arguments = [
        "apply", *(str(folder / f"{name}.laz") for name in ("F1", "F2", "F7", "F8")),
        "--trajectory", str(folder / "mission.sbet"), "--mounting", str(folder / "mounting.toml"),
        "--calibration", str(checked / "calibration.json"), "--checkpoints", str(points),
    ]  # fmt: skip
    assert main([*arguments, "--out", str(tmp_path / "all")]) == 0
    said = capsys.readouterr().out
    heights = json.loads((checked / "calibration.json").read_text())["checkpoints"]
    for cloud in ("before", "mounting", "trajectory"):
        rmse = f"RMSE {100 * heights[cloud]['rmse_m']:.1f} cm"
        assert re.search(rf"{cloud} +n {heights[cloud]['n']}, .*{rmse}", said)
    assert main([*arguments, "--out", str(tmp_path / "some"), "--mounting-only"]) == 0
    assert "trajectory" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("text", "fact"),
    [
        (None, "no such file"),
        ("", "expected a table with a head line"),
        ("name,x,y,z\nA,1,2,3\n", "sigma missing"),
        ("name,x,y,z,sigma\n", "no row in it"),
        ("name,x,y,z,sigma\nA,1,2,high,0.01\n", "column z, row 1"),
        ("name,x,y,z,sigma\nA,1,2,3,0\n", "sigma of A: expected metres above 0"),
        ("name,x,y,z,sigma\nA,1,2,3,0.1\nA,1,2,3,0.1\n", "name 'A'"),
        ("name,x,y,z,sigma\nA,1e12,1e12,3,0.1\n", "--crs|lies outside"),
    ],
)
def test_points_that_cannot_be_read(folder, tmp_path, capsys, text, fact):
    path = tmp_path / "points.csv"
    if text is not None:
        path.write_text(text)
    assert calibrate(folder, tmp_path / "out", "--checkpoints", str(path)) == 2
    said = capsys.readouterr().err
    assert re.search(fact, said), said
    assert len(said.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_control_beside_the_strips_is_refused(folder, points, tmp_path, capsys):
    path = tmp_path / "points.csv"
    lines = points.read_text().splitlines()
    path.write_text("\n".join([lines[0], lines[-1]]) + "\n")
    assert calibrate(folder, tmp_path / "out", "--control", str(path)) == 2
    assert "none of 1 points lies on even ground" in capsys.readouterr().err
