"""Table 2 and what it leaves open: the parameters of steps 1 to 5, with units in their names."""

import tomllib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np

from paperrepro.errors import BadInput
from paperrepro.method.coarse_to_fine import RoofSearch
from paperrepro.method.ground import GroundParameters, window_sizes
from paperrepro.method.matching import MatchParameters
from paperrepro.method.outliers import OutlierParameters
from paperrepro.method.planes import GrowingParameters, RansacParameters
from paperrepro.method.roofs import RoofParameters


@dataclass(frozen=True)
class Parameters:
    """Parameters of the roof extraction and matching, by the names and units of Table 2.

    They are those of the last pass; the first pass widens what a boresight of degrees asks for
    (`RoofSearch.coarse`). Where a value departs from Table 2, the class that uses it says why.

    Parameters
    ----------
    outlier_neighbours, outlier_alpha : int, float
        Statistical outlier removal: k neighbours, mu + alpha sigma. Not printed.
    ground_cell_m, ground_base_cells, ground_slope, ground_largest_threshold_m : float
        Progressive morphological filter: cell size, base of the window, slope, maximum threshold.
    ground_windows : str
        ``exponential`` (Table 2) or ``linear`` (the text).
    ground_largest_window_m, ground_threshold_m : float
        Largest window, and the height over the ground at the smallest. Not printed.
    thinning_cell_m : float
        Voxels of the cloud on which planes are grown. Not printed.
    ransac_min_inliers, ransac_tolerance_m, ransac_max_sets : int, float, int
        Minimum number of inliers, tolerance, number of consensus.
    ransac_min_slope_deg, ransac_max_slope_deg : float
        Minimum and maximum angle of the plane.
    growing_min_points, growing_max_points, growing_angle_deg, growing_max_gap_m : int, int, float
        Minimum and maximum size, angular threshold, outlier removal ratio.
    growing_neighbours, growing_residual_m : int, float
        Neighbours of a point, and the residual from which a segment does not grow. Not printed.
    matching_distance_m, matching_inclination_deg : float
        Thresholds between two views of a roof, section 2.2.4. Not printed.
    settled_deg : float
        Change of the boresight at which the roofs are final.
    max_passes : int
        Passes at most.
    """

    outlier_neighbours: int = OutlierParameters.k
    outlier_alpha: float = OutlierParameters.alpha
    ground_cell_m: float = GroundParameters.cell_m
    ground_base_cells: int = GroundParameters.base_cells
    ground_windows: str = GroundParameters.windows
    ground_largest_window_m: float = GroundParameters.largest_window_m
    ground_slope: float = GroundParameters.slope
    ground_threshold_m: float = GroundParameters.threshold_m
    ground_largest_threshold_m: float = GroundParameters.largest_threshold_m
    thinning_cell_m: float = RoofParameters.cell_m
    ransac_min_inliers: int = RansacParameters.min_inliers
    ransac_tolerance_m: float = RansacParameters.tolerance_m
    ransac_min_slope_deg: float = RansacParameters.slope_deg[0]
    ransac_max_slope_deg: float = RansacParameters.slope_deg[1]
    ransac_max_sets: int = RansacParameters.max_sets
    growing_neighbours: int = GrowingParameters.neighbours
    growing_angle_deg: float = GrowingParameters.angle_deg
    growing_residual_m: float = GrowingParameters.residual_m
    growing_min_points: int = GrowingParameters.size[0]
    growing_max_points: int = GrowingParameters.size[1]
    growing_max_gap_m: float = GrowingParameters.max_gap_m
    matching_distance_m: float = MatchParameters.fine().distance_m
    matching_inclination_deg: float = MatchParameters.fine().inclination_deg
    settled_deg: float = RoofSearch.settled_deg
    max_passes: int = RoofSearch.max_passes

    def __post_init__(self):
        for field in fields(self):
            value = getattr(self, field.name)
            given = field.type if field.type is not float else (int, float)
            if not isinstance(value, given) or isinstance(value, bool):
                raise BadInput(
                    f"{field.name}: expected {_words(field.type)}, got {value!r}; "
                    f"the default is {field.default}"
                )
            if field.type is not str and not 0 < value < np.inf:
                raise BadInput(f"{field.name}: expected a finite number above 0, got {value!r}")
        window_sizes(GroundParameters(**self._of("ground_")))  # refuses what is no window
        if self.ransac_max_slope_deg > 90:
            raise BadInput(
                f"ransac_max_slope_deg: expected at most 90, got {self.ransac_max_slope_deg}"
            )
        for low, high in (("ransac_min_slope_deg", "ransac_max_slope_deg"),
                          ("growing_min_points", "growing_max_points")):  # fmt: skip
            if getattr(self, low) >= getattr(self, high):
                raise BadInput(
                    f"{low}: expected less than {high} {getattr(self, high)}, "
                    f"got {getattr(self, low)}"
                )

    @classmethod
    def of(cls, values: Mapping[str, object]) -> "Parameters":
        """From names and values, numbers also as text. Raises `BadInput`, with the names there
        are."""
        known = {field.name: field for field in fields(cls)}
        for name in values:
            if name not in known:
                raise BadInput(
                    f"parameter {name!r}: expected one of {', '.join(known)}; name one of them"
                )
        return cls(**{name: _number(known[name], value) for name, value in values.items()})

    @classmethod
    def read(cls, settings: str) -> "Parameters":
        """From ``name=value,name=value``, or from a TOML file of such lines. Raises `BadInput`."""
        if settings.endswith(".toml"):
            try:
                return cls.of(tomllib.loads(Path(settings).read_text(encoding="utf-8")))
            except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
                raise BadInput(
                    f"{settings}: expected a TOML file of lines such as growing_angle_deg = 2: "
                    f"{error}"
                ) from None
        pairs = [part.partition("=") for part in settings.split(",") if part.strip()]
        return cls.of({name.strip(): value.strip() for name, _, value in pairs})

    @property
    def search(self) -> RoofSearch:
        """As `find_roofs` takes them."""
        return RoofSearch(
            RoofParameters(
                cell_m=self.thinning_cell_m,
                outliers=OutlierParameters(self.outlier_neighbours, self.outlier_alpha),
                ground=GroundParameters(**self._of("ground_")),
                ransac=RansacParameters(
                    self.ransac_min_inliers, self.ransac_tolerance_m,
                    (self.ransac_min_slope_deg, self.ransac_max_slope_deg), self.ransac_max_sets,
                ),
                growing=GrowingParameters(
                    self.growing_neighbours, self.growing_angle_deg, self.growing_residual_m,
                    (self.growing_min_points, self.growing_max_points), self.growing_max_gap_m,
                ),
            ),
            MatchParameters(self.matching_distance_m, self.matching_inclination_deg),
            settled_deg=self.settled_deg,
            max_passes=self.max_passes,
        )  # fmt: skip

    def _of(self, group: str) -> dict:
        return {
            name.removeprefix(group): value
            for name, value in asdict(self).items()
            if name.startswith(group)
        }


def _words(kind: type) -> str:
    return {int: "a whole number", float: "a number", str: "a word"}[kind]


def _number(field, value: object) -> object:
    """A text as the number that the field asks for."""
    if not isinstance(value, str) or field.type is str:
        return value
    try:
        return field.type(value)
    except ValueError:
        raise BadInput(
            f"{field.name}: expected {_words(field.type)}, got {value!r}; "
            f"the default is {field.default}"
        ) from None
