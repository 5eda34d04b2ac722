"""`companion view`: a flight in the browser while it is flown, or again from its log, drawn by viser (three.js).

A process of its own that only reads: the log, as it grows, or a link of its own. The world of the page is east, north,
up; the vehicle's body forward, left, up.
"""

import math
import threading
from collections.abc import Callable
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from companion.view.attitudes import rotated
from companion.view.control import Control, Panel
from companion.view.history import History, Moment, Plan
from companion.view.lines import Floats
from companion.view.mapping import MapAt, avoidance_of, occupied, picture
from companion.view.scene import Prism, mesh, solids
from companion.view.sources import Source
from protocol.arrays import Array
from protocol.clock import RealClock
from protocol.flightlog import FlightLogError
from protocol.frames import enu_to_ned, multiply

if TYPE_CHECKING:
    import viser

FRAME_S = 0.05
"""Between two pictures of the vehicle; words and plots take every fifth."""
PLOT_S = 30.0
"""What the plots show, up to the moment that is shown."""
_ROOM = (10, 8, 0, 0)
"""Pixels above, right of, below and left of a plot, so that no number is cut."""
_PATH_POINTS = 1500
_PLOT_POINTS = 400
_MAP_HEIGHT = 0.03
"""m above the ground on which it is drawn."""
_BEHIND = np.array([-4.0, -9.0, 5.0])
"""Where a camera starts, from the vehicle (east, north, up)."""
_ENU_NED = np.array([0.0, math.sqrt(0.5), math.sqrt(0.5), 0.0])
_FRD_FLU = np.array([0.0, 1.0, 0.0, 0.0])
_QUIET_S = 3.0
"""A flight of which nothing new came for so long is said to be silent."""
_LATE_S = 0.5
"""A vehicle that was not heard for so long is said so loudly: the companion's own patience."""
_LOUD = ' style="color:#e2007a;font-weight:600"'
_WALL, _GUARD = (190, 30, 60), (226, 0, 122)
_STONE, _LEAF, _BLUE, _RED, _AMBER, _INK, _RETURN = (
    (176, 168, 156),
    (122, 158, 104),
    (59, 125, 221),
    (214, 69, 96),
    (232, 160, 40),
    (46, 48, 54),
    (255, 70, 0),
)


