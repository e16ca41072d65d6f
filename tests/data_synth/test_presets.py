"""A configuration says what it takes."""

import numpy as np
import pytest

from data_synth import PRESETS, PROFILES, SimulationConfig, make_config
from data_synth.navigation import NAVIGATION
from data_synth.presets import NOT_NEGATIVE, SCENES, TERRAINS, parse_parameters
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
