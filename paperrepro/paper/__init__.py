"""The paper: what it prints and claims, and what stands beside it of ours."""

from paperrepro import modules_of

__getattr__ = modules_of(__name__)
