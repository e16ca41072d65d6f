"""Problems here are so small that a second thread costs more than it gives."""

import numba
import pytest


@pytest.fixture(scope="package", autouse=True)
def _one_thread():
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    yield
    numba.set_num_threads(before)
