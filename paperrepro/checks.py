"""Checks of columns, shared by the containers: what was expected, what came, what to do."""

import numpy as np

from paperrepro.errors import BadInput, NotFinite


def require_finite(values, what: str) -> None:
    values = np.asarray(values)
    if not np.isfinite(values).all():
        where = int(np.flatnonzero(~np.isfinite(values.reshape(len(values), -1)).all(axis=1))[0])
        raise NotFinite(
            f"{what}: expected finite numbers, row {where} holds NaN or infinity; "
            "drop such records before calibrating"
        )


def require_vector(values, what: str) -> None:
    if np.shape(values) != (3,):
        raise BadInput(
            f"{what}: expected three numbers, got shape {np.shape(values)}; give one per body axis"
        )
    require_finite(values, what)


def require_lengths(lengths: dict[str, int], what: str) -> None:
    if len(set(lengths.values())) > 1:
        came = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise BadInput(
            f"{what}: expected columns of one length, got {came}; read them anew from one file"
        )
