"""A roof profile that moves with the boresight: still in a picture, moving under sliders."""

from dataclasses import dataclass
from io import BytesIO

import ipywidgets as widgets
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from paperrepro.figures import canvas
from paperrepro.figures.calibration import ANGLE_NAMES
from paperrepro.figures.refinement import Section, by_strip, reference_line
from paperrepro.georeference import georeference
from paperrepro.survey import Mounting, Rays


@dataclass(frozen=True)
class MovingProfile:
    """A gable that several strips see, to be looked at under any boresight.

    ``rays`` of N points on it, their ``strips`` (N,) and the ``planes`` (N, 4) as (n, d) that they
    should lie on; ``mounting`` whose range offsets stay; ``section`` that is drawn, as far as
    ``half_m`` before and behind, with the reference as a ``line`` (3, 2) across and up, m.
    """

    rays: Rays
    strips: np.ndarray
    planes: np.ndarray
    mounting: Mounting
    section: Section
    line: np.ndarray
    half_m: float = 0.75

    def points(self, boresight_deg) -> np.ndarray:
        """(N, 3) m, m-frame, under the angles omega, phi, kappa (3,)."""
        offsets = self.mounting.range_offsets
        return georeference(
            self.rays, self.mounting.with_calibration(np.radians(boresight_deg), offsets)
        )

    def rmse(self, boresight_deg) -> float:
        """Of all points' distances from their planes, m."""
        distance = np.einsum("na,na->n", self.points(boresight_deg), self.planes[:, :3])
        return float(np.sqrt(np.mean((distance - self.planes[:, 3]) ** 2)))

    def draw(self, ax: Axes, boresight_deg, legend: bool = False) -> Axes:
        """The section by strip; angles and RMSE in the title."""
        clouds = {"moved": self.points(boresight_deg)}
        by_strip(ax, self.section.table(clouds, self.strips, self.half_m), legend=legend)
        reference_line(ax, self.line)
        words = [f"{name.split()[0]} {a:.2f}°" for name, a in zip(ANGLE_NAMES.values(),
                 boresight_deg, strict=True)]  # fmt: skip
        ax.set_title(f"{', '.join(words)}\nRMSE {100 * self.rmse(boresight_deg):.1f} cm")
        reach, up_m = 1.3 * np.abs(self.line[:, 0]).max(), self.line[:, 1]
        ax.set(xlabel="across the ridge (m)", ylabel="up (m)", xlim=(-reach, reach))
        ax.set_ylim(up_m.min() - 0.9, up_m.max() + 0.9)
        return ax

    def png(self, boresight_deg) -> bytes:
        """The picture of `draw`, not kept open."""
        figure, ax = canvas("single", 58)
        self.draw(ax, boresight_deg, legend=True)
        with BytesIO() as file:
            figure.savefig(file, format="png", dpi=80)
            plt.close(figure)
            return file.getvalue()


def interactive_profile(
    profile: MovingProfile, start_deg, reach_deg: float = 1.0
) -> widgets.Widget:
    """Sliders for the three angles, ``reach_deg`` about ``start_deg`` (3,), over the picture that
    they redraw; it needs a running kernel."""
    sliders = [
        widgets.FloatSlider(
            value=start, min=start - reach_deg, max=start + reach_deg, step=0.01,
            description=name, readout_format=".2f", style={"description_width": "80px"},
        )
        for name, start in zip(ANGLE_NAMES.values(), start_deg, strict=True)
    ]  # fmt: skip
    picture = widgets.Image(value=profile.png(start_deg), format="png")

    def redraw(_) -> None:
        picture.value = profile.png([slider.value for slider in sliders])

    for slider in sliders:
        slider.observe(redraw, names="value")
    return widgets.VBox([*sliders, picture])
