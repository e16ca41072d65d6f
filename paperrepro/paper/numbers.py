"""Numbers as readers see them: with their unit, a real minus and as many digits as mean something.

Tables name the unit of a column at the end of its name (``error_deg``); rows in a column of theirs.
"""

import math
import re
from dataclasses import dataclass

import pandas as pd

from paperrepro.errors import BadInput

NO_VALUE = "no value"
THIN = "\u202f"

#: Unit a number is shown in: factor, decimals (None: four significant digits), what is written.
SHOWN = {
    "m": {"m": (1, 2, "m"), "cm": (100, 1, "cm"), "mm": (1000, 1, "mm")},
    "cm": {"cm": (1, 1, "cm")},
    "deg": {"deg": (1, 3, "°")},
    "1": {"1": (1, None, ""), "%": (100, 1, "%")},
    "%": {"%": (1, 1, "%")},
    "1/m2": {"1/m2": (1, 0, "points/m²")},
}
#: The same in the ledger's sentences; a difference, which has a sign, of metres one digit finer.
IN_WORDS = {
    "m": (100, 1, " cm"), "deg": (1, 3, "°"), "share": (100, 0, " %"), "1/m2": (1, 0, " /m²"),
    "s": (1, 2, " s"),
}  # fmt: skip

#: Endings of column names: decimals (None: four significant digits) and the unit in the heading.
ENDINGS = {
    "_in_sigma": (1, "σ"), "_percent": (1, "%"), "_deg": (4, "°"), "_cm": (2, "cm"),
    "_m": (3, "m"), "_s": (1, "s"),
}  # fmt: skip
#: Columns that stand for a length without saying so.
LENGTHS = {"rmse", "mean"}
WORDS = {
    "sigma": "σ", "sigma0": "σ₀", "omega": "Δω", "phi": "Δφ", "kappa": "Δκ", "rms": "RMS",
    "rmse": "RMSE", "Eq": "Eq.",
}  # fmt: skip
#: The angles as symbols, and as tables and pictures name them.
SYMBOLS = {"omega": "Δω", "phi": "Δφ", "kappa": "Δκ"}
ANGLE_NAMES = {
    "omega": "Δω\u00a0(roll)", "phi": "Δφ\u00a0(pitch)", "kappa": "Δκ\u00a0(yaw)",
}  # fmt: skip


@dataclass(frozen=True)
class Quantity:
    """A number with its unit; ``f"{quantity:cm}"`` writes it in centimetres."""

    value: float
    unit: str = "1"

    def __format__(self, shown_in: str) -> str:
        if not math.isfinite(self.value):
            return NO_VALUE
        factor, decimals, unit = self._scale(shown_in)
        gap = "" if unit in ("", "°") else "\u00a0"
        return f"{number(factor * self.value, decimals)}{gap}{unit}"

    def _scale(self, shown_in: str) -> tuple[float, int | None, str]:
        known = SHOWN.get(self.unit, {self.unit: (1, None, self.unit)})
        if not shown_in:
            shown_in = "cm" if self.unit == "m" and abs(self.value) < 1 else self.unit
        if shown_in not in known:
            raise BadInput(
                f"a value in {self.unit}: expected to be shown in {', '.join(known)}, got "
                f"{shown_in}; choose one of them"
            )
        factor, decimals, unit = known[shown_in]
        fine = unit == "°" and abs(self.value) < 0.01
        return factor, 4 if fine else decimals, unit


def number(
    value: float, decimals: int | None = None, signed: bool = False, grouped: bool = True
) -> str:
    """``value`` with ``decimals``, or four significant digits; ``grouped``: thousands set apart;
    ``signed``: with a plus, too."""
    whole = float(value).is_integer()
    digits = decimals if decimals is not None else 0 if whole else _digits(value, 4)
    text = f"{value:{'+' if signed else ''},.{digits}f}"
    if decimals is None and "." in text:
        text = text.rstrip("0").rstrip(".")
    if not text.strip("+-0.,"):
        text = text.lstrip("+-")  # what rounds to nothing has no sign
    return text.replace(",", THIN if grouped else "").replace("-", "\u2212")


def _digits(value: float, significant: int) -> int:
    """Decimals that give so many significant digits."""
    size = math.floor(math.log10(abs(value))) if value and math.isfinite(value) else 0
    return max(0, significant - 1 - size)


def shown(value: float, unit: str, signed: bool = False) -> str:
    """A number in a sentence: metres as centimetres, "share" as percent, others to three digits."""
    factor, decimals, ending = IN_WORDS.get(unit, (1, min(3, _digits(value, 3)), ""))
    finer = unit == "m" and signed
    return f"{number(factor * value, decimals + finer, signed, grouped=False)}{ending}"


def span(interval, unit: str, signed: bool = False) -> str:
    """A value with its `Interval` in a sentence."""
    value, low, high = (
        shown(v, unit, signed) for v in (interval.value, interval.low, interval.high)
    )
    return f"{value} ({low} to {high})"


def worded(text: str, unit: str) -> str:
    """A cell of the ledger: a number gets its unit, a text stays."""
    try:
        value = float(text)
    except ValueError:
        return text
    return f"{Quantity(value, unit)}" if math.isfinite(value) else ""


def heading(column: str) -> str:
    """A column's name for readers: "paper_sigma_deg" is "paper σ (°)"."""
    _, unit, stem = _ending(column)
    words = " ".join(WORDS.get(word, word) for word in stem.split("_"))
    return f"{words} ({unit})" if unit else words


def cells(column: pd.Series) -> list[str]:
    """The cells of one column of a table."""
    if pd.api.types.is_bool_dtype(column):
        return ["yes" if value else "no" for value in column]
    if not pd.api.types.is_numeric_dtype(column):
        return ["" if pd.isna(v) else ANGLE_NAMES.get(v, str(v)) for v in column]
    decimals = _decimals(column.dropna())
    return ["" if pd.isna(value) else number(value, decimals) for value in column]


def _decimals(column: pd.Series) -> int | None:
    """One number of decimals for a column of fractions, none for whole or mixed numbers."""
    whole = column % 1 == 0
    named = _ending(str(column.name))[0]
    if whole.all() or (named is None and whole.any()):
        return None
    if named is not None:
        least = column[column != 0].abs().min()  # shown as more than nothing
        return (
            max(named, min(_digits(least, 1), named + 2)) if least < 0.5 * 10.0**-named else named
        )
    needed = max(len(number(value).partition(".")[2]) for value in column)
    return min(needed, _digits(column.abs().max(), 4))


def _ending(column: str) -> tuple[int | None, str, str]:
    """Decimals, unit and the name without its ending."""
    if column in LENGTHS:
        return (*ENDINGS["_m"], column)
    found = re.fullmatch(f"(.+?)({'|'.join(ENDINGS)})", column)
    return (*ENDINGS[found[2]], found[1]) if found else (None, "", column)
