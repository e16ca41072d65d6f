"""Named errors. Each message says what was expected, what came, and what to do."""


class PaperReproError(Exception):
    """Base of every error that this package raises on purpose."""


class BadInput(PaperReproError, ValueError):
    """The data handed in cannot be used as they are."""


class NotFinite(BadInput):
    """A column holds NaN or an infinity."""


class EmptyStrip(BadInput):
    """A strip holds no point."""


class OutsideTrajectory(BadInput):
    """A strip's points were measured when the trajectory gives no pose."""


class RaysDoNotFit(BadInput):
    """Under no known mistake does each beam keep one elevation."""


class NotARotation(BadInput):
    """A matrix that must be a right-handed rotation is not."""


class TooFewPlanes(PaperReproError):
    """Fewer planes, or matches between them, than the unknowns need."""


class RankDefect(PaperReproError):
    """The geometry leaves a direction of the unknowns undetermined."""


class NoConvergence(PaperReproError):
    """The iterations ended before the corrections became small."""
