"""What cannot be used is refused: exit code 2, one line that names file, place and remedy, nothing
written.
"""

import tomllib

import laspy
import numpy as np
import pytest

from data_synth.operator import Site
from paperrepro.cli import main
from paperrepro.flight.geodesy import Grid
from paperrepro.frames import rotation_zyx
from paperrepro.method.georeference import georeference_strip


def refused(folder, capsys, *facts, out=None, **given):
    """Run ``paperrepro apply``; its one line on stderr must hold ``facts``."""
    out = out or folder.path.parent / "adjusted"
    before = sorted(folder.path.parent.rglob("*"))
    assert main(folder.arguments(out, **given)) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    for fact in facts:
        assert fact in lines[0]
    assert sorted(folder.path.parent.rglob("*")) == before


def test_the_folder_as_it_is_passes(folder, capsys):
    written = folder()
    out = written.path.parent / "adjusted"
    assert main(written.arguments(out)) == 0
    assert sorted(p.name for p in out.iterdir()) == ["F1.laz", "F2.laz", "F7.laz"]


# --- files ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("share", [0.02, 0.5, 0.999])
def test_truncated_laz(folder, capsys, share):
    written = folder()
    path = written.strips[1]
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    refused(written, capsys, str(path), "cut off or damaged", "copy it again")


def test_truncated_las(folder, capsys):
    written = folder()
    path = written.path / "F1.las"
    laspy.read(written.path / "F1.laz").write(path)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    refused(written, capsys, str(path), "cut off or damaged", strips=[path])


