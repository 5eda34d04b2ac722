"""What the live page draws in space. The world of the page is east, north, up; the vehicle's body forward, left, up."""

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from companion.view.attitudes import rotated
from companion.view.history import History, Moment, Plan
from companion.view.lines import Floats
from companion.view.mapping import MapAt, avoidance_of, picture
from companion.view.scene import Prism, between, mesh, solids
from protocol.arrays import Array
from protocol.frames import enu_to_ned, multiply

if TYPE_CHECKING:
    import viser

_PATH_POINTS, _PATH_STEP_M = 1500, 0.05
"""Number of points of a path at most, and how far apart they are at least."""
_MAP_HEIGHT = 0.03
"""Height (m) above the ground at which the map is drawn."""
BEHIND = np.array([-4.0, -9.0, 5.0])
"""Where a camera starts, relative to the vehicle (m, east, north, up)."""
_LENS, _FLAT_LENS = (math.radians(75.0), 0.05, 1000.0), (0.03, 20.0, 50_000.0)
"""Field of view (rad) of a camera, and how near and far it sees (m): in space, and from above, where it is nearly a
parallel projection."""
_AS_ASKED = 0.05
"""How far from where it was put a camera may be, as a share of its distance, to be there."""
_ABOVE = np.array([0.0, -0.2, 2000.0])
"""Where a camera starts that sees 60 m of the ground from above: as good as upright, so that north is up."""
_PUSH_M_PER_M_S2 = 0.5
"""Length (m) of the arrow of an acceleration of 1 m/s2."""
_ENU_NED = np.array([0.0, math.sqrt(0.5), math.sqrt(0.5), 0.0])
_FRD_FLU = np.array([0.0, 1.0, 0.0, 0.0])
_STONE, _LEAF, _INK = (176, 168, 156), (122, 158, 104), (46, 48, 54)
_GLASS = 0.25
"""Opacity of what stands between the camera and the vehicle."""
LEGEND = {
    "vehicle, and its path": (59, 125, 221),
    "reference's path": (214, 69, 96),
    "target, and the planned way": (232, 160, 40),
    "returns of the LiDAR": (255, 70, 0),
    "map: occupied": (190, 30, 60),
    "map: free": (150, 190, 235),
    "guard intervenes": (226, 0, 122),
    "asked to go to": (190, 60, 200),
}
"""What is drawn in which color."""
_BLUE, _RED, _AMBER, _RETURN, _OBSTACLE, _, _GUARD, FLAG = LEGEND.values()
_POINT = np.zeros((1, 3))
_SEGMENT = np.zeros((1, 2, 3))
_DOT = np.array([[[-0.005, 0.0, 0.0], [0.005, 0.0, 0.0]]])
"""A line that is shorter than thick, with round ends: a dot of the same size at any distance. Nearby it is inside the
vehicle."""


