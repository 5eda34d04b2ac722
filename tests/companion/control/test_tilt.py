"""The tilt limit is held by the vehicle, not by the command alone."""

import math

import msgspec
import numpy as np
import pytest

from companion.control import tilt
from companion.control.controller import ATTITUDE, RATES, SIZE, THRUST, TORQUE, Controller
from companion.runtime.files import load_body, load_settings
from companion.state import Output, Reference, VehicleState
from protocol.arrays import Array
from protocol.frames import conjugate, from_rotation_vector, multiply, rotate, to_rotation_vector
from protocol.vehicle_parameters import VehicleParameters

BODY = load_body("paper_quad")
TICK_NS = 4_000_000
START_NS = 1_000_000_000
LIMIT = math.radians(45.0)
BRAKING = math.radians(1100.0)
RATE = math.radians(220.0)
DOWN = np.array([0.0, 0.0, 1.0])


def tilt_of(attitude: Array) -> float:
    return math.acos(min(rotate(attitude, DOWN)[2], 1.0))


class Turning:
    """A vehicle that turns, with rotors' lag: by torque, by rates with a limited angular acceleration (ArduPilot's
    ATC_ACCEL_R_MAX), or by an attitude loop with limited rates (PX4's MC_ROLLRATE_MAX)."""

    def __init__(self, attitude: Array, rates: Array) -> None:
        self.attitude, self.rates, self.turning = attitude, rates, np.zeros(3)

    def turn(self, out: Array, output: Output) -> None:
        lag, inertia, full = BODY.rotor_time_constant_s, np.array(BODY.inertia_kgm2), np.array(BODY.full_torque_nm)
        for _ in range(4):
            if output is Output.ACTUATORS:
                wanted = (full * out[TORQUE] - np.cross(self.rates, inertia * self.rates)) / inertia
            else:
                rates = out[RATES]
                if output is Output.ATTITUDE:
                    error = to_rotation_vector(multiply(conjugate(self.attitude), out[ATTITUDE]))
                    rates = np.clip(BODY.attitude_loop_gain_1_s * error, -RATE, RATE)
                wanted = np.array(BODY.rate_loop_gain_1_s) * (rates - self.rates)
                if output is Output.RATES:
                    wanted = np.clip(wanted, -BRAKING, BRAKING)
            self.turning = self.turning + 1e-3 / lag * (wanted - self.turning)
            self.rates = self.rates + 1e-3 * self.turning
            self.attitude = multiply(self.attitude, from_rotation_vector(1e-3 * self.rates))


def flown(output: Output, seed: int, start: Array, believed: VehicleParameters = BODY) -> Array:
    """The tilt (rad) tick by tick from the attitude `start`, with accelerations that jump to any up to 20 m/s2."""
    rng = np.random.default_rng(seed)
    controller = Controller(load_settings(None, []), believed, output)
    vehicle, wanted, tilts = Turning(start, np.zeros(3)), np.zeros(3), []
    reference = Reference(np.zeros((6, 3)))
    for tick in range(1500):
        now = START_NS + tick * TICK_NS
        if rng.random() < 0.02:
            wanted = rng.uniform(-1.0, 1.0, 3) * np.array([20.0, 20.0, 8.0])
            reference.rows[5, 0] += rng.uniform(-0.3, 0.3)
        state = VehicleState(now, np.zeros(3), np.zeros(3), vehicle.attitude, vehicle.rates, 0)
        controller.acceleration_command(state, now, now, reference, BODY.mass_kg, True)
        out, _ = controller.attitude_command(wanted, now, reference, BODY.mass_kg)
        assert out.shape == (SIZE,) and np.isfinite(out).all() and out[THRUST] > 0.0
        if output is Output.ATTITUDE:
            assert tilt_of(out[ATTITUDE]) <= LIMIT + 1e-6
        vehicle.turn(out, output)
        tilts.append(tilt_of(vehicle.attitude))
    return np.array(tilts)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("output", Output)
def test_the_tilt_keeps_its_limit_whatever_is_asked_for(output: Output, seed: int) -> None:
    tilts = flown(output, seed, np.array([1.0, 0.0, 0.0, 0.0]))
    assert math.degrees(tilts.max()) < 45.0 + 3.0
    assert math.degrees(tilts.max()) > 35.0


