"""Steps 6 and 7: the Gauss-Helmert adjustments, SL, A, B, C and D, and the refinement."""

from paperrepro import _modules_of

__getattr__ = _modules_of(__name__)
