"""A change in any kernel's source reaches every compiled kernel; threads share the items."""

from pathlib import Path

import numpy as np
import pytest

import paperrepro
from data_synth import raycast
from paperrepro import _compiled
from paperrepro._compiled import TASKS, over_threads, source_key
from paperrepro.method import georeference
from paperrepro.method.adjustment import kernels

PACKAGE = Path(paperrepro.__file__).parent


@pytest.fixture
def package(tmp_path):
    (tmp_path / "inner").mkdir()
    (tmp_path / "plain.py").write_text("a = 1\n")
    (tmp_path / "called.py").write_text("import numba\n\nSIGN = 1\n")
    (tmp_path / "inner" / "calling.py").write_text("import numba\n\nfrom called import SIGN\n")
    return tmp_path


@pytest.mark.parametrize("changed", ["called.py", "inner/calling.py"])
def test_another_kernel_source_gives_another_key(package, changed):
    before = source_key(package)
    (package / changed).write_text((package / changed).read_text().replace("1", "-1") + "\n")
    assert source_key(package) != before


def test_a_kernel_file_of_another_name_gives_another_key(package):
    before = source_key(package)
    (package / "called.py").rename(package / "renamed.py")
    assert source_key(package) != before


def test_a_source_without_kernels_does_not_matter(package):
    before = source_key(package)
    (package / "plain.py").write_text("a = 2\n")
    assert source_key(package) == before


@pytest.mark.parametrize(
    "kernel", [georeference._georeference, kernels.sum_points, raycast._distances]
)
def test_compiled_kernels_lie_in_the_folder_of_the_key(kernel):
    assert f"kernels-{source_key(PACKAGE)}" in Path(kernel.stats.cache_path).parts


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize(("count", "least"), [(0, 1), (1, 1), (5, 10), (16, 1), (1000, 7)])
def test_every_item_is_worked_on_once(count, least, threads, monkeypatch):
    monkeypatch.setattr(_compiled, "threads", lambda: threads)
    seen, tasks = np.zeros(count, int), []

    def kernel(first, last, seen):
        tasks.append(last - first)
        seen[first:last] += 1

    over_threads(kernel, count, seen, least=least)
    assert (seen == 1).all()
    assert len(tasks) <= TASKS
    assert sum(size < least for size in tasks) <= 1  # the last one


def test_an_error_of_a_thread_is_raised(monkeypatch):
    monkeypatch.setattr(_compiled, "threads", lambda: 2)

    def kernel(first, last):
        if first > 0:
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        over_threads(kernel, 10, least=1)