class Page:
    """The server, on this machine alone, and what it shows. `control`: None for a page that only looks."""

    def __init__(self, source: Source, port: int, control: Control | None = None) -> None:
        import viser

        self._source = source
        self._control = control
        self.history = History()
        self._clock = RealClock()
        self._stop = threading.Event()
        self._time = 0.0
        self._frame = 0
        self._drawn_world = b""
        self._map_of: tuple[bytes, MapAt] | None = None
        self._map_drawn = -math.inf
        self._following = True
        self._slid_to = 0.0
        self._heard_until = 0.0
        self._quiet_s = 0.0
        """Since anything new came, while more may come."""
        self._somebody = False
        """Whether anybody has looked yet; a log that is played waits for it."""
        self._problem: str | None = None
        self._server = viser.ViserServer(host="127.0.0.1", port=port, label=f"Courier · {source.name}", verbose=False)
        self.port = self._server.get_port()
        self.wanted_port = port
        """Another one is taken where that is in use; 0 is any."""
        self._set_the_stage()
        self._make_panel()

    # ------------------------------------------------------------------------------------------------------- its loop

    def run(self) -> None:
        """Serve until `stop`, or an interrupt."""
        before_ns = self._clock.now_ns()
        while not self._stop.wait(FRAME_S):
            now_ns = self._clock.now_ns()
            self.step((now_ns - before_ns) * 1e-9)
            before_ns = now_ns

    def stop(self) -> None:
        """Ends `run` and the server."""
        self._stop.set()
        self._server.stop()

    def step(self, seconds: float) -> None:
        """Take in what is new and draw the moment that is due `seconds` after the last one."""
        self._read()
        if self._control is not None:
            self._control.step()
        self._advance(seconds)
        moment = self.history.at(self._time)
        with self._server.atomic():
            self._draw_vehicle(moment)
            if self._frame % 5 == 0:
                self._draw_words(moment)
                self._draw_plots()
            if self._frame % 10 == 0:
                self._draw_map()
            if self._frame % 20 == 0:
                self._draw_world()
                self._draw_paths()
        self._frame += 1

    def _read(self) -> None:
        try:
            for batch in self._source.poll():
                self.history.take(batch)
                if self._control is not None:
                    self._control.take(batch)
        except FlightLogError as error:
            self._problem = str(error)

    def _advance(self, seconds: float) -> None:
        """Time goes on where nothing new comes: what was heard last grows old."""
        history, ended = self.history, self._source.ended
        self._quiet_s = 0.0 if ended or history.end != self._heard_until else self._quiet_s + seconds
        self._heard_until = history.end
        # The slider's steps are of 0.01 s, and what it can't show it would give back as another time.
        start = math.floor(100.0 * history.start) / 100.0
        end = max(math.ceil(100.0 * (history.end + self._quiet_s)) / 100.0, start + 0.1)
        if self._slider.max != end or self._slider.min != start:
            self._slider.min, self._slider.max = start, end
        if self._slider.value != self._slid_to:  # by a person
            self._time, self._following = float(self._slider.value), False
        elif self._play.value:
            if self._following and not ended:
                self._time = history.end + self._quiet_s
            elif self._somebody:
                self._time += seconds * float(self._speed.value.removesuffix("x"))
        self._now.visible = not ended and not (self._following and self._play.value)
        self._time = min(max(self._time, start), end)
        self._slider.value = self._slid_to = round(self._time, 2)

    def _when(self) -> str:
        """What the moment that is shown is of the flight, in words."""
        if self._quiet_s > _QUIET_S:
            return f", nothing new for {self._quiet_s:.0f} s"
        if self._following and self._play.value and not self._source.ended:
            return ", live"
        return f" of {self._slider.max:.1f} s"

    # ---------------------------------------------------------------------------------------------------- the panel

    def _make_panel(self) -> None:
        from viser import uplot

        gui = self._server.gui
        gui.configure_theme(control_width="large", show_logo=False, show_share_button=False)
        gui.main_panel.dock_right()
        gui.set_panel_label("Courier")
        with gui.add_folder("Time"):
            self._slider: Any = gui.add_slider("s", 0.0, 1.0, 0.01, 0.0)
            self._play = gui.add_checkbox("play", True)
            self._speed = gui.add_dropdown("speed", ("0.25x", "1x", "4x", "16x"), initial_value="1x")
            self._now = gui.add_button("now")
            self._chase = gui.add_checkbox("camera follows", True)
            self._maps = gui.add_checkbox("map", True)
        self._words = gui.add_html("")
        self._panel: Panel | None = None
        if self._control is not None:
            self._panel = Panel(self._server, self._control, self._here, lambda: self._source.world)
        self._now.on_click(lambda _: self._follow())
        self._play.on_update(lambda _: self._again())
        x, axis = uplot.Series(label="s"), uplot.Axis(size=44)

        def plot(height: int, *lines: tuple[str, str]) -> Any:
            series = (x, *(uplot.Series(label=label, stroke=color, width=1.5) for label, color in lines))
            scales, axes = {"x": uplot.Scale(time=False)}, (uplot.Axis(), axis)
            data = (np.zeros(1),) * len(series)
            return gui.add_uplot(data, series, scales=scales, axes=axes, height=height, padding=_ROOM)

        with gui.add_folder("Attitude, deg"):
            self._attitude = plot(170, ("roll", "#3b7ddd"), ("pitch", "#4c9f50"), ("yaw", "#8a5cc9"))
        with gui.add_folder("Clearance, m, and speed, m/s"):
            self._clearance = plot(150, ("clearance", "#4c9f50"))
            self._speeds = plot(150, ("speed", "#d08a1d"))

    def _here(self) -> Floats | None:
        """Where the vehicle is now, whatever time is shown."""
        return self.history.at(self.history.end).position_ned

    def _follow(self) -> None:
        self._following = self._play.value = True

    def _again(self) -> None:
        """A log that is played at its end begins anew."""
        if self._play.value and self._source.ended and self._time >= self._slider.max:
            self._time = self._slider.min

    def _draw_words(self, moment: Moment) -> None:
        problem = self._problem or self._source.problem
        self._words.content = words(moment, self._source.name, self._when(), problem, quiet=self._quiet_s > _QUIET_S)
        if self._panel is not None:
            self._panel.show()

    def _draw_plots(self) -> None:
        start, stop = self._time - PLOT_S, self._time
        times, attitude = self.history.attitude_deg(start, stop)
        pick = _every(len(times), _PLOT_POINTS)
        self._attitude.data = (times[pick], *attitude[pick].T.copy())
        for plot, (when, values) in (
            (self._clearance, self.history.clearance(start, stop)),
            (self._speeds, self.history.speed(start, stop)),
        ):
            pick = _every(len(when), _PLOT_POINTS)
            plot.data = (when[pick], values[pick])

    # ----------------------------------------------------------------------------------------------------- the scene

    def _set_the_stage(self) -> None:
        scene = self._server.scene
        scene.set_up_direction("+z")
        scene.configure_default_lights(cast_shadow=False)  # half the work where the browser draws in software
        scene.add_grid(
            "/ground", 400.0, 400.0, cell_size=2.0, section_size=10.0, infinite_grid=True, fade_distance=250.0
        )
        self._server.initial_camera.position = tuple(_BEHIND)
        self._server.initial_camera.look_at = (0.0, 0.0, 0.0)
        self._server.on_client_connect(self._show_around)
        self._vehicle = scene.add_frame("/vehicle", axes_length=0.6, axes_radius=0.015, visible=False)
        corners, faces = _airframe()
        scene.add_mesh_simple("/vehicle/frame", corners, faces, color=_INK, flat_shading=True, side="double")
        nose = [Prism("nose", ((0.30, -0.06), (0.44, 0.0), (0.30, 0.06)), -0.02, 0.03, round=False)]
        corners, faces = _meshes(nose, enu=False)
        scene.add_mesh_simple("/vehicle/nose", corners, faces, color=_RED, flat_shading=True, side="double")
        self._returns: Any = scene.add_point_cloud(
            "/ring",
            np.zeros((1, 3)),
            _RETURN,
            point_size=0.16,
            point_shape="circle",
            precision="float32",
            visible=False,
        )
        self._rays = scene.add_line_segments("/rays", np.zeros((1, 2, 3)), _AMBER, thickness=0.03, visible=False)
        self._reference = scene.add_icosphere("/reference", 0.07, color=_BLUE, visible=False)
        self._target = scene.add_icosphere("/target", 0.35, color=_AMBER, opacity=0.75, visible=False)
        self._way = scene.add_line_segments(
            "/way", np.zeros((1, 2, 3)), _AMBER, thickness=1.5, thickness_units="screen", visible=False
        )
        self._guard: Any = scene.add_icosphere("/guard", 0.6, color=_GUARD, opacity=0.5, visible=False)
        self._push: Any = scene.add_arrows(
            "/push", np.zeros((1, 2, 3)), _GUARD, shaft_radius=0.05, head_radius=0.14, head_length=0.3, visible=False
        )
        self._walls: Any = scene.add_point_cloud(
            "/walls", np.zeros((1, 3)), _WALL, point_size=0.1, point_shape="square", precision="float32", visible=False
        )
        self._map: Any = scene.add_image("/map", np.zeros((2, 2, 4), np.uint8), 1.0, 1.0, format="png", visible=False)
        self._seen_at: Floats | None = None

    def _draw_map(self) -> None:
        """As of the moment that is shown: what is free, on the ground, and what stands there, at the height of flight,
        too."""
        if self._map_of is None or self._map_of[0] != self._source.settings:
            self._map_of = self._source.settings, MapAt(avoidance_of(self._source.settings))
        if not self._maps.value:
            self._map.visible = self._walls.visible = False
            self._map_drawn = -math.inf
        if not self._maps.value or self._time == self._map_drawn:
            return
        self._map_drawn, maps = self._time, self._map_of[1]
        shown = maps.at(self._time, self.history.scans(maps.wants_from(self._time), self._time))
        self._map.visible = self._walls.visible = shown is not None
        if shown is None:
            return
        view, down = shown
        places = occupied(view)
        self._walls.points = _enu(np.column_stack((places, np.full(len(places), down))))
        size = view.cell * len(view.states)
        self._map.image = picture(view)[::-1]  # the page's images begin below
        self._map.render_width = self._map.render_height = size
        south, west = view.corner
        self._map.position = np.array([west * view.cell + 0.5 * size, south * view.cell + 0.5 * size, _MAP_HEIGHT])

    def _draw_world(self) -> None:
        if self._source.world == self._drawn_world:
            return
        self._drawn_world = self._source.world
        for name, color, is_round in (("houses", _STONE, False), ("trees", _LEAF, True)):
            chosen = [prism for prism in solids(self._source.world) if prism.round is is_round]
            if chosen:
                corners, faces = _meshes(chosen, enu=True)
                self._server.scene.add_mesh_simple(f"/world/{name}", corners, faces, color=color, flat_shading=True)

    def _draw_paths(self) -> None:
        add = self._server.scene.add_line_segments
        flown, wanted = self.history.path_ned(), self.history.reference_ned()
        for name, path, color, width in (("/flown", flown, _BLUE, 3.0), ("/wanted", wanted, _RED, 1.5)):
            picked = _enu(path[_every(len(path), _PATH_POINTS)])
            if len(picked) > 1:
                segments = np.stack((picked[:-1], picked[1:]), axis=1)
                add(name, segments, color, thickness=width, thickness_units="screen")

    def _draw_vehicle(self, moment: Moment) -> None:
        place, attitude, plan = moment.position_ned, moment.attitude_ned_frd, moment.plan
        self._vehicle.visible = place is not None
        if place is not None:
            self._vehicle.position = _enu(place)
            if attitude is not None:
                self._vehicle.wxyz = multiply(_ENU_NED, multiply(attitude.astype(np.float64), _FRD_FLU))
            self._move_cameras(_enu(place))
        self._draw_ring(moment)
        self._reference.visible = self._target.visible = plan is not None
        self._way.visible = plan is not None and place is not None
        if plan is not None:
            self._reference.position = _enu(plan.reference_ned)
            self._target.position = _enu(plan.target_ned)
            if place is not None:
                self._way.points = ahead(place, plan)
        self._draw_guard(place, plan)

    def _draw_guard(self, place: Floats | None, plan: Plan | None) -> None:
        """Where it intervenes: a halo, and an arrow the way it pushes, a metre for 2 m/s2."""
        self._guard.visible = self._push.visible = shown = place is not None and plan is not None and bool(plan.guard)
        if place is None or plan is None or not shown:
            return
        self._guard.position = _enu(place)
        self._push.points = np.stack((_enu(place), _enu(place + 0.5 * plan.pushed_ned)))[None]

    def _show_around(self, client: "viser.ClientHandle") -> None:
        """Who comes later starts behind the vehicle too."""
        self._somebody = True
        if self._seen_at is not None:
            client.camera.position = self._seen_at + _BEHIND
            client.camera.look_at = self._seen_at

    def _move_cameras(self, place_enu: Floats) -> None:
        """Each person's own camera looks at the vehicle, from the side and the distance that it was brought to. Nothing
        is added up: what a slow browser tells of its camera is of a while ago."""
        moved = self._seen_at is not None and bool((self._seen_at != place_enu).any())
        self._seen_at = place_enu
        if not moved or not self._chase.value:
            return
        for client in self._server.get_clients().values():
            camera = client.camera
            away = camera.position - camera.look_at
            with client.atomic():
                camera.position = place_enu + away
                camera.look_at = place_enu

    def _draw_ring(self, moment: Moment) -> None:
        place, attitude = moment.position_ned, moment.attitude_ned_frd
        shown = place is not None and attitude is not None and len(moment.returns_frd) > 0
        self._returns.visible = self._rays.visible = shown
        if place is None or attitude is None or not shown:
            return
        points = _enu(place + rotated(attitude, moment.returns_frd))
        self._returns.points = points
        nearest = int((moment.returns_frd**2).sum(axis=1).argmin())
        self._rays.points = np.stack((_enu(place), points[nearest]))[None]


