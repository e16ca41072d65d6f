"""Many simulated surveys: sweeps of notebooks, studies for the ledger, and what they say."""

from paperrepro import _modules_of

__getattr__ = _modules_of(__name__)
