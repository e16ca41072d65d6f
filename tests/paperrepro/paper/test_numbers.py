"""Numbers as readers see them."""

import pandas as pd
import pytest

from paperrepro.errors import BadInput
from paperrepro.paper.numbers import NO_VALUE, Quantity, cells, heading, number, worded

NBSP = "\u00a0"


@pytest.mark.parametrize(
    ("value", "unit", "shown_in", "text"),
    [
        (0.0443, "m", "", f"4.4{NBSP}cm"),
        (1.5, "m", "", f"1.50{NBSP}m"),
        (-0.0443, "m", "mm", f"\u221244.3{NBSP}mm"),
        (0.0293, "deg", "", "0.029°"),
        (0.00041, "deg", "", "0.0004°"),
        (0.1234, "1", "%", f"12.3{NBSP}%"),
        (24, "1", "", "24"),
        (0.61848, "1", "", "0.6185"),
        (89758, "1", "", "89\u202f758"),
        (3.0, "1/s", "", f"3{NBSP}1/s"),
        (float("nan"), "m", "", NO_VALUE),
    ],
)
def test_a_quantity_is_written_with_its_unit(value, unit, shown_in, text):
    assert f"{Quantity(value, unit):{shown_in}}" == text


def test_a_quantity_refuses_a_foreign_unit():
    with pytest.raises(BadInput, match="expected to be shown in m, cm, mm, got deg"):
        f"{Quantity(1.0, 'm'):deg}"


def test_what_rounds_to_nothing_has_no_sign():
    assert number(-0.0001, 2) == "0.00"


def test_a_cell_of_the_ledger_may_be_text():
    assert worded("below [11]", "m") == "below [11]"
    assert worded("", "m") == ""
    assert worded("nan", "m") == ""


@pytest.mark.parametrize(
    ("name", "values", "texts"),
    [
        ("paper_percent", [100, 70], ["100", "70"]),
        ("achieved_percent", [93.62, 75.8], ["93.6", "75.8"]),
        ("error_in_sigma", [18.81, float("nan")], ["18.8", ""]),
        ("paper", [0.05, 10.0, 500.0], ["0.05", "10", "500"]),
        ("mean_left", [0.1207, 0.139], ["0.1207", "0.1390"]),
        ("holds", [True, False], ["yes", "no"]),
        ("angle", ["omega", None], [f"Δω{NBSP}(roll)", ""]),
    ],
)
def test_cells_of_a_column_have_like_digits(name, values, texts):
    assert cells(pd.Series(values, name=name)) == texts


def test_a_heading_says_the_unit():
    assert heading("paper_sigma_deg") == "paper σ (°)"
    assert heading("error_in_sigma") == "error (σ)"
    assert heading("planes_as_unknowns") == "planes as unknowns"
