"""Flexible bodies of the plane, put into space."""

import equinox as eqx
import jax
import numpy as np

import romjax as rj

r = rj.spatial


def modal_twin(scene: rj.Scene, body: rj.AbstractBody, moving: dict) -> r.ModalBody:
    """A body in space with the same modes, whose points move in its plane alone.

    `scene`: the planar one, whose markers say where the modes are asked for. `moving`: position,
    orientation, and their rates.
    """
    points = np.stack([np.zeros(2), *marked(scene, body)])
    own, shapes, stiffness, damping, q, v = asked(body, points)
    modes = body.modes
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
    return r.ModalBody(
        body.name,
        inertia,
        np.asarray(stiffness),
        np.pad(points, ((0, 0), (0, 1))),
        spatial_shapes(shapes),
        damping=np.asarray(damping) if body.damped else None,
        amplitudes=np.asarray(q)[3:],
        rates=np.asarray(v)[3:],
        **moving,
    )


def marked(scene: rj.Scene, body: rj.AbstractBody) -> list[np.ndarray]:
    """The points of a body that joints and effects hold to."""
    return [
        np.asarray(marker.point)
        for part in (*scene.joints, *scene.effects)
        for marker in vars(part).values()
        if isinstance(marker, rj.Marker) and marker.body == body.name
    ]


@eqx.filter_jit
def asked(body: rj.AbstractBody, points):
    """What the twin takes from a body: invariants, the shapes of modes at points, and stiffness,
    damping and start.
    """
    q, v = body.start()
    stiffness = jax.hessian(body.elastic_energy)(q)[3:, 3:]
    damping = -jax.jacfwd(body.damping_force)(v)[3:, 3:] if body.damped else None
    return body.invariants(), [body.mode_shapes(x) for x in points], stiffness, damping, q, v


def spatial_shapes(planar) -> np.ndarray:
    """Displacement along three axes and rotation about them, of modes of the plane."""
    shapes = np.zeros((len(planar), 6, np.shape(planar)[-1]))
    shapes[:, [0, 1, 5]] = planar
    return shapes


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
