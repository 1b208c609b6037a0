"""Flexible bodies of the plane, put into space."""

import jax
import jax.numpy as jnp
import numpy as np

import romjax as rj

r = rj.spatial


def modal_twin(scene: rj.Scene, body: rj.AbstractBody, moving: dict) -> r.ModalBody:
    """A body in space with the same modes, whose points move in its plane alone.

    `scene`: the planar one, whose markers say where the modes are asked for. `moving`: position,
    orientation, and their rates.
    """
    own, modes = body.invariants(), body.modes
    assert own.foreshortening is None
    assert own.spin is None
    quadratic = np.eye(modes) if own.modal is None else own.modal
    inertia = r.SpatialInertia(
        own.mass,
        float(own.moment) * np.eye(3),
        own.modal,
        padded(own.first_moment),
        padded(own.shift),
        about_z_alone(1, own.swing),
        about_z_alone(2, None if own.stretch is None else 2 * own.stretch),
        about_z_alone(2, quadratic),
        about_z_alone(1, None if own.gyration is None else own.gyration.T),
    )
    markers = [
        marker.point
        for part in (*scene.joints, *scene.effects)
        for marker in vars(part).values()
        if isinstance(marker, rj.Marker) and marker.body == body.name
    ]
    points = np.stack([np.zeros(2), *markers])
    shapes = np.zeros((len(points), 6, modes))
    shapes[:, [0, 1, 5]] = [body.mode_shapes(jnp.asarray(point)) for point in points]
    q, v = body.start()
    return r.ModalBody(
        body.name,
        inertia,
        jax.hessian(body.elastic_energy)(q)[3:, 3:],
        np.pad(points, ((0, 0), (0, 1))),
        shapes,
        damping=-jax.jacfwd(body.damping_force)(v)[3:, 3:] if body.damped else None,
        amplitudes=q[3:],
        rates=v[3:],
        **moving,
    )


def about_z_alone(rank: int, value) -> np.ndarray | None:
    """A tensor over the axes of space, of which the plane knows one entry."""
    if value is None:
        return None
    value = np.asarray(value)
    tensor = np.zeros((*(3,) * rank, *value.shape))
    tensor[(2,) * rank] = value
    return tensor


def padded(value) -> np.ndarray | None:
    """Vectors of the plane in space."""
    return None if value is None else np.append(value, 0 * np.asarray(value)[:1], axis=0)
