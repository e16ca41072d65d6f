"""Gauss-Helmert adjustments: SL, A, B, C and the refinement."""
