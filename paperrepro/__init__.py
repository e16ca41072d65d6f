"""Rigorous calibration of UAV LiDAR: the method, and nothing that knows the truth.

Reproduces Oliveira Junior and Santos, "Rigorous Calibration of UAV-Based LiDAR Systems with
Refinement of the Boresight Angles Using a Point-to-Plane Approach", Sensors 2019.
"""

__version__ = "0.1.0"
