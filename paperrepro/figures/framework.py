"""Fig. 3: the steps of the method."""

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.patches import FancyBboxPatch

from paperrepro.figures import ACCENT, OBJECT


def steps(ax: Axes, names: Sequence[str], notes: Sequence[str], again: tuple[int, int]) -> Axes:
    """Boxes in a row with arrows between them, ``notes`` below; an arrow back over the boxes from
    the second number of ``again`` to the first."""
    width, height = 0.84, 0.5
    for k, (name, note) in enumerate(zip(names, notes, strict=True)):
        box = FancyBboxPatch((k, 0), width, height, boxstyle="round,pad=0,rounding_size=0.06",
                             fc="#eaf4fb", ec=OBJECT)  # fmt: skip
        ax.add_patch(box)
        words = name.replace(" and ", " and\n").replace(" ", "\n", 1)
        ax.text(k + width / 2, height / 2, words, ha="center", va="center", fontsize=7)
        ax.text(k + width / 2, -0.06, note, ha="center", va="top", fontsize=7, color="#4d4d4d")
        if k:
            _arrow(ax, (k - 1 + width, height / 2), (k, height / 2), "black", "arc3")
    first, last = again
    _arrow(ax, (last + width / 2, height), (first + width / 2, height), ACCENT, "arc3,rad=0.18")
    ax.text((first + last + width) / 2, height + 0.36, "in passes", color=ACCENT, ha="center",
            fontsize=7)  # fmt: skip
    ax.set(xlim=(-0.05, len(names) - 1 + width + 0.05), ylim=(-0.25, height + 0.5))
    ax.axis("off")
    return ax


def _arrow(ax: Axes, start, end, colour: str, style: str) -> None:
    look = {"arrowstyle": "-|>", "color": colour, "lw": 1, "mutation_scale": 8}
    ax.annotate(
        "", end, start, arrowprops={**look, "shrinkA": 0, "shrinkB": 0, "connectionstyle": style}
    )
