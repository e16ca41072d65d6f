"""Tables for readers: Table 2 beside what is used, the paper's statements beside our numbers."""

import pandas as pd
import pytest

from paperrepro.method.roofs import RoofParameters
from paperrepro.paper import tables
from paperrepro.paper.published import TABLE2

RUN = tables.Run("mount", "quick", 1.0, 1)
SCENARIOS = ("SL", "A", "B", "C")


def test_table_2_shows_every_printed_value_beside_the_one_used():
    table = tables.table2(RoofParameters.fine(), RoofParameters.coarse()).set_index("parameter")
    assert set(TABLE2) <= set(table.index)
    for name, value in TABLE2.items():
        assert float(table.paper[name]) == value.value
        assert table.paper[name] == table.fine[name] or table.reading[name]


def _rows(left, offset_m):
    """Rows of a survey whose RMSE falls from 1 m to ``left``, by scenario, offsets all the same."""
    rows = RUN.rows("fig07", "m", {(s, "rmse_reference_calibration"): left[s] for s in SCENARIOS})
    rows += RUN.rows(
        "fig07", "1", {(s, "rmse_left_reference_calibration"): left[s] for s in SCENARIOS}
    )
    rows += RUN.rows(
        "table5", "1", {(s, "mean_left_reference_calibration"): left[s] for s in SCENARIOS}
    )
    for stage in ("calibration", "refinement"):
        for metric in ("max", "mean"):
            values = {(s, f"{metric}_{stage}"): offset_m for s in SCENARIOS}
            rows += RUN.rows("fig11", "m", values)
    return tables.frame(rows)


def test_claims_hold_for_the_paper_s_own_numbers():
    claims = tables.accuracy_claims(_rows({"SL": 0.11, "A": 0.15, "B": 0.08, "C": 0.07}, 0.1))
    claims = claims.set_index("statement").holds
    assert claims[[name for name in claims.index if name.startswith("RMSE")]].all()
    assert claims["largest offset, A-C calibrated"]
    assert not claims["mean error left by [11], within 0.1"]
    assert not claims.filter(like="mean offset").any()


@pytest.mark.parametrize(
    ("left", "offset_m", "broken"),
    [
        ({"SL": 0.11, "A": 0.15, "B": 0.12, "C": 0.07}, 0.1, "RMSE reduced by more, B"),
        ({"SL": 0.20, "A": 0.15, "B": 0.08, "C": 0.07}, 0.1, "RMSE left by [11] is less"),
        ({"SL": 0.06, "A": 0.15, "B": 0.08, "C": 0.07}, 0.1, "RMSE of B below that of [11]"),
        ({"SL": 0.11, "A": 0.15, "B": 0.06, "C": 0.07}, 0.1, "RMSE of C below that of B"),
        ({"SL": 0.11, "A": 0.15, "B": 0.08, "C": 0.07}, 0.35, "largest offset, A-C refined"),
        ({"SL": 0.11, "A": 0.15, "B": 0.08, "C": 0.07}, 0.45, "largest offset, A-C calibrated"),
    ],
)
def test_a_claim_that_fails_is_said_to_fail(left, offset_m, broken):
    claims = tables.accuracy_claims(_rows(left, offset_m))
    failed = claims[~claims.holds].statement.str.partition(" (")[0]
    assert broken in set(failed)


def test_rows_are_written_into_their_folder_or_not_at_all(tmp_path):
    rows = RUN.rows("fig07", "m", {("SL", "rmse"): 0.25})
    path = tables.write_rows(rows, tmp_path, "07_accuracy")
    assert path == tmp_path / "rows" / "07_accuracy.csv"
    assert pd.read_csv(path).value.tolist() == [0.25]
    assert tables.write_rows(rows, "", "07_accuracy") is None
