"""``paperrepro simulate`` and the way back to the truth."""

import json

import laspy
import numpy as np
import pytest

from data_synth.navigation import apx15
from data_synth.operator import accuracy_records
from paperrepro.cli import main
from paperrepro.flight.geodesy import LocalFrame
from paperrepro.flight.read import read_flight
from paperrepro.flight.sbet import read_accuracy
from paperrepro.method.adjustment.calibrate import calibrate
from paperrepro.method.coarse_to_fine import find_roofs

NAMES = [f"F{k}.laz" for k in range(1, 9)] + ["mission.sbet", "mounting.toml", "truth.json"]


def simulated(folder, *options):
    assert main(["simulate", "--out", str(folder), *options]) == 0
    return folder


def boresight_of(folder):
    """By SL, degrees, and the flight."""
    flight = read_flight(
        sorted(folder.glob("*.laz")), folder / "mission.sbet", folder / "mounting.toml"
    )
    found = find_roofs(flight.survey)
    return np.degrees(calibrate(flight.survey, found.tie_planes, "SL").boresight), flight


@pytest.mark.slow
def test_far_from_the_central_meridian_the_boresight_is_the_same(tmp_path):
    """150 km off, and on it; what differs is the last bits that steer the random choices."""
    off = simulated(tmp_path / "off", "--longitude", "-49.5")
    on = simulated(tmp_path / "on", "--longitude", "-51.0")
    assert sorted(path.name for path in off.iterdir()) == sorted(NAMES)
    (first, flight), (second, _) = boresight_of(off), boresight_of(on)
    easting = np.mean(laspy.read(off / "F1.laz").x)
    assert abs(easting - 500_000) > 149_000
    truth = json.loads((off / "truth.json").read_text())
    true = np.array([truth["boresight_deg"][name] for name in ("omega", "phi", "kappa")])
    assert np.abs(first - true).max() < 0.08  # SL under default noise
    np.testing.assert_allclose(first, second, atol=0.001)
    _require_planes_in_place(truth, flight)


def _require_planes_in_place(truth, flight):
    """The origin of truth.json is the frame of its planes: a face's centroid lies on it."""
    origin = truth["origin"]
    frame = LocalFrame(
        np.radians(origin["latitude_deg"]), np.radians(origin["longitude_deg"]), origin["height_m"]
    )
    for plane in truth["planes"]:
        centroid = np.array(plane["centroid_m"])
        assert abs(np.dot(plane["normal"], centroid) - plane["d_m"]) < 1e-6
        local = flight.frame.from_geodetic(*frame.to_geodetic(centroid[None]))
        assert np.abs(local[0, :2]).max() < 300


@pytest.mark.parametrize(
    ("options", "fact"),
    [
        (["--latitude", "91"], "latitude"),
        (["--zone", "61"], "zone"),
        (["--scale", "0"], "scale"),
        (["--preset", "other"], "preset"),
        (["--seed", "-1"], "seed"),
        (["--site", "none.toml"], "none.toml: no such file"),
    ],
)
def test_what_cannot_be_simulated(tmp_path, capsys, options, fact):
    assert main(["simulate", "--out", str(tmp_path / "a" / "b"), *options]) == 2
    assert fact in capsys.readouterr().err
    assert not (tmp_path / "a").exists()


def test_a_site_of_one_s_own_goes_through_the_files(tmp_path):
    """Another scanner, two lines of a small site: what is read is what was flown."""
    site = tmp_path / "site.toml"
    site.write_text(
        "[site]\nrows = 1\ncolumns = 2\n[scanner]\nname = 'HDL-32E'\n"
        "[[line]]\noffset_m = 10\nheading_deg = 90\nlength_m = 40\nheight_m = 25\n"
        "[[line]]\nname = 'back'\noffset_m = -10\nheading_deg = 270\nlength_m = 40\n"
    )
    out = simulated(tmp_path / "out", "--site", str(site), "--noise-scale", "0")
    assert {path.name for path in out.glob("*.laz")} == {"F1.laz", "back.laz"}
    flight = read_flight(sorted(out.glob("*.laz")), out / "mission.sbet", out / "mounting.toml")
    assert flight.survey.scanner.n_rings == 32
    assert len(json.loads((out / "truth.json").read_text())["range_offsets_m"]) == 32
    assert main(["simulate", "--out", str(out), "--site", str(site)]) == 2


def test_the_accuracy_of_a_smoother_is_read_as_it_was_written(tmp_path):
    time = np.linspace(200_000.0, 200_300.0, 50)
    sigma = np.outer(np.linspace(1.0, 2.0, 50), [0.01, 0.012, 0.02, 1e-4, 2e-4, 5e-4])
    told = apx15().with_profile(time, sigma)
    path = tmp_path / "mission.smrmsg"
    accuracy_records(told).tofile(path)
    found = read_accuracy(path, apx15(), time)
    np.testing.assert_allclose(found.position_sigma, told.position_sigma)
    np.testing.assert_allclose(found.attitude_sigma, told.attitude_sigma)
    np.testing.assert_allclose(found.profile[1], told.profile[1])
