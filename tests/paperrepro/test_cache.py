"""The cache: computed once, whole or not at all, recognised by configuration and code."""

import multiprocessing
import os
import subprocess
import sys
import time

import numpy as np
import pytest

import paperrepro
from data_synth import make_config, simulate
from paperrepro import _cache, cli
from paperrepro._cache import cached, code_version, code_version_of
from paperrepro.survey import Trajectory

CALLS = "calls.log"


@pytest.fixture(autouse=True)
def own_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("PAPERREPRO_CACHE", str(tmp_path / "cache"))
    return tmp_path


def slow_square(values, folder):
    """Leaves a line for each time it really ran."""
    with open(os.path.join(folder, CALLS), "a") as log:
        log.write("ran\n")
    time.sleep(0.3)
    return values**2


def trajectory_of(length):
    return Trajectory(np.arange(length, dtype=float), np.zeros((length, 3)), np.zeros((length, 3)))


def duration(trajectory, folder):
    slow_square(trajectory.time, folder)
    return float(np.ptp(trajectory.time))


def failing(folder):
    slow_square(np.ones(2), folder)
    raise RuntimeError("half way")


def runs(folder) -> int:
    log = folder / CALLS
    return len(log.read_text().split()) if log.exists() else 0


def test_computes_once_and_again_for_other_arguments(own_folder):
    values = np.arange(5.0)
    first = cached(slow_square, values, str(own_folder))
    second = cached(slow_square, values, str(own_folder))
    assert runs(own_folder) == 1
    np.testing.assert_array_equal(first, second)
    cached(slow_square, values + 1, str(own_folder))
    assert runs(own_folder) == 2


def test_a_cached_argument_stands_for_its_key(own_folder):
    trajectory = cached(trajectory_of, 4)
    again = cached(trajectory_of, 4)
    assert cached(duration, trajectory, str(own_folder)) == 3.0
    assert cached(duration, again, str(own_folder)) == 3.0
    assert runs(own_folder) == 1
    assert cached(duration, cached(trajectory_of, 6), str(own_folder)) == 5.0
    assert runs(own_folder) == 2


def test_what_was_loaded_can_be_written_to_without_spoiling_the_entry(own_folder):
    loaded = cached(slow_square, np.arange(5.0), str(own_folder))
    loaded[:] = -1
    np.testing.assert_array_equal(
        cached(slow_square, np.arange(5.0), str(own_folder)), np.arange(5.0) ** 2
    )


def _ask(folder):
    cached(slow_square, np.arange(3.0), folder)


def test_two_processes_that_ask_at_once_compute_once(own_folder):
    context = multiprocessing.get_context("spawn")
    processes = [context.Process(target=_ask, args=(str(own_folder),)) for _ in range(2)]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
    assert [process.exitcode for process in processes] == [0, 0]
    assert runs(own_folder) == 1


def test_a_stage_that_fails_leaves_no_entry(own_folder):
    for expected in (1, 2):
        with pytest.raises(RuntimeError, match="half way"):
            cached(failing, str(own_folder))
        assert runs(own_folder) == expected
    assert not list((own_folder / "cache").rglob("*.joblib"))
    assert not list((own_folder / "cache").rglob("*.part"))


# --- how large it grows ---------------------------------------------------------------------------


def bytes_of(values):
    return np.full(100_000, values, np.uint8)


def test_beyond_the_limit_the_entry_that_was_read_longest_ago_goes(own_folder, monkeypatch):
    monkeypatch.setenv(_cache.LIMIT, "0.00025")  # two of the three
    for number in (1, 2):
        cached(bytes_of, number)
    first, second = (entry.path for entry in _cache.entries())
    os.utime(second, (1, 1))
    cached(bytes_of, 3)
    kept = [entry.path for entry in _cache.entries()]
    assert kept[0] == first
    assert len(kept) == 2
    assert not second.with_suffix(".sum").exists()


def test_an_entry_that_is_larger_than_the_limit_is_not_kept(own_folder, monkeypatch):
    monkeypatch.setenv(_cache.LIMIT, "0.00005")
    np.testing.assert_array_equal(cached(bytes_of, 1), bytes_of(1))
    assert _cache.entries() == []


@pytest.mark.parametrize("given", ["", "much"])
def test_a_limit_that_is_no_number_is_the_usual_one(monkeypatch, given):
    monkeypatch.setenv(_cache.LIMIT, given)
    assert _cache.limit() == 5e9


def test_the_command_says_how_much_is_kept_and_removes_it_and_nothing_else(own_folder, capsys):
    cached(bytes_of, 1)
    others = own_folder / "cache" / "bytes_of" / "mine.joblib"
    others.write_text("of somebody else")
    folder = own_folder / "cache"
    assert cli.main(["cache"]) == 0
    assert capsys.readouterr().out.startswith(f"{folder}: 1 entries, 0.00 GB of at most 5 GB")
    assert cli.main(["cache", "--clear"]) == 0
    assert capsys.readouterr().out == f"{folder}: 1 entries, 0.00 GB removed\n"
    assert list((folder / "bytes_of").iterdir()) == [others]
    assert cli.main(["cache"]) == 0
    assert ": 0 entries" in capsys.readouterr().out


