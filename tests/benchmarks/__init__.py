"""How fast each stage is, beside a peer that does the same: ``python -m tests.benchmarks``."""