@pytest.mark.parametrize("output", Output)
def test_a_vehicle_of_unknown_loops_is_commanded_less(output: Output) -> None:
    """So that the limit is kept where the estimate of the tilt is wrong by two degrees."""
    unknown = msgspec.structs.replace(BODY, rate_loop_gain_1_s=(0.0, 0.0, 0.0))
    level = np.array([1.0, 0.0, 0.0, 0.0])
    swing, known = (float(flown(output, 0, level, body).max()) for body in (unknown, BODY))
    assert 0.01 < LIMIT - swing < 0.1
    assert known - swing == pytest.approx(0.08 * LIMIT, abs=0.01)


@pytest.mark.parametrize("degrees", [60.0, 100.0, 170.0])
@pytest.mark.parametrize("output", Output)
def test_a_greater_tilt_falls_to_the_limit(output: Output, degrees: float) -> None:
    """After a blow: it never grows, and is within the limit soon."""
    start = from_rotation_vector(math.radians(degrees) * np.array([0.6, 0.8, 0.0]))
    tilts = flown(output, 5, start)
    assert np.degrees(tilts[500:]).max() < 45.0 + 3.0
    assert np.degrees(tilts).max() < degrees + 1.0


def test_the_rate_allowed_stops_on_the_way() -> None:
    """A lag of travel at it and braking from it use up the way; it is odd in the way."""
    for way in (0.01, 0.1, 0.5, 1.5):
        rate = tilt.rate_allowed(way, 16.0)
        assert rate * 0.05 + rate * rate / 32.0 == pytest.approx(way)
        assert tilt.rate_allowed(-way, 16.0) == -rate


def tilted(angle: float, direction: float, yaw: float) -> Array:
    """An attitude with the heading `yaw` that is tilted by `angle` about an axis of the body's plane (rad)."""
    axis = np.array([math.cos(direction), math.sin(direction), 0.0])
    return multiply(from_rotation_vector(yaw * DOWN), from_rotation_vector(angle * axis))


def test_the_tilt_is_the_axis_it_grows_about() -> None:
    """At any heading, and for either sign of the quaternion."""
    for angle, direction, yaw in ((0.3, 0.5, 2.0), (1.0, -2.0, -1.0), (0.7, 3.0, 0.0)):
        for sign in (1.0, -1.0):
            seen = tilt.tilt_ahead(sign * tilted(angle, direction, yaw), np.zeros(3), LIMIT, 16.0)
            assert seen[:2] == pytest.approx((angle * math.cos(direction), angle * math.sin(direction)))


def test_rates_are_reduced_to_what_stops_at_the_limit() -> None:
    """The way along the rates' direction ends on the limit; rates from which a stop is possible pass untouched."""
    rng = np.random.default_rng(1)
    reduced = 0
    for _ in range(300):
        seen = tilt.tilt_ahead(tilted(rng.uniform(0.0, LIMIT), rng.uniform(-3, 3), 1.0), np.zeros(3), LIMIT, 16.0)
        wanted = rng.normal(size=3) * 2.0
        rates = wanted.copy()
        tilt.limit_rates(rates, seen)
        assert rates[2] == wanted[2]
        speed = math.hypot(*rates[:2])
        stop = np.array(seen[:2]) + rates[:2] / speed * (0.05 * speed + speed * speed / 32.0)
        assert np.linalg.norm(stop) < LIMIT + 1e-9
        if (rates != wanted).any():
            reduced += 1
            assert np.linalg.norm(stop) == pytest.approx(LIMIT)
            assert rates[0] * wanted[1] == pytest.approx(rates[1] * wanted[0])
    assert 30 < reduced < 270


def test_an_attitude_within_the_limit_is_left_alone() -> None:
    rng = np.random.default_rng(2)
    for _ in range(200):
        attitude = from_rotation_vector(rng.normal(size=3))
        kept = tilt.within(attitude, LIMIT)
        before = tilt_of(attitude)
        assert tilt_of(kept) == pytest.approx(min(before, LIMIT), abs=1e-6)
        turned = to_rotation_vector(multiply(conjugate(attitude), kept))
        assert np.linalg.norm(turned) == pytest.approx(max(before - LIMIT, 0.0), abs=1e-6)
