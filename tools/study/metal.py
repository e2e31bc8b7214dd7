"""Models what metal near the probe does to an electromagnetic tracker. It is pure.

The model has a field generator of several coils, seen as magnetic dipoles, a sensor that measures each coil's field
along three axes, and a piece of metal in which every coil induces a dipole of its own. The tracker assumes the field
without metal, so it reports the pose that best explains what the sensor measures, to first order in the metal's field.

It differs from the model of the trackers' twins (drivers/twins/scene/metal.py), which pushes and tips: what is found in
the one is tried in the other.
"""

import numpy as np

from probewatch.drivers.rigid import Array, rigid, rotation_from_vector

_COILS_MM = np.array([[x, y, 0.0] for x in (-70.0, 0.0, 70.0) for y in (-70.0, 0.0, 70.0)])
"""(9, 3) in the generator's own axes: a plate of 20 cm."""
_FACING = np.array([[np.cos(k), np.sin(k), 0.5] for k in range(9)])
"""(9, 3) directions of the coils, each a different one."""
_GENERATOR_MM = np.array([40.0, -60.0, -250.0])
"""Place relative to the middle of the path: where the field of an NDI Aurora is best."""
_METAL_MM = 80.0 * np.array([0.64, 0.48, 0.6])
"""Place relative to the middle of the path, as a retractor lies beside the probe. Nearer bends the field more within a
few centimetres; nothing else was tried."""
_UNIT_MM = 100.0
"""Millimetres: unit of lengths within the fit, so that mm and rad weigh alike."""
_STEP = 1e-4
"""Half of a difference, in that unit."""


def distorted(poses: Array, most_mm: float, share: Array) -> Array:
    """Returns poses, (n, 4, 4) in the tracker's axes, as that tracker reports them.

    most_mm: largest error of a position on the path, once all of the metal is there. share: (n,) share of the metal
    that is there, 0 … 1.
    """
    places = poses[:, :3, 3]
    middle = places.mean(axis=0)
    error = _error((places - middle) / _UNIT_MM) * np.repeat([_UNIT_MM, 1.0], 3)
    size = share * most_mm / np.linalg.norm(error[:, :3], axis=1).max()
    reported = rigid(rotation_from_vector(size[:, None] * error[:, 3:]), np.zeros((len(poses), 3))) @ poses
    reported[:, :3, 3] = places + size[:, None] * error[:, :3]
    return np.asarray(reported)


def _error(places: Array) -> Array:
    """Returns displacement and turn at places, (n, 3) → (n, 6), in the units of the fit, with metal of some size."""
    coils = (_GENERATOR_MM + _COILS_MM) / _UNIT_MM
    metal = _METAL_MM / _UNIT_MM
    induced = -_dipole(_FACING, metal - coils)
    more = _dipole(induced[None], (places - metal)[:, None])

    def field(step: Array) -> Array:
        return _dipole(_FACING[None], places[:, None] + step - coils)

    # Least squares: the change of the pose whose effect on the undisturbed field is nearest to the metal's field.
    slopes = [(field(step) - field(-step)) / (2 * _STEP) for step in _STEP * np.eye(3)]
    turns = [np.cross(field(np.zeros(3)), axis) for axis in np.eye(3)]
    J = np.stack([*slopes, *turns], axis=-1).reshape(len(places), -1, 6)
    missed = more.reshape(len(places), -1, 1)
    return np.asarray(np.linalg.solve(J.transpose(0, 2, 1) @ J, J.transpose(0, 2, 1) @ missed)[..., 0])


def _dipole(moment: Array, away: Array) -> Array:
    """Returns the field, (…, 3), of a moment at these displacements from it, but for a constant."""
    far = np.linalg.norm(away, axis=-1, keepdims=True)
    along = np.sum(moment * away, axis=-1, keepdims=True)
    return np.asarray(3 * away * along / far**5 - moment / far**3)
