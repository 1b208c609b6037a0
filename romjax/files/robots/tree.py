"""The bodies of a robot: links that are fixed to each other are one, and the ground is one."""

from typing import Any

import numpy as np

from ...scene.body.spatial.rigid import RigidBody
from ...scene.marker import GROUND, Marker
from ...scene.placement import Placement
from .model import Model
from .pictures import outline_of

# The point at which the frame of the file has its origin.
ORIGIN = "origin"


class Tree:
    """The bodies of a model, by the numbers of their links.

    A body has the frame of the first of its links.
    """

    def __init__(self, model: Model, data: Any):
        self.model, self._arrays, self._data = model, model.arrays, data
        count = self._arrays.nbody
        self.root: list[int] = [int(i) for i in self._arrays.body_weldid]
        self.names = self._unique_names(count)
        self._within: list[Placement] = self._placements(count)
        self.bodies = [self._body(i) for i in range(1, count) if self.root[i] == i]

    def _unique_names(self, count: int) -> list[str]:
        given = [self.model.numbered("body", i) for i in range(count)]
        for i, name in enumerate(given[1:], 1):
            if name == GROUND and self.root[i] == i:
                raise self.model.refuse("body", i, "the ground has this name; give it another one.")
        return [GROUND, *given[1:]]

    def _placements(self, count: int) -> list[Placement]:
        """The place of each link in the frame of the first link of its body."""
        still = Placement(np.zeros(3))
        places = [still] * count
        for i in range(1, count):
            if self.root[i] != i:
                places[i] = places[self._arrays.body_parentid[i]].then(self.own_place(i))
        return places

    def own_place(self, link: int) -> Placement:
        """The place of a link in its parent, by the file."""
        return Placement(self._arrays.body_pos[link], self._arrays.body_quat[link])

    def zero_place(self, link: int) -> Placement:
        """The place of a link in the body that carries its parent, with all its joints at zero."""
        parent = int(self._arrays.body_parentid[link])
        return self._within[parent].then(self.own_place(link))

    def carrier(self, link: int) -> int:
        """The body that carries the parent of a link."""
        return self.root[int(self._arrays.body_parentid[link])]

    def marker(self, link: int, place: Placement) -> Marker:
        """A marker at a place in the frame of a link, on the body that it is a part of."""
        return self.body_marker(self.root[link], self._within[link].then(place))

    def body_marker(self, body: int, place: Placement) -> Marker:
        """A marker at a place in the frame of the first link of a body."""
        return Marker.fixed(self.names[body], tuple(place.position), rotation=place.turn)

    def _body(self, first: int) -> RigidBody:
        arrays, data = self._arrays, self._data
        links = [i for i in range(arrays.nbody) if self.root[i] == first]
        mass = float(sum(arrays.body_mass[i] for i in links))
        inertial = [
            self._within[i].then(Placement(arrays.body_ipos[i], arrays.body_iquat[i]))
            for i in links
        ]
        masses = [float(arrays.body_mass[i]) for i in links]
        centre = sum(m * p.position for m, p in zip(masses, inertial, strict=True)) / mass
        tensor = np.zeros((3, 3))
        for i, m, place in zip(links, masses, inertial, strict=True):
            axes, arm = place.axes, place.position - centre
            tensor += axes @ np.diag(arrays.body_inertia[i]) @ axes.T
            tensor += m * (arm @ arm * np.eye(3) - np.outer(arm, arm))
        speeds = np.zeros(6)
        kind = self.model.mujoco.mjtObj.mjOBJ_XBODY
        self.model.mujoco.mj_objectVelocity(arrays, data, kind, first, speeds, 0)
        return RigidBody(
            self.names[first],
            mass=mass,
            inertia=0.5 * (tensor + tensor.T),
            position=np.array(data.xpos[first]),
            orientation=np.array(data.xquat[first]),
            velocity=speeds[3:],
            angular_velocity=speeds[:3],
            extent=outline_of(arrays, links, self._within),
            points=self._points(links),
            com=centre,
        )

    def _points(self, links: list[int]) -> dict[str, Any]:
        """The points of a body by name: the origin, its sites, and the links that it has taken."""
        points = {ORIGIN: np.zeros(3)}
        for link in links[1:]:
            points.setdefault(self.names[link], self._within[link].position)
        for site in range(self._arrays.nsite):
            link = int(self._arrays.site_bodyid[site])
            if link in links:
                point = self._within[link].point(self._arrays.site_pos[site])
                points.setdefault(self.model.numbered("site", site), point)
        return points
