"""What the live page draws in space. The world of the page is east, north, up; the vehicle's body forward, left, up."""

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from companion.view.attitudes import rotated
from companion.view.history import History, Moment, Plan
from companion.view.lines import Floats
from companion.view.live_charts import evenly
from companion.view.mapping import MapAt, avoidance_of, picture
from companion.view.scene import Prism, mesh, solids
from protocol.arrays import Array
from protocol.frames import enu_to_ned, multiply

if TYPE_CHECKING:
    import viser

_PATH_POINTS = 1500
_MAP_HEIGHT = 0.03
"""Height (m) above the ground at which the map is drawn."""
BEHIND = np.array([-4.0, -9.0, 5.0])
"""Where a camera starts, relative to the vehicle (m, east, north, up)."""
_PUSH_M_PER_M_S2 = 0.5
"""Length (m) of the arrow of an acceleration of 1 m/s2."""
_ENU_NED = np.array([0.0, math.sqrt(0.5), math.sqrt(0.5), 0.0])
_FRD_FLU = np.array([0.0, 1.0, 0.0, 0.0])
_OBSTACLE, _GUARD = (190, 30, 60), (226, 0, 122)
_STONE, _LEAF, _BLUE, _RED, _AMBER, _INK, _RETURN = (
    (176, 168, 156),
    (122, 158, 104),
    (59, 125, 221),
    (214, 69, 96),
    (232, 160, 40),
    (46, 48, 54),
    (255, 70, 0),
)
_POINT = np.zeros((1, 3))
_SEGMENT = np.zeros((1, 2, 3))