def test_code_version_follows_imports(tmp_path, monkeypatch):
    package = tmp_path / "data_synth_like"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "top.py").write_text("from data_synth_like import deep\n")
    (package / "deep.py").write_text("VALUE = 1\n")
    (package / "apart.py").write_text("VALUE = 1\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(_cache, "PACKAGES", ("data_synth_like",))
    versions = []
    for name, text in (("deep", "VALUE = 1\n"), ("deep", "VALUE = 2\n"), ("apart", "VALUE = 2\n")):
        (package / f"{name}.py").write_text(text)
        code_version.cache_clear()
        versions.append(code_version("data_synth_like.top"))
    code_version.cache_clear()
    assert versions[0] != versions[1]
    assert versions[1] == versions[2]


@pytest.mark.parametrize(
    "source",
    [
        "import paperrepro as pr\nresult = pr.calibrate(survey, planes, 'D').boresight",
        "import paperrepro\npaperrepro.calibrate",
        "from paperrepro import calibrate as adjust",
        "import paperrepro as pr\npr.method.adjustment.calibrate.SCENARIO_NAMES",
        "from paperrepro import method\nmethod.adjustment.calibrate.calibrate(survey)",
    ],
)
def test_the_lazy_door_hides_no_module(source):
    reached = set(_cache._imports(source.encode()))
    assert "paperrepro.method.adjustment.calibrate" in reached
    assert "paperrepro.paper.reproduce" not in reached


def test_a_change_behind_a_public_name_changes_the_key(monkeypatch):
    """Every name of the door: the file that it comes from is part of what it is keyed by."""
    read = _cache.Path.read_bytes
    for name, module in paperrepro.API.items():
        source = f"import paperrepro as pr\npr.{name}"
        before = code_version_of(source)
        origin = _cache.Path(_cache.importlib.util.find_spec(module).origin)

        with monkeypatch.context() as patch:
            patch.setattr(
                _cache.Path, "read_bytes",
                lambda path, origin=origin: read(path) + b"# changed\n" * (path == origin),
            )  # fmt: skip
            assert code_version_of(source) != before, name
        assert code_version_of(source) == before


def test_the_simulator_is_keyed_by_frames_but_not_by_the_method():
    def reached(module):
        seen, waiting = set(), [module]
        while waiting:
            name = waiting.pop()
            spec = _cache.importlib.util.find_spec(name)
            if name not in seen and spec and spec.origin:
                seen.add(name)
                waiting += list(_cache._imports(_cache.Path(spec.origin).read_bytes()))
        return seen

    modules = reached(simulate.__module__)
    assert "paperrepro.frames" in modules
    assert "data_synth.raycast" in modules
    assert "paperrepro.method.adjustment.scenarios" not in modules


def test_a_survey_survives_the_cache():
    config = make_config(seed=3)
    fresh, _ = simulate(config)
    kept, truth = cached(simulate, config)
    for one, other in zip(fresh.strips, kept.strips, strict=True):
        np.testing.assert_array_equal(one.rho, other.rho)
    assert len(truth.labels) == len(kept.strips)


# --- whatever is wrong with a cache costs time, never the result ----------------------------------


def entry(folder):
    (path,) = (folder / "cache" / "slow_square").glob("*.joblib")
    return path


def spoil(path, how):
    data = bytearray(path.read_bytes())
    if how == "flipped":
        data[len(data) // 2] ^= 0xFF
    path.write_bytes({"cut": data[: len(data) // 2], "empty": b"", "flipped": data}[how])


@pytest.mark.parametrize("how", ["cut", "empty", "flipped"])
def test_a_damaged_entry_is_made_anew(own_folder, how):
    values = np.arange(1000.0)
    cached(slow_square, values, str(own_folder))
    spoil(entry(own_folder), how)
    np.testing.assert_array_equal(cached(slow_square, values, str(own_folder)), values**2)
    assert runs(own_folder) == 2
    cached(slow_square, values, str(own_folder))
    assert runs(own_folder) == 2


def test_an_entry_of_somebody_else_is_not_run(own_folder):
    """To load a pickle is to run it: from a folder that is open to others nothing is read."""
    values = np.arange(5.0)
    cached(slow_square, values, str(own_folder))
    folder = entry(own_folder).parent
    assert folder.stat().st_mode & 0o777 == 0o700
    folder.chmod(0o777)
    np.testing.assert_array_equal(cached(slow_square, values, str(own_folder)), values**2)
    assert runs(own_folder) == 2
    assert folder.stat().st_mode & 0o777 == 0o700


def test_a_folder_that_is_none_costs_time(own_folder):
    (own_folder / "cache").write_text("a file")
    for _ in range(2):
        assert cached(slow_square, np.ones(2), str(own_folder)).tolist() == [1.0, 1.0]
    assert runs(own_folder) == 2


def test_errors_of_the_function_are_its_own(own_folder):
    with pytest.raises(RuntimeError, match="half way"):
        cached(failing, str(own_folder))


def test_a_user_without_a_home_has_a_cache_all_the_same(monkeypatch):
    for name in ("PAPERREPRO_CACHE", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)

    def homeless():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(_cache.Path, "home", homeless)
    assert "paperrepro" in _cache.cache_folder().name


KERNEL = "from paperrepro._compiled import turned; print(turned(0.0, 1.0, 0.5))"


@pytest.mark.parametrize("pattern", ["*.nbi", "*.nbc"])
def test_damaged_kernels_are_compiled_anew(tmp_path, pattern):
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "kernels")}

    def run():
        return subprocess.run(
            [sys.executable, "-c", KERNEL], capture_output=True, text=True, env=environment
        )

    first = run()
    files = list((tmp_path / "kernels").rglob(pattern))
    assert files
    for path in files:
        path.write_bytes(path.read_bytes()[:7])
    second, third = run(), run()
    assert first.returncode == second.returncode == third.returncode == 0, second.stderr
    assert first.stdout == second.stdout == third.stdout


def test_kernels_need_no_folder(tmp_path):
    (tmp_path / "file").write_text("")
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "file")}
    ran = subprocess.run(
        [sys.executable, "-c", KERNEL], capture_output=True, text=True, env=environment
    )
    assert ran.returncode == 0, ran.stderr