def ahead(place_ned: Floats, plan: Plan) -> Array:
    """(n, 2, 3) from the vehicle along the planned way, at the target's height; without one, straight to the target."""
    target, way = plan.target_ned, plan.way_ned[1:]
    corners = np.column_stack((way, np.full(len(way), target[2]))) if len(way) else [target]
    points = _enu(np.vstack((place_ned, corners)))
    return np.stack((points[:-1], points[1:]), axis=1)


def _enu(vectors_ned: Floats) -> Array:
    """(..., 3)"""
    return enu_to_ned(vectors_ned.astype(np.float64))


def _every(count: int, most: int) -> Any:
    """Indices of at most so many, evenly, the last with them."""
    if count <= most:
        return np.arange(count)
    return np.linspace(0, count - 1, most).astype(np.int64)


def _meshes(prisms: list[Prism], *, enu: bool) -> tuple[Floats, Any]:
    """All as one mesh; `enu`: of the world's axes, otherwise outlines are forward and left in the body's."""
    corners: list[tuple[float, float, float]] = []
    faces: list[tuple[int, ...]] = []
    for prism in prisms:
        own, triangles = mesh(prism)
        base = len(corners)
        corners += own if enu else [(forward, left, up) for left, forward, up in own]
        faces += [tuple(base + index for index in triangle) for triangle in triangles]
    return np.array(corners), np.array(faces)


