"""Rigorous calibration of UAV LiDAR: the method, and nothing that knows the truth.

Reproduces Oliveira Junior and Santos, "Rigorous Calibration of UAV-Based LiDAR Systems with
Refinement of the Boresight Angles Using a Point-to-Plane Approach", Sensors 2019.
"""

from paperrepro.kernels import keep_apart

__version__ = "0.1.0"

keep_apart()
