"""The paper's values against a second transcription, and against each other."""

import numpy as np
import pytest

from paperrepro.paper import published
from paperrepro.paper.published import TABLE1, TABLE4, Published
from paperrepro.study.rows import TABLE1_PAIRS

PRINTED_TABLE4 = """
omega  0.0187 0.0049  0.0285 0.0082 -0.0012 0.0061
phi   -0.0155 0.0037  0.0108 0.0099  0.0507 0.0205
kappa  0.0008 0.0165  0.0135 0.0038  0.0446 0.0177
"""
PRINTED_TABLE1 = """
F1-F2 100 North-South
F2-F3  70 North-South
F3-F4  50 North-South
F2-F4  20 North-North
F1-F5  70 North-North
F5-F6  50 North-South
F1-F6  20 North-South
F7-F8 100 West-East
"""


def values():
    for content in vars(published).values():
        if isinstance(content, Published):
            yield content
        elif isinstance(content, dict):
            yield from (value for value in content.values() if isinstance(value, Published))


def test_table_4_as_printed():
    printed = {}
    for line in PRINTED_TABLE4.split("\n")[1:-1]:
        axis, *numbers = line.split()
        for scenario, value, sigma in zip("ABC", numbers[::2], numbers[1::2], strict=True):
            printed[scenario, axis] = Published(
                float(value), "deg", "Table 4", "pattern", float(sigma)
            )
    assert printed == TABLE4


def test_table_1_as_printed():
    rows = (line.split() for line in PRINTED_TABLE1.split("\n")[1:-1])
    assert {tuple(pair.split("-")): (int(overlap), d) for pair, overlap, d in rows} == TABLE1
    assert set(TABLE1) == set(TABLE1_PAIRS)


def test_every_value_states_unit_place_and_how_it_may_be_compared():
    found = list(values())
    assert len(found) >= 15
    for value in found:
        assert value.kind in {"input", "pattern", "ordering", "inequality"}
        assert value.unit in {"deg", "m", "1", "1/m2"}
        assert value.place.startswith(("Table ", "Fig. ", "section "))


@pytest.mark.parametrize(
    ("axis", "one", "other", "times_sigma"),
    [("phi", "A", "C", 3.2), ("omega", "B", "C", 2.9), ("phi", "A", "B", 2.5)],
)
def test_table_4_disagrees_with_itself(axis, one, other, times_sigma):
    """Angles of one mounting differ by more than their printed standard deviations allow."""
    a, b = TABLE4[one, axis], TABLE4[other, axis]
    assert abs(a.value - b.value) / np.hypot(a.sigma, b.sigma) == pytest.approx(
        times_sigma, abs=0.05
    )


def test_the_largest_published_angle_moves_a_point_at_30_m_less_than_range_noise():
    largest = max(abs(value.value) for value in TABLE4.values())
    assert 30 * np.deg2rad(largest) == pytest.approx(0.0265, abs=0.0005)