def test_damage_in_the_middle_of_a_laz(folder, capsys):
    written = folder()
    path = written.strips[0]
    content = bytearray(path.read_bytes())
    content[len(content) // 2 : len(content) // 2 + 2000] = b"\xff" * 2000
    path.write_bytes(content)
    refused(written, capsys, str(path))


def test_sbet_of_a_wrong_length(folder, capsys):
    written = folder()
    with written.sbet.open("ab") as file:
        file.write(b"\0" * 100)
    refused(written, capsys, str(written.sbet), "136 bytes", "100 bytes more", "copy it again")


def test_swapped_files(folder, capsys):
    written = folder()
    refused(written, capsys, str(written.sbet), "SBET", "swapped", strips=[written.sbet])
    first = written.strips[0]
    refused(written, capsys, str(first), "LAS/LAZ file", "swapped", trajectory=first)


def test_other_files(folder, capsys):
    written = folder()
    refused(written, capsys, "mounting.toml", "another kind", strips=[written.mounting])
    refused(written, capsys, "missing.laz", "no such file", strips=[written.path / "missing.laz"])
    refused(written, capsys, "none.sbet", "no such file", trajectory=written.path / "none.sbet")


def test_a_strip_twice(folder, capsys):
    written = folder()
    refused(written, capsys, "F1", "given twice", strips=[written.strips[0]] * 2)


def test_sources_are_not_overwritten(folder, capsys):
    written = folder()
    content = written.strips[0].read_bytes()
    refused(written, capsys, "would be overwritten", "another folder", out=written.path)
    assert written.strips[0].read_bytes() == content


def test_out_is_a_file(folder, capsys):
    written = folder()
    refused(written, capsys, "mounting.toml", "cannot be written", out=written.mounting)


def test_calibration_of_another_scanner(folder, capsys):
    written = folder()
    truth = written.path / "truth.json"
    truth.write_text(
        '{"boresight_deg": {"omega": 1, "phi": 0, "kappa": 0}, "range_offsets_m": [0]}'
    )
    refused(written, capsys, str(truth), "range_offsets_m", "16 finite numbers")
    truth.write_text('{"boresight_deg": {"omega": 1, "phi": 0}}')
    refused(written, capsys, str(truth), "kappa")
    truth.write_text("boresight")
    refused(written, capsys, str(truth), "JSON")


# --- strips --------------------------------------------------------------------------------------


def test_no_gps_time_dimension(folder, capsys):
    written = folder()
    written.change_strips(
        lambda las: laspy.convert(las, point_format_id=0, file_version="1.2"), ["F2"]
    )
    refused(written, capsys, "F2.laz", "GPS time", "point format")


def test_gps_time_all_zero(folder, capsys):
    written = folder()
    written.change_strips(lambda las: las.gps_time.fill(0.0), ["F2"])
    refused(written, capsys, "F2.laz", "GPS time", "0 for all")


def test_no_ring(folder, capsys):
    written = folder()
    written.change_strips(lambda las: las.user_data.fill(0), ["F7"])
    refused(written, capsys, "F7.laz", "ring", "--ring-dimension")


def test_ring_dimension_that_is_none(folder, capsys):
    written = folder()
    out = written.path.parent / "adjusted"
    assert main([*written.arguments(out), "--ring-dimension", "laser"]) == 2
    line = capsys.readouterr().err
    assert "'laser'" in line
    assert "user_data" in line


def test_ring_dimension_that_holds_no_ring(folder, capsys):
    def mixed(las):
        las.user_data = np.random.default_rng(0).integers(0, 16, len(las))

    written = folder()
    written.change_strips(mixed)
    refused(written, capsys, "F1.laz", "does not hold the ring", "--ring-dimension")


def test_no_reference_system(folder, capsys):
    written = folder()
    written.change_strips(lambda las: las.header.vlrs.clear(), ["F1"])
    refused(written, capsys, "F1.laz", "reference system", "--crs EPSG:32722")


def test_unknown_reference_system(folder, capsys):
    written = folder()
    arguments = [*written.arguments(written.path.parent / "a"), "--crs", "EPSG:999999"]
    assert main(arguments) == 2
    assert "EPSG:999999" in capsys.readouterr().err


def test_every_point_is_noise(folder, capsys):
    written = folder()
    written.change_strips(lambda las: setattr(las, "classification", np.full(len(las), 7)), ["F1"])
    refused(written, capsys, "F1.laz", "noise", "leave the strip out")


def test_no_points(folder, capsys):
    written = folder()
    written.change_strips(lambda las: setattr(las, "points", las.points[:0]), ["F1"])
    refused(written, capsys, "F1.laz", "holds none")


@pytest.mark.parametrize("axes", ["xyz", "z", "xy"])
def test_points_in_feet(folder, capsys, axes):
    def feet(las):
        factor = [1 / 0.3048 if axis in axes else 1.0 for axis in "xyz"]
        xyz = np.column_stack([las.x, las.y, las.z]) * factor
        las.change_scaling(offsets=xyz.mean(axis=0).round(), scales=[1e-4] * 3)
        las.x, las.y, las.z = xyz.T

    written = folder()
    written.change_strips(feet)
    refused(written, capsys, "F1.laz", "in feet", "metres")


def test_heights_alone_in_feet_at_a_low_site(folder, capsys):
    """The strips still lie near the trajectory; the rays see it."""

    def feet(las):
        z = np.asarray(las.z) / 0.3048
        las.change_scaling(offsets=las.header.offsets, scales=[1e-4] * 3)
        las.z = z

    written = folder(Site(height=80.0))
    written.change_strips(feet)
    refused(written, capsys, "F1.laz", "in feet")


def test_another_zone(folder, capsys):
    written = folder()
    out = written.path.parent / "adjusted"
    assert main([*written.arguments(out), "--crs", "EPSG:32723"]) == 2
    line = capsys.readouterr().err
    assert "zone is 1 west" in line
    assert "--crs" in line


# --- trajectory ----------------------------------------------------------------------------------


def test_trajectory_that_ends_before_the_strips(folder, capsys):
    written = folder()
    written.change_sbet(lambda table: table[: len(table) // 3])
    refused(
        written, capsys, "mission.sbet", "lie outside the trajectory", "trajectory of this flight"
    )


def test_trajectory_that_ends_within_a_strip(thinned, folder, capsys):
    survey, _ = thinned
    last = survey.strips[-1].time
    written = folder()
    written.change_sbet(lambda table: table[table[:, 0] < last[-1] - 0.05])
    refused(written, capsys, "F7.laz", "trajectory")


def test_trajectory_with_a_gap(folder, capsys):
    written = folder()
    written.change_sbet(lambda table: table[(table[:, 0] < 1010) | (table[:, 0] > 1013)])
    refused(written, capsys, "gap of 3.0 s", "without gaps")


def degrees(*columns):
    def change(table):
        table[:, columns] = np.degrees(table[:, columns])

    return change


@pytest.mark.parametrize("columns", [(1, 2), (7, 8, 9), (9,)], ids=["place", "attitude", "heading"])
def test_degrees_in_place_of_radians(folder, capsys, columns):
    written = folder()
    written.change_sbet(degrees(*columns))
    refused(written, capsys, "mission.sbet", "degrees", "radians")


def test_small_angles_in_degrees(folder, capsys):
    """Roll and pitch of a calm flight in degrees are smaller than pi: the rays tell."""
    written = folder()

    def calm(table):
        table[:, 7:9] = np.clip(np.degrees(table[:, 7:9]), -1.5, 1.5)

    written.change_sbet(calm)
    refused(written, capsys, "mission.sbet", "do not fit")


def enu_heading(table):
    table[:, 9] = np.pi / 2 - table[:, 9]


def swap(a, b):
    def change(table):
        table[:, [a, b]] = table[:, [b, a]]

    return change


def negate(*columns):
    def change(table):
        table[:, columns] *= -1

    return change


@pytest.mark.parametrize(
    ("change", "fact"),
    [
        (enu_heading, "counter-clockwise from east (ENU)"),
        (negate(9), "counter-clockwise from north"),
        (negate(8), "nose down"),
        (swap(7, 8), "interchange"),
        (swap(1, 2), "interchange"),
        (negate(1), "south is negative"),
        (negate(2), "west is negative"),
    ],
    ids=["ENU", "heading", "pitch", "roll and pitch", "lat and lon", "hemisphere", "longitude"],
)
def test_axes_and_signs_are_told_by_the_rays(folder, capsys, change, fact):
    written = folder()
    written.change_sbet(change)
    refused(written, capsys, "mission.sbet", fact)


def test_trajectory_of_another_place(folder, capsys):
    written = folder()

    def elsewhere(table):
        table[:, 1] += 0.01

    written.change_sbet(elsewhere)
    refused(written, capsys, "F1.laz", "km in plan", "trajectory of this flight")


def test_nan_and_backward_times(folder, capsys):
    written = folder()
    table = np.fromfile(written.sbet, "<f8").reshape(-1, 17)
    written.change_sbet(lambda table: table[77].fill(np.nan))
    refused(written, capsys, "mission.sbet", "record 77", "NaN")
    table[[500, 501]] = table[[501, 500]]
    table.tofile(written.sbet)
    refused(written, capsys, "mission.sbet", "record 501", "increasing")


def test_big_endian(folder, capsys):
    written = folder()
    np.fromfile(written.sbet, "<f8").byteswap().tofile(written.sbet)
    refused(written, capsys, "mission.sbet", "SBET")


def test_clock_that_is_off_by_some_seconds(folder, capsys):
    """No leap seconds: refused, for nothing says which clock is right."""
    written = folder()

    def late(table):
        table[:, 0] += 1.3

    written.change_sbet(late)
    refused(written, capsys, "mission.sbet", "do not fit")


# --- mounting ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "fact"),
    [
        ("[nominal]", "[usual]", "[nominal]"),
        ("rotation = [[", "rotation = [[0.1, ", "rotation"),
        ("[[0.0, 0.0, 1.0]", "[[0.0, 0.0, 1.1]", "right-handed rotation"),
        ("[0.0, -1.0, 0.0]", "[0.0, 1.0, 0.0]", "right-handed rotation"),
        ("lever_arm_m = [0.1, ", "lever_arm_m = [", "lever_arm_m of 3"),
        ("beam_elevations_deg = [-10.0, ", "beam_elevations_deg = [10.0, ", "no two alike"),
        ("range_sigma_m = 0.02", "range_sigma_m = 0", "range_sigma_m"),
        ("range_sigma_m = 0.02", "range_sigma_m 0.02", "TOML"),
        ("lever_arm_m = [0.1, -0.02, 0.15]", "lever_arm_m = [-0.1, 0.02, -0.15]", "turn its signs"),
    ],
)
def test_mounting(folder, capsys, old, new, fact):
    written = folder()
    written.change_mounting(old, new)
    refused(written, capsys, "mounting.toml", fact)


def test_beams_of_another_scanner(folder, capsys):
    written = folder()
    text = written.mounting.read_text()
    line = next(line for line in text.splitlines() if line.startswith("beam_elevations_deg"))
    written.mounting.write_text(text.replace(line, "").replace("VLP-16 Puck Hi-Res", "VLP-16"))
    refused(written, capsys, "mounting.toml", "VLP-16", "beam_elevations_deg")


def test_rotation_of_another_mounting(folder, capsys):
    """Spin axis to the right: no ray fits."""
    written = folder()
    text = written.mounting.read_text()
    line = next(line for line in text.splitlines() if line.startswith("rotation"))
    other = "rotation = [[0, 1, 0], [0, 0, 1], [1, 0, 0]]"
    written.mounting.write_text(text.replace(line, other))
    refused(written, capsys, "mounting.toml")


def test_strips_in_two_datums(folder, capsys):
    def other(las):
        old = Grid(las.header.parse_crs())
        xyz = np.column_stack([las.x, las.y, las.z])
        assert old.crs.to_epsg() == 32722
        las.header.add_crs(Grid(31982).crs)
        las.x, las.y, las.z = xyz.T

    written = folder()
    written.change_strips(other, ["F2"])
    refused(written, capsys, "F2.laz", "datum")


@pytest.mark.parametrize(("axis", "degrees"), [("right", 90)])
def test_a_mounting_off_by_a_quarter_turn(folder, capsys, axis, degrees):
    written = folder()
    turned(written, axis, degrees)
    words = f"{degrees} degrees about the body's axis {axis}"
    refused(written, capsys, "mounting.toml", words, "multiply it from the left")


@pytest.mark.parametrize(("axis", "degrees"), [("forward", 90), ("right", 180)])
def test_a_turn_that_moves_no_point_is_none(folder, axis, degrees):
    """About the spin axis, forward here, it changes azimuths alone; half a turn of that axis the
    order of the rings."""
    written = folder()
    before = written.read().survey
    turned(written, axis, degrees)
    after = written.read().survey
    for one, other in zip(before.strips, after.strips, strict=True):
        np.testing.assert_allclose(
            georeference_strip(after, other), georeference_strip(before, one), atol=1e-6
        )


def turned(written, axis, degrees):
    """The mounting is such that the turn would put it right."""
    text = written.mounting.read_text()
    given = np.array(tomllib.loads(text)["nominal"]["rotation"])
    k = ("forward", "right", "down").index(axis)
    wrong = rotation_zyx(*-np.radians(degrees) * np.eye(3)[k]).round() @ given
    line = next(line for line in text.splitlines() if line.startswith("rotation"))
    written.mounting.write_text(text.replace(line, f"rotation = {wrong.tolist()}"))