class Stage:
    """The vehicle, its newest scan, its reference and its plan, the paths and the world."""

    def __init__(self, scene: "viser.SceneApi") -> None:
        self._scene = scene
        self._drawn_world = b""
        self._obstacles: list[Prism] = []
        self._faded: frozenset[str] = frozenset()
        scene.set_up_direction("+z")
        scene.configure_default_lights(cast_shadow=False)  # half the work where the browser draws in software
        self._ground = scene.add_grid(
            "/ground", 400.0, 400.0, cell_size=2.0, section_size=10.0, infinite_grid=True, fade_distance=250.0
        )
        self._map_grid = scene.add_line_segments(
            "/map_grid", _map_grid(), (150, 156, 164), thickness=1.0, thickness_units="screen", visible=False
        )
        self._vehicle = scene.add_frame("/vehicle", axes_length=0.6, axes_radius=0.015, visible=False)
        scene.add_line_segments("/vehicle/dot", _DOT, _BLUE, thickness=14.0, thickness_units="screen")
        self._stem = scene.add_line_segments(
            "/stem", _SEGMENT, _INK, thickness=1.5, thickness_units="screen", visible=False
        )
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
        self._flown, self._wanted = (
            scene.add_line_segments(name, _SEGMENT, color, thickness=width, thickness_units="screen", visible=False)
            for name, color, width in (("/flown", _BLUE, 3.0), ("/wanted", _RED, 1.5))
        )
        self._guard: Any = scene.add_icosphere("/guard", 0.6, color=_GUARD, opacity=0.5, visible=False)
        self._push: Any = scene.add_arrows(
            "/push", _SEGMENT, _GUARD, shaft_radius=0.05, head_radius=0.14, head_length=0.3, visible=False
        )

    def draw_world(self, world: bytes) -> None:
        """The obstacles of a world's file, once for each file."""
        if world == self._drawn_world:
            return
        self._drawn_world, self._obstacles = world, solids(world)
        self._draw_obstacles()

    def fade(self, eye: Array | None, position_ned: Floats | None) -> None:
        """Draw what stands between an eye (3,) (m, east, north, up) and the vehicle as glass."""
        names: frozenset[str] = frozenset()
        if eye is not None and position_ned is not None:
            names = frozenset(between(self._obstacles, enu_to_ned(eye), position_ned, 0.3))
        if names != self._faded:
            self._faded = names
            self._draw_obstacles()

    def _draw_obstacles(self) -> None:
        for kind, color, is_round in (("houses", _STONE, False), ("trees", _LEAF, True)):
            for name, opacity, is_faded in ((kind, None, False), (f"{kind}_faded", _GLASS, True)):
                chosen = [
                    prism
                    for prism in self._obstacles
                    if prism.round is is_round and (prism.name in self._faded) is is_faded
                ]
                if chosen:
                    corners, faces = _meshes(chosen, enu=True)
                    self._scene.add_mesh_simple(
                        f"/world/{name}", corners, faces, color=color, opacity=opacity, flat_shading=True
                    )
                elif self._scene.get_handle_by_name(f"/world/{name}") is not None:
                    self._scene.remove_by_name(f"/world/{name}")

    def flatten(self, *, flat: bool) -> None:
        """Draw the ground's grid as that of a map, which is sharp from far above, or as one in space."""
        self._ground.visible, self._map_grid.visible = not flat, flat

    def draw_paths(self, history: History) -> None:
        """The paths of the vehicle and of its reference so far."""
        for line, path in ((self._flown, history.path_ned()), (self._wanted, history.reference_ned())):
            picked = enu(spaced(path))
            line.visible = len(picked) > 1
            if len(picked) > 1:
                line.points = np.stack((picked[:-1], picked[1:]), axis=1)

    def draw(self, moment: Moment) -> None:
        """The vehicle and what belongs to it at a moment."""
        position, attitude, plan = moment.position_ned, moment.attitude_ned_frd, moment.plan
        self._vehicle.visible = self._stem.visible = position is not None
        if position is not None:
            top = self._vehicle.position = enu(position)
            self._stem.points = np.array([[top, [top[0], top[1], 0.0]]])
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

    def forget(self) -> None:
        """Begin anew: another vehicle is shown."""
        self._made, self._drawn_at = None, -math.inf

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
    """The cameras of the people who look: each starts behind the vehicle and follows it, or looks straight down.

    Only the server's own loop, which reads the browsers' reports, places a camera: a report that came between its
    position and the point that it looks at would hide the second.
    """

    def __init__(self, server: "viser.ViserServer") -> None:
        self._server = server
        self._looked_at: Floats = np.zeros(3)
        self._followed_to: Floats = np.zeros(3)
        self._flat = False
        self._asked: dict[int, Array | None] = {}
        """Where each client's camera was put (3,) relative to the vehicle (m, east, north, up); None once it has said
        that it is there."""
        self.watched = False
        """Whether anybody has looked yet."""
        server.initial_camera.position = tuple(BEHIND)
        server.initial_camera.look_at = (0.0, 0.0, 0.0)
        server.on_client_connect(self._connect)
        server.on_client_disconnect(self._forget)

    async def _connect(self, client: "viser.ClientHandle") -> None:
        client.camera.on_update(self._hear)

    async def _forget(self, client: "viser.ClientHandle") -> None:
        self._asked.pop(client.client_id, None)

    async def _hear(self, camera: "viser.CameraHandle") -> None:
        """A browser says where its camera is, perhaps from before it was put elsewhere.

        Whoever comes later starts behind the vehicle, too.
        """
        number = camera.client.client_id
        if number not in self._asked:
            self._set_up(camera.client)
            self.watched = True
            return
        asked, away = self._asked[number], camera.position - camera.look_at
        if asked is not None and np.linalg.norm(away - asked) <= _AS_ASKED * np.linalg.norm(asked):
            self._asked[number] = None

    def _set_up(self, client: "viser.ClientHandle") -> None:
        with client.atomic():
            camera = client.camera
            camera.fov, camera.near, camera.far = _FLAT_LENS if self._flat else _LENS
            away = self._asked[client.client_id] = _ABOVE if self._flat else BEHIND
            camera.position = camera.position + 1.0  # only what differs from the last report is sent: it may be old
            self._aim(client, away)

    def _aim(self, client: "viser.ClientHandle", away: Array) -> None:
        """Look at the vehicle, from `away` (3,) m of it."""
        with client.atomic():
            client.camera.position = self._looked_at + away
            client.camera.look_at = self._looked_at

    def _set_up_all(self) -> None:
        for client in self._server.get_clients().values():
            self._set_up(client)

    def _aim_all(self) -> None:
        for client in self._server.get_clients().values():
            asked = self._asked.get(client.client_id)
            self._aim(client, client.camera.position - client.camera.look_at if asked is None else asked)

    def flatten(self, *, flat: bool) -> None:
        """Look straight down with hardly any perspective, north up; or from behind again."""
        self._flat = flat
        self._server.get_event_loop().call_soon_threadsafe(self._set_up_all)

    def eye(self) -> Array | None:
        """Where the first of the cameras is (m, east, north, up); None if nobody looks, or from above."""
        clients = list(self._server.get_clients().values())
        return clients[0].camera.position if clients and not self._flat else None

    def follow(self, position_ned: Floats, *, moving: bool) -> None:
        """Point the cameras at the vehicle, if they are `moving` with it, from the side and distance of each.

        The steps are not added up: what a slow browser reports of its camera is some time ago.
        """
        self._looked_at = enu(position_ned)
        if moving and (self._looked_at != self._followed_to).any():
            self._followed_to = self._looked_at
            self._server.get_event_loop().call_soon_threadsafe(self._aim_all)