def _airframe() -> tuple[Floats, Any]:
    """A quadrotor in "+": body, arms and rotors, forward, left, up (m)."""
    parts = [Prism("body", ((0.09, 0.09), (0.09, -0.09), (-0.09, -0.09), (-0.09, 0.09)), -0.05, 0.04, round=False)]
    for along, across in ((0.27, 0.015), (0.015, 0.27)):
        outline = ((along, across), (along, -across), (-along, -across), (-along, across))
        parts.append(Prism("arm", outline, -0.01, 0.01, round=False))
    for north, east in ((0.23, 0.0), (-0.23, 0.0), (0.0, 0.23), (0.0, -0.23)):
        turns = [2.0 * math.pi * side / 20 for side in range(20)]
        circle = tuple((north + 0.13 * math.cos(turn), east + 0.13 * math.sin(turn)) for turn in turns)
        parts.append(Prism("rotor", circle, 0.03, 0.04, round=True))
    return _meshes(parts, enu=False)


def words(moment: Moment, name: str, when: str, problem: str | None, *, quiet: bool = False) -> str:
    """The panel's table of a flight of that name, as HTML; what comes from outside is escaped. `when` follows the
    time; `quiet`: nothing new comes."""
    plan = moment.plan
    rows = [("flight", name), ("time", f"{moment.time:.2f} s{when}")]
    if plan is not None:
        rows += [("phase", plan.phase), ("companion", plan.state)]
    if moment.link_age is None:
        rows += [("mode", "unknown"), ("failsafe", "unknown"), ("link", "silent")]
    else:
        rows.append(("mode", moment.mode + (", armed" if moment.armed else ", disarmed")))
        rows.append(("failsafe", "YES" if moment.failsafe else "no"))
        rows.append(("link", f"heard {1e3 * moment.link_age:.0f} ms ago"))
    if moment.position_ned is not None and moment.velocity_ned is not None:
        north, east, down = moment.position_ned
        rows.append(("place", f"north {north:.1f}, east {east:.1f}, height {-down:.1f} m"))
        rows.append(("speed", f"{np.linalg.norm(moment.velocity_ned):.1f} m/s"))
    if plan is not None:
        clear = f"{plan.clearance:.2f} m" if math.isfinite(plan.clearance) else "nothing near"
        notes = [note for note, holds in (("avoiding", plan.blocked), ("at a limit", plan.limited)) if holds]
        rows.append(("clearance", ", ".join([clear, *notes])))
        rows.append(("guard", f"{plan.guard}, {plan.guard_change:.1f} m/s²" if plan.guard else "quiet"))
    if moment.nearest is not None:
        rows.append(("nearest", f"{moment.nearest:.2f} m"))
    if moment.battery is not None:
        rows.append(("battery", f"{moment.battery:.0f} %"))
    notable = {
        "time": quiet,
        "failsafe": moment.failsafe,
        "link": moment.link_age is not None and moment.link_age > _LATE_S,
        "guard": plan is not None and bool(plan.guard),
    }
    cells = "".join(
        f'<tr><td style="opacity:.65;padding-right:12px">{name}</td>'
        f'<td id="{name}"{_LOUD if notable.get(name) else ""}>{escape(value)}</td></tr>'
        for name, value in rows
    )
    said = "".join(f"<div>{text.time:.1f} {escape(text.text)}</div>" for text in moment.texts)
    trouble = f'<div style="color:#d64560">{escape(problem)}</div>' if problem else ""
    style = "font-size:13px;padding:4px 14px;font-variant-numeric:tabular-nums"
    said_style = "margin-top:6px;opacity:.75;font-size:12px"
    return f'<div style="{style}">{trouble}<table>{cells}</table><div style="{said_style}">{said}</div></div>'


def serve(page: Page, say: Callable[[str], None]) -> None:
    """Say where the page is, and serve it until an interrupt."""
    taken = f" ({page.wanted_port} is in use)" if page.wanted_port not in (0, page.port) else ""
    say(f"view: http://127.0.0.1:{page.port}{taken}")
    try:
        page.run()
    except KeyboardInterrupt:
        page.stop()
