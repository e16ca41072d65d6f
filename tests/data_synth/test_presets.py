"""A configuration says what it takes."""

import numpy as np
import pytest

from data_synth import PRESETS, PROFILES, SimulationConfig, covering, make_config
from data_synth.farm import Layout
from data_synth.navigation import NAVIGATION
from data_synth.presets import NOT_NEGATIVE, SCENES, TERRAINS, parse_parameters, read_site
from data_synth.sensors import SCANNERS
from data_synth.surfaces import ROOF_SURFACES
from paperrepro.errors import BadInput


def test_default_is_the_quick_survey_of_a_hand_mounted_scanner():
    assert make_config() == SimulationConfig(seed=1, preset="mount", profile="quick")


@pytest.mark.parametrize(
    ("field", "choices"),
    [
        ("preset", PRESETS),
        ("profile", PROFILES),
        ("scene", SCENES),
        ("terrain", TERRAINS),
        ("navigation", NAVIGATION),
        ("roof_surface", ROOF_SURFACES),
        ("scanner", SCANNERS),
    ],
)
def test_unknown_choice_names_the_choices(field, choices):
    with pytest.raises(BadInput, match=f"{field}: expected one of {', '.join(choices)}, got 'x'"):
        make_config(**{field: "x"})


@pytest.mark.parametrize("field", NOT_NEGATIVE)
@pytest.mark.parametrize("value", [-1.0, np.nan, np.inf])
def test_an_amount_is_a_number_not_negative(field, value):
    with pytest.raises(BadInput, match=field):
        make_config(**{field: value})


@pytest.mark.parametrize(
    ("field", "value"),
    [("clock_delay_s", 1.0), ("clock_delay_s", np.nan), ("range_scale_ppm", -2e5)],
)
def test_what_has_a_sign_stays_within_bounds(field, value):
    with pytest.raises(BadInput, match=field):
        make_config(**{field: value})
    assert getattr(make_config(**{field: -0.001}), field) == -0.001


@pytest.mark.parametrize("seed", [-1, 0.5])
def test_a_seed_is_a_whole_number(seed):
    with pytest.raises(BadInput, match="seed"):
        make_config(seed=seed)


@pytest.mark.parametrize("angles", [(1.0, 2.0), (1.0, 2.0, np.nan)])
def test_a_boresight_is_three_finite_angles(angles):
    with pytest.raises(BadInput, match="boresight_deg"):
        make_config(boresight_deg=angles)


def test_boresight_overrides_the_preset_and_stays_hashable():
    config = make_config(boresight_deg=[0.1, 0.2, 0.3])
    np.testing.assert_allclose(np.degrees(config.boresight), (0.1, 0.2, 0.3))
    assert hash(config) == hash(make_config(boresight_deg=(0.1, 0.2, 0.3)))


@pytest.mark.parametrize(
    "sites",
    [
        {"site_rows": 0},
        {"site_columns": 2.5},
        {"scene": "yard", "site_rows": 4},
    ],
)
def test_sites_are_whole_rows_and_columns_of_the_farm(sites):
    with pytest.raises(BadInput, match="site_"):
        make_config(**sites)
    assert make_config(site_rows=4).site_columns == 5


def test_parameters_are_read_from_text_by_the_type_of_their_default():
    assert parse_parameters(["navigation=smoother", "clock_delay_s=0.005", "seed=7"]) == {
        "navigation": "smoother", "clock_delay_s": 0.005, "seed": 7,
    }  # fmt: skip


@pytest.mark.parametrize("text", ["clock=1", "clock_delay_s=soon", "reference_noise=1", "seed", ""])
def test_what_is_no_parameter_is_refused_with_what_there_is(text):
    with pytest.raises(BadInput, match=r"expected (NAME=VALUE with a name|a value such as)"):
        parse_parameters([text])


VILLAGE = """
[site]
rows = 4
columns = 6

[scanner]
name = "HDL-32E"

[covering]
overlap = 0.6
speed_m_s = 8
"""
LINE = "[[line]]\noffset_m = 5.0\nheading_deg = 90\n"


def written(tmp_path, text):
    path = tmp_path / "site.toml"
    path.write_text(text)
    return path


def test_a_file_of_a_site_is_read(tmp_path):
    config = make_config(**read_site(written(tmp_path, VILLAGE)))
    assert (config.site_rows, config.site_columns, config.scanner) == (4, 6, "HDL-32E")
    assert config.plan == covering(*Layout(4, 6).extent, 0.6, speed=8.0)
    assert make_config(**read_site(written(tmp_path, ""))) == make_config()
    table = [{"offset_m": 5.0, "heading_deg": 90}]
    assert make_config(**read_site(written(tmp_path, LINE))).plan == make_config(plan=table).plan


@pytest.mark.parametrize(
    ("text", "fact"),
    [
        ("[site", "expected TOML text"),
        ("[sites]\nrows = 3", "sites: not known"),
        ("[site]\nrow = 3", r"\[site\]: expected rows, columns, got row"),
        ("[site]\nrows = 2.5", "site_rows: expected a whole number"),
        ("[site]\nrows = 0", "site_rows, site_columns: expected at least 1"),
        ("[site]\nrows = 5000\ncolumns = 5000", "expected at most 10000 sites"),
        ("site = 3", r"\[site\]: expected rows, columns, got 3"),
        ("[scanner]\nname = 'Riegl'", "scanner: expected one of VLP-16 Hi-Res"),
        ("[scanner]\nbeams = 3", r"\[scanner\]: expected name, got beams"),
        ("[covering]\noverlap = 1.0", "covering: expected an overlap"),
        (LINE + "[covering]", "covering and line: expected one of both"),
        ("[line]\noffset_m = 0", r"expected a table \[\[line\]\]"),
        (LINE.replace("90", "45"), "F1: expected a heading"),
    ],
)
def test_what_is_no_site_is_refused_with_file_and_remedy(tmp_path, text, fact):
    with pytest.raises(BadInput, match=rf"site\.toml: .*{fact}.*; "):
        read_site(written(tmp_path, text))


def test_a_site_that_is_not_there(tmp_path):
    with pytest.raises(BadInput, match=r"none\.toml: no such file"):
        read_site(tmp_path / "none.toml")