def _map_grid() -> Array:
    """(n, 2, 3) the lines of a map's grid (m, east, north, up): 10 m apart, to 500 m."""
    along = np.arange(-500.0, 501.0, 10.0)
    far, flat = np.full_like(along, 500.0), np.zeros_like(along)
    north = np.stack((np.column_stack((along, -far, flat)), np.column_stack((along, far, flat))), axis=1)
    return np.concatenate((north, north[:, :, [1, 0, 2]]))


def ahead(position_ned: Floats, plan: Plan) -> Array:
    """(n, 2, 3) segments (m, east, north, up) from the vehicle (3,) along the planned way, at the target's height.

    Without a planned way it is one segment straight to the target.
    """
    target, way = plan.target_ned, plan.way_ned[1:]
    corners = np.column_stack((way, np.full(len(way), target[2]))) if len(way) else [target]
    points = enu(np.vstack((position_ned, corners)))
    return np.stack((points[:-1], points[1:]), axis=1)


def spaced(path: Floats) -> Floats:
    """Points of a path (n, 3), evenly along its length, with its first and its last one."""
    if len(path) < 2:
        return path
    along = np.append(0.0, np.linalg.norm(np.diff(path, axis=0), axis=1).cumsum())
    step = max(along[-1] / _PATH_POINTS, _PATH_STEP_M)
    firsts = np.unique(along[:-1] // step, return_index=True)[1]
    return np.vstack((path[firsts], path[-1:]))


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
