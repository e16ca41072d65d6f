"""An operator's files: strips, trajectory and mounting, and what they get wrong."""

from paperrepro import _modules_of

__getattr__ = _modules_of(__name__)
