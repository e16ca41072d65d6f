"""Frames and rotations, stated once and shared by the method and the simulator.

m-frame
    local east-north-up at the site, metres.
b-frame
    body: x forward, y right, z down. Attitude is (roll, pitch, heading) in radians, heading
    clockwise from north: ``R_b_m = T_NED_ENU @ Rz(heading) @ Ry(pitch) @ Rx(roll)``.
l-frame
    laser, z along the spin axis; a ray of azimuth a, elevation b and range r ends in
    ``r (cos b cos a, cos b sin a, sin b)``, Eq. (2).
boresight
    ``R_l_b = Rz(kappa) @ Ry(phi) @ Rx(omega) @ R_nominal``: omega, phi, kappa turn about body
    forward, right and down. The paper writes the small-angle form; this is the full rotation.

A matrix ``R_a_b`` takes coordinates from a to b. Angles are radians.
"""

import numpy as np

from paperrepro.errors import NotARotation

#: The boresight's angles, and what they turn about in words.
ANGLES, AXIS_WORDS = ("omega", "phi", "kappa"), ("roll", "pitch", "yaw")

BODY_AXES = ("forward", "right", "down")

#: North-east-down to east-north-up; its own inverse.
T_NED_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])

#: Nominal mounting, l to b: spin axis forward, azimuth zero straight down.
R_NOMINAL = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])


def rotation_zyx(x, y, z) -> np.ndarray:
    """``Rz(z) @ Ry(y) @ Rx(x)``, (..., 3, 3) of angles (...,) rad."""
    cx, sx = np.cos(x), np.sin(x)
    cy, sy = np.cos(y), np.sin(y)
    cz, sz = np.cos(z), np.sin(z)
    R = np.array(
        [
            [cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx],
            [sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx],
            [-sy, cy * sx, cy * cx],
        ]
    )
    return np.moveaxis(R, (0, 1), (-2, -1))


def attitude_matrix(roll, pitch, heading) -> np.ndarray:
    """``R_b_m`` (..., 3, 3) of attitudes (...,) rad."""
    return T_NED_ENU @ rotation_zyx(roll, pitch, heading)


def boresight_matrix(boresight, R_nominal: np.ndarray = R_NOMINAL) -> np.ndarray:
    """``R_l_b`` (3, 3) from boresight (omega, phi, kappa)."""
    omega, phi, kappa = (float(angle) for angle in boresight)
    return rotation_zyx(omega, phi, kappa) @ R_nominal


def require_rotation(R, what: str) -> np.ndarray:
    """Return R as a float (3, 3) array, or raise `NotARotation`."""
    R = np.asarray(R, dtype=float)
    if R.shape != (3, 3) or not np.isfinite(R).all():
        raise NotARotation(
            f"{what}: expected a finite 3x3 rotation matrix, got shape {R.shape}; "
            "give three rows of three direction cosines"
        )
    off = np.abs(R @ R.T - np.eye(3)).max()
    det = np.linalg.det(R)
    if off > 1e-6 or det < 0:
        raise NotARotation(
            f"{what}: expected a right-handed rotation, got det {det:+.6f} and rows that miss "
            f"orthonormality by {off:.2e}; check signs and the order of the axes "
            "(rows are b, columns l)"
        )
    return R