class Stage:
    """The vehicle, its newest scan, its reference and its plan, the paths and the world."""

    def __init__(self, scene: "viser.SceneApi") -> None:
        self._scene = scene
        self._drawn_world = b""
        scene.set_up_direction("+z")
        scene.configure_default_lights(cast_shadow=False)  # half the work where the browser draws in software
        scene.add_grid(
            "/ground", 400.0, 400.0, cell_size=2.0, section_size=10.0, infinite_grid=True, fade_distance=250.0
        )
        self._vehicle = scene.add_frame("/vehicle", axes_length=0.6, axes_radius=0.015, visible=False)
        corners, faces = _airframe()
        scene.add_mesh_simple("/vehicle/frame", corners, faces, color=_INK, flat_shading=True, side="double")
        nose = [Prism("nose", ((0.30, -0.06), (0.44, 0.0), (0.30, 0.06)), -0.02, 0.03, round=False)]
        corners, faces = _meshes(nose, enu=False)
        scene.add_mesh_simple("/vehicle/nose", corners, faces, color=_RED, flat_shading=True, side="double")
        self._returns: Any = scene.add_point_cloud(
            "/ring", _POINT, _RETURN, point_size=0.16, point_shape="circle", precision="float32", visible=False
        )
        self._ray = scene.add_line_segments("/rays", _SEGMENT, _AMBER, thickness=0.03, visible=False)
        self._reference = scene.add_icosphere("/reference", 0.07, color=_BLUE, visible=False)
        self._target = scene.add_icosphere("/target", 0.35, color=_AMBER, opacity=0.75, visible=False)
        self._way = scene.add_line_segments(
            "/way", _SEGMENT, _AMBER, thickness=1.5, thickness_units="screen", visible=False
        )
        self._guard: Any = scene.add_icosphere("/guard", 0.6, color=_GUARD, opacity=0.5, visible=False)
        self._push: Any = scene.add_arrows(
            "/push", _SEGMENT, _GUARD, shaft_radius=0.05, head_radius=0.14, head_length=0.3, visible=False
        )

    def draw_world(self, world: bytes) -> None:
        """The obstacles of a world's file, once for each file."""
        if world == self._drawn_world:
            return
        self._drawn_world = world
        for name, color, is_round in (("houses", _STONE, False), ("trees", _LEAF, True)):
            chosen = [prism for prism in solids(world) if prism.round is is_round]
            if chosen:
                corners, faces = _meshes(chosen, enu=True)
                self._scene.add_mesh_simple(f"/world/{name}", corners, faces, color=color, flat_shading=True)

    def draw_paths(self, history: History) -> None:
        """The paths of the vehicle and of its reference so far."""
        flown, wanted = history.path_ned(), history.reference_ned()
        for name, path, color, width in (("/flown", flown, _BLUE, 3.0), ("/wanted", wanted, _RED, 1.5)):
            picked = enu(path[evenly(len(path), _PATH_POINTS)])
            if len(picked) > 1:
                segments = np.stack((picked[:-1], picked[1:]), axis=1)
                self._scene.add_line_segments(name, segments, color, thickness=width, thickness_units="screen")

    def draw(self, moment: Moment) -> None:
        """The vehicle and what belongs to it at a moment."""
        position, attitude, plan = moment.position_ned, moment.attitude_ned_frd, moment.plan
        self._vehicle.visible = position is not None
        if position is not None:
            self._vehicle.position = enu(position)
            if attitude is not None:
                self._vehicle.wxyz = multiply(_ENU_NED, multiply(attitude.astype(np.float64), _FRD_FLU))
        self._draw_scan(moment)
        self._reference.visible = self._target.visible = plan is not None
        self._way.visible = plan is not None and position is not None
        if plan is not None:
            self._reference.position = enu(plan.reference_ned)
            self._target.position = enu(plan.target_ned)
            if position is not None:
                self._way.points = ahead(position, plan)
        self._draw_guard(position, plan)

    def _draw_scan(self, moment: Moment) -> None:
        position, attitude = moment.position_ned, moment.attitude_ned_frd
        shown = position is not None and attitude is not None and len(moment.returns_frd) > 0
        self._returns.visible = self._ray.visible = shown
        if position is None or attitude is None or not shown:
            return
        points = enu(position + rotated(attitude, moment.returns_frd))
        self._returns.points = points
        nearest = int((moment.returns_frd**2).sum(axis=1).argmin())
        self._ray.points = np.stack((enu(position), points[nearest]))[None]

    def _draw_guard(self, position: Floats | None, plan: Plan | None) -> None:
        """A halo where the guard intervenes, and an arrow along the acceleration that it let through."""
        shown = position is not None and plan is not None and bool(plan.guard)
        self._guard.visible = self._push.visible = shown
        if position is None or plan is None or not shown:
            return
        self._guard.position = enu(position)
        self._push.points = np.stack((enu(position), enu(position + _PUSH_M_PER_M_S2 * plan.pushed_ned)))[None]


class MapLayer:
    """The map of free and occupied space at the moment that is shown: on the ground, and obstacles at the height of
    flight, too."""

    def __init__(self, scene: "viser.SceneApi") -> None:
        self._obstacles: Any = scene.add_point_cloud(
            "/walls", _POINT, _OBSTACLE, point_size=0.1, point_shape="square", precision="float32", visible=False
        )
        self._map: Any = scene.add_image("/map", np.zeros((2, 2, 4), np.uint8), 1.0, 1.0, format="png", visible=False)
        self._made: tuple[bytes, MapAt] | None = None
        """The settings that the map is made with, and the map."""
        self._drawn_at = -math.inf

    def draw(self, history: History, settings: bytes, time: float, *, visible: bool) -> None:
        """The map at a time (s); `settings` are those of the flight, as JSON."""
        if self._made is None or self._made[0] != settings:
            self._made = settings, MapAt(avoidance_of(settings))
        if not visible:
            self._map.visible = self._obstacles.visible = False
            self._drawn_at = -math.inf
        if not visible or time == self._drawn_at:
            return
        self._drawn_at, maps = time, self._made[1]
        shown = maps.at(time, history.scans(maps.wants_from(time), time))
        self._map.visible = self._obstacles.visible = shown is not None
        if shown is None:
            return
        view, down = shown
        centres = view.obstacle_centres()
        self._obstacles.points = enu(np.column_stack((centres, np.full(len(centres), down))))
        size = view.cell * len(view.states)
        self._map.image = picture(view)[::-1]  # the page's images begin below
        self._map.render_width = self._map.render_height = size
        south, west = view.corner
        self._map.position = np.array([west * view.cell + 0.5 * size, south * view.cell + 0.5 * size, _MAP_HEIGHT])


