"""A simulated survey, thinned, in an operator's files; and ways to spoil them."""

import functools
import shutil
from dataclasses import replace
from pathlib import Path

import laspy
import numpy as np
import pytest

from data_synth import make_config, simulate
from data_synth.operator import Site, write_survey
from paperrepro._cache import cached
from paperrepro.flight.read import read_flight

#: Every so many points of each strip, and these strips: north, south, east.
THINNING, STRIPS = 16, ("F1", "F2", "F7")


@pytest.fixture(scope="session")
def thinned():
    """Survey and truth."""
    survey, truth = cached(simulate, make_config())
    strips = [survey.strip(name).take(slice(None, None, THINNING)) for name in STRIPS]
    return replace(survey, strips=tuple(strips)), truth


class Folder:
    """An operator's folder."""

    def __init__(self, path: Path, site: Site):
        self.path, self.site = path, site
        self.sbet, self.mounting = path / "mission.sbet", path / "mounting.toml"

    @property
    def strips(self) -> list[Path]:
        return sorted(self.path.glob("*.la[sz]"))

    def read(self, **options):
        options = {"strips": self.strips, "trajectory": self.sbet, **options}
        return read_flight(mounting=self.mounting, **options)

    def arguments(self, out: Path, **given) -> list[str]:
        """Of ``paperrepro apply``."""
        return [
            "apply", *map(str, given.get("strips", self.strips)),
            "--trajectory", str(given.get("trajectory", self.sbet)),
            "--mounting", str(self.mounting), "--calibration", str(self.path / "truth.json"),
            "--out", str(out),
        ]  # fmt: skip

    def change_sbet(self, change) -> None:
        """``change`` takes the records (M, 17) and changes or returns them."""
        table = np.fromfile(self.sbet, "<f8").reshape(-1, 17)
        changed = change(table)
        (table if changed is None else changed).astype("<f8").tofile(self.sbet)

    def change_strips(self, change, names=STRIPS) -> None:
        """``change`` takes each `laspy.LasData` and changes or returns it."""
        for path in self.strips:
            if path.stem in names:
                las = laspy.read(path)
                changed = change(las)
                (las if changed is None else changed).write(path)

    def in_week_seconds(self, survey) -> None:
        """The survey's own times, of the GPS week, in place of adjusted standard time."""
        for path in self.strips:
            las = laspy.read(path)
            las.gps_time = survey.strip(path.stem).time
            las.header.global_encoding.gps_time_type = 0
            las.write(path)

    def change_mounting(self, old: str, new: str) -> None:
        text = self.mounting.read_text()
        assert old in text
        self.mounting.write_text(text.replace(old, new))


@pytest.fixture(scope="session")
def written(thinned, tmp_path_factory):
    """Folders by site and resolution, each written once."""

    @functools.cache
    def write(site: Site, scale: float) -> Path:
        path = tmp_path_factory.mktemp("written")
        write_survey(path, *thinned, site, scale)
        return path

    return write


@pytest.fixture
def folder(written, tmp_path):
    """``folder(site, scale)`` is a fresh copy of the survey's files there."""

    def copy(site: Site | None = None, scale: float = 1e-4) -> Folder:
        site = site or Site()
        path = shutil.copytree(written(site, scale), tmp_path / "flight")
        return Folder(path, site)

    return copy
