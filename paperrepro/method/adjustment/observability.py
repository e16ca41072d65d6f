"""What the geometry determines of the boresight, and the refusal to report what it does not.

A flight along one heading does not see a roll of the mounting, or hardly. Noise then takes the
place of geometry: every pose is a little off, so the normal equations are never quite singular, and
their inverse is a number like any other. Two limits keep such numbers from being reported.
"""

from dataclasses import dataclass, replace

import numpy as np

from paperrepro.errors import NoConvergence, RankDefect
from paperrepro.frames import AXIS_WORDS

#: A mounting made by hand is known to about a degree before any flight: data that leave a direction
#: of the boresight wider than that have not determined it.
WIDEST_SIGMA = np.deg2rad(1.0)
#: An angle known better than this is determined, however good the GNSS/INS.
LEAST_ATTITUDE_SIGMA = np.deg2rad(0.01)
_CONFUSED = {
    "roll": "a turn about the flight direction and a shift across it",
    "pitch": "a turn about the wings and a shift along the track",
    "yaw": "a turn about the vertical and shifts along the track at the swath's sides",
}
#: Iterations that do not end are the geometry's fault where the best seen direction of the
#: boresight has this many times the information of the worst.
WIDEST_CONDITION = 1e3


@dataclass(frozen=True)
class Observability:
    """What the conditions alone determine of the boresight, and of the range offsets.

    ``rank`` of 3, ``condition`` (largest over least information of a boresight direction),
    ``weakest`` unit vector (3,) about body forward, right, down, ``weakest_sigma`` rad a priori,
    ``offsets_determined``: range-offset directions in which the data outweigh the
    pseudo-observation. ``lasting_sigma`` (3,) rad: standard deviations of the angles where the
    trajectory's errors last as specified, and ``attitude_sigma`` (3,) rad those of a single pose;
    None where the points have no times.
    """

    rank: int
    condition: float
    weakest: np.ndarray
    weakest_sigma: float
    offsets_determined: int
    lasting_sigma: np.ndarray | None = None
    attitude_sigma: np.ndarray | None = None

    @classmethod
    def of(cls, S_data: np.ndarray, weight: np.ndarray) -> "Observability":
        """From the information ``S_data`` (u, u) of the conditions and pseudo-observations (u,)."""
        values, vectors = np.linalg.eigh(boresight_information(S_data + np.diag(weight)))
        rank = int((values > 1e-12 * values[-1]).sum())
        weakest = vectors[:, 0] * np.sign(vectors[np.argmax(np.abs(vectors[:, 0])), 0])
        least = max(values[0], 1e-30 * values[-1], 1e-30)  # a direction unseen: finite all the same
        condition, sigma = float(values[-1] / least), float(1 / np.sqrt(least))
        return cls(rank, condition, weakest, sigma, _offsets_determined(S_data, weight))

    def under(self, lasting_sigma: np.ndarray, attitude_sigma: np.ndarray) -> "Observability":
        """With what errors of the trajectory that last leave of it."""
        return replace(self, lasting_sigma=lasting_sigma, attitude_sigma=attitude_sigma)

    def __str__(self) -> str:
        parts = ", ".join(
            f"{axis} {part:+.2f}" for axis, part in zip(AXIS_WORDS, self.weakest, strict=True)
        )
        words = (
            f"rank {self.rank} of 3, condition {self.condition:.1f}; weakest direction: "
            f"mostly {self.weakest_word} ({parts})"
        )
        return "; ".join([words, *map(self._why_not, self.undetermined)])

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Axes of which the flight tells no more than a single pose does: their errors do not
        average out, because too few lines or headings, or roofs of too few azimuths, see them."""
        if self.lasting_sigma is None:
            return ()
        least = np.maximum(self.attitude_sigma, LEAST_ATTITUDE_SIGMA)
        return tuple(np.array(AXIS_WORDS)[self.lasting_sigma > least].tolist())

    def _why_not(self, axis: str) -> str:
        k = AXIS_WORDS.index(axis)
        return (
            f"{axis} is not determined: sigma {np.rad2deg(self.lasting_sigma[k]):.3f} deg, where a "
            f"single pose has {np.rad2deg(self.attitude_sigma[k]):.3f} deg, since too few opposite "
            f"and crossing lines or roof azimuths tell {_CONFUSED[axis]} apart"
        )

    @property
    def weakest_word(self) -> str:
        """The axis nearest to the weakest direction: ``roll``, ``pitch`` or ``yaw``."""
        return AXIS_WORDS[int(np.argmax(np.abs(self.weakest)))]


def boresight_information(S: np.ndarray) -> np.ndarray:
    """Information (3, 3) of the boresight that is left once the rest of ``S`` is free."""
    coupling = S[:3, 3:]
    information = S[:3, :3] - coupling @ np.linalg.pinv(S[3:, 3:], hermitian=True) @ coupling.T
    return (information + information.T) / 2


def _offsets_determined(S_data: np.ndarray, weight: np.ndarray) -> int:
    if len(weight) == 3:
        return 0
    coupling = S_data[:3, 3:]
    inverse = np.linalg.pinv(S_data[:3, :3], hermitian=True)
    information = S_data[3:, 3:] - coupling.T @ inverse @ coupling
    return int((np.linalg.eigvalsh(information) > weight[3:].max()).sum())


def require_determined(seen: Observability) -> None:
    """Raise `RankDefect` where a direction of the boresight is wider than `WIDEST_SIGMA`."""
    if seen.weakest_sigma > WIDEST_SIGMA * (1 + 1e-9):
        sigma = min(np.rad2deg(seen.weakest_sigma), 999.0)
        raise RankDefect(
            f"these strips and planes do not determine the boresight's {seen.weakest_word}: its "
            f"standard deviation would be at least {sigma:.2f} deg, expected at most "
            f"{np.rad2deg(WIDEST_SIGMA):.0f} deg ({seen}); add strips flown in the opposite and a "
            "crossing direction, or roofs of other azimuths"
        )


def no_convergence(seen: Observability, iterations: int, last: float, limit: float) -> Exception:
    """The error for iterations that did not end: `RankDefect` where the geometry explains it."""
    what = f"no convergence after {iterations} iterations, last correction {last:.2e}"
    what += f" (limit {limit:.0e})"
    if seen.condition > WIDEST_CONDITION:
        return RankDefect(
            f"{what}: these strips and planes hardly determine the boresight's {seen.weakest_word} "
            f"({seen}); add strips flown in the opposite and a crossing direction, or roofs of "
            "other azimuths"
        )
    return NoConvergence(
        f"{what}; look for wrong matches, or start closer to the mounting ({seen})"
    )