class Cameras:
    """The cameras of the people who look: each starts behind the vehicle and follows it."""

    def __init__(self, server: "viser.ViserServer") -> None:
        self._server = server
        self._looked_at: Floats | None = None
        self.watched = False
        """Whether anybody has looked yet."""
        server.initial_camera.position = tuple(BEHIND)
        server.initial_camera.look_at = (0.0, 0.0, 0.0)
        server.on_client_connect(self._connect)

    def _connect(self, client: "viser.ClientHandle") -> None:
        """Whoever comes later starts behind the vehicle, too."""
        self.watched = True
        if self._looked_at is not None:
            client.camera.position = self._looked_at + BEHIND
            client.camera.look_at = self._looked_at

    def follow(self, position_ned: Floats, *, moving: bool) -> None:
        """Point the cameras at the vehicle, if they are `moving` with it, from the side and distance of each.

        The steps are not added up: what a slow browser reports of its camera is some time ago.
        """
        position = enu(position_ned)
        moved = self._looked_at is not None and bool((self._looked_at != position).any())
        self._looked_at = position
        if not moved or not moving:
            return
        for client in self._server.get_clients().values():
            camera = client.camera
            away = camera.position - camera.look_at
            with client.atomic():
                camera.position = position + away
                camera.look_at = position


def ahead(position_ned: Floats, plan: Plan) -> Array:
    """(n, 2, 3) segments (m, east, north, up) from the vehicle (3,) along the planned way, at the target's height.

    Without a planned way it is one segment straight to the target.
    """
    target, way = plan.target_ned, plan.way_ned[1:]
    corners = np.column_stack((way, np.full(len(way), target[2]))) if len(way) else [target]
    points = enu(np.vstack((position_ned, corners)))
    return np.stack((points[:-1], points[1:]), axis=1)


def enu(vectors_ned: Floats) -> Array:
    """(..., 3) NED -> (..., 3) east, north, up."""
    return enu_to_ned(vectors_ned.astype(np.float64))


def _meshes(prisms: list[Prism], *, enu: bool) -> tuple[Floats, Any]:
    """Corners and triangles of all prisms as one mesh, in the world's axes if `enu`, otherwise with outlines that are
    forward and left in the body's."""
    corners: list[tuple[float, float, float]] = []
    faces: list[tuple[int, ...]] = []
    for prism in prisms:
        own, triangles = mesh(prism)
        base = len(corners)
        corners += own if enu else [(forward, left, up) for left, forward, up in own]
        faces += [tuple(base + index for index in triangle) for triangle in triangles]
    return np.array(corners), np.array(faces)


def _airframe() -> tuple[Floats, Any]:
    """A quadrotor with its arms along the body's axes: body, arms and rotors (m, forward, left, up)."""
    parts = [Prism("body", ((0.09, 0.09), (0.09, -0.09), (-0.09, -0.09), (-0.09, 0.09)), -0.05, 0.04, round=False)]
    for along, across in ((0.27, 0.015), (0.015, 0.27)):
        outline = ((along, across), (along, -across), (-along, -across), (-along, across))
        parts.append(Prism("arm", outline, -0.01, 0.01, round=False))
    for north, east in ((0.23, 0.0), (-0.23, 0.0), (0.0, 0.23), (0.0, -0.23)):
        turns = [2.0 * math.pi * side / 20 for side in range(20)]
        circle = tuple((north + 0.13 * math.cos(turn), east + 0.13 * math.sin(turn)) for turn in turns)
        parts.append(Prism("rotor", circle, 0.03, 0.04, round=True))
    return _meshes(parts, enu=False)
