"""When the iterations end."""

import numpy as np

from paperrepro.method.adjustment.conditions import (
    FINAL,
    MAX_ITERATIONS,
    NEARLY,
    ROUGH,
    TOLERANCE,
    Iterations,
)


def test_they_end_only_once_the_observations_are_settled_to_the_last():
    iterations = Iterations()
    assert iterations.final_m == ROUGH
    iterations.take(np.array([10 * NEARLY]))
    assert iterations.final_m == ROUGH
    iterations.take(np.array([TOLERANCE / 10]))
    assert not iterations.converged
    assert iterations.final_m == FINAL
    iterations.take(np.array([TOLERANCE / 10]))
    assert iterations.converged
    assert iterations.made == 3


def test_the_largest_of_all_corrections_counts():
    iterations = Iterations(final_m=FINAL)
    iterations.take(np.zeros(3), np.array([0.0, -0.5]))
    assert iterations.change == 0.5
    assert not iterations.converged


def test_there_are_never_too_many_of_those_that_converge():
    for last, too_many in ((1.0, True), (0.0, False)):
        iterations = Iterations(final_m=FINAL)
        for _ in range(MAX_ITERATIONS - 1):
            iterations.take(np.ones(1))
            assert not iterations.too_many
        iterations.take(np.array([last]))
        assert iterations.too_many is too_many
