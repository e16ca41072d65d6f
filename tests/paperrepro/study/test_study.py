"""Studies: what fails on purpose is a row, what is lost is made anew, nothing is made twice."""

import os
import sys
from dataclasses import dataclass

import pytest

from paperrepro.cli import main
from paperrepro.errors import PaperReproError, TooFewPlanes
from paperrepro.study import jobs, workers
from paperrepro.study.rows import COLUMNS, FAILED, SurveyKey, frame
from paperrepro.study.simulated import ANGLES_ONLY, Measured

ONE = SurveyKey("mount", "quick", 1.0, 1)


@dataclass(frozen=True)
class Standin(jobs.SurveyJob):
    """A survey in no time; leaves a trace of having been asked."""

    def made(self, parameters):
        with open(os.path.join(os.environ["PAPERREPRO_CACHE"], "asked"), "a") as file:
            file.write(f"{parameters['seed']} {os.environ['NUMBA_NUM_THREADS']}\n")
        names = SurveyKey.__dataclass_fields__
        key = SurveyKey(**{name: parameters[name] for name in names})
        try:
            rows = frame([key.row("study", "B", "x", "m", self.measured(key))])
        except PaperReproError as error:
            return "", "", f"{type(error).__name__}: {error}"
        return "", rows.to_csv(index=False), ""

    def measured(self, key):
        return 2.5


class Refused(Standin):
    def measured(self, key):
        raise TooFewPlanes("expected roofs, got none")


class Broken(Standin):
    def measured(self, key):
        raise RuntimeError("not on purpose")


class Ended(Standin):
    def measured(self, key):
        os._exit(1) if key.seed == 1 else sys.exit(1)


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("PAPERREPRO_CACHE", str(tmp_path))
    monkeypatch.delenv("NUMBA_NUM_THREADS", raising=False)
    return tmp_path


@pytest.fixture
def study(cache, monkeypatch):
    """A study of a stand-in, by one worker."""

    def run(job, surveys=None, **options):
        monkeypatch.setattr(workers, "SurveyJob", job)
        return workers.run_study(surveys or {ONE: Measured()}, workers=1, **options)

    return run


def asked(cache):
    return (cache / "asked").read_text().splitlines()


def test_a_survey_is_measured_once_by_one_thread(cache, study):
    for _ in range(2):
        finished = study(Standin)
        assert list(finished.rows.columns) == list(COLUMNS)
        assert finished.rows.value.tolist() == [2.5]
        assert (finished.done, finished.failed, finished.lost) == (1, {}, {})
    assert asked(cache) == ["1 1"]
    assert "NUMBA_NUM_THREADS" not in os.environ
    # another depth is another survey
    study(Standin, {ONE: ANGLES_ONLY})
    assert len(asked(cache)) == 2


def test_what_fails_on_purpose_is_a_row_and_not_asked_again(cache, study):
    for _ in range(2):
        finished = study(Refused)
        assert finished.rows.metric.tolist() == [FAILED]
        assert list(finished.failed.values()) == ["TooFewPlanes: expected roofs, got none"]
    assert len(asked(cache)) == 1
    study(Refused, retry_failed=True)
    assert len(asked(cache)) == 2


@pytest.mark.slow
@pytest.mark.parametrize("job", [Broken, Ended])
def test_what_is_lost_is_no_row_and_makes_no_study(cache, study, job, capsys, monkeypatch):
    surveys = {ONE: Measured(), SurveyKey("mount", "quick", 1.0, 2): Measured()}
    finished = study(job, surveys)
    assert finished.rows.empty
    assert len(finished.lost) == 2
    out = cache / "study.csv"
    monkeypatch.setattr("paperrepro.study.simulated.planned", lambda *_: surveys)
    assert main(["study", "--workers", "1", "--out", str(out)]) == 1
    assert "not written, surveys are missing" in capsys.readouterr().err
    assert not out.exists()


def test_another_version_of_the_code_measures_anew(cache, study, monkeypatch):
    study(Standin)
    monkeypatch.setattr(jobs.SurveyJob, "SOURCE", jobs.SurveyJob.SOURCE + "  # changed")
    monkeypatch.setattr(Standin, "require_version", lambda self: None, raising=False)
    finished = study(Standin)
    assert finished.done == 1
    assert len(asked(cache)) == 2


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--preset", "mount,none"], "'none'"),
        (["--seeds", "0"], "got 0"),
        (["--workers", "0"], "at least 1"),
        (["--profile", "slow"], "invalid choice"),
    ],
)
def test_a_study_of_what_cannot_be_is_refused_before_it_starts(cache, capsys, options, words):
    assert main(["study", *options, "--out", str(cache / "study.csv")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert words in line
    assert not (cache / "study.csv").exists()
