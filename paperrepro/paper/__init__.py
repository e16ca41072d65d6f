"""The paper: what it prints and claims, and what stands beside it of ours."""

from paperrepro import _modules_of

__getattr__ = _modules_of(__name__)
