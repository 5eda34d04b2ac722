"""The runner: lockstep and timed runs on a manual clock, and lockstep over real UDP."""

import time

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from protocol.guarded_link import GuardedLink
from protocol.key_files import Keeper
from protocol.messages import Encoder
from protocol.transport import Memory, Udp
from tests.vehicle_sim.foreign_pilot import AIRFRAME, EMPTY
from tests.vehicle_sim.scripted_companion import (
    UNSET,
    ManualLink,
    ScriptedCompanion,
    UdpCompanion,
    command,
    hop,
    offboard_until,
    started,
)
from vehicle_sim import runner
from vehicle_sim.runner import Runner
from vehicle_sim.timing import TICK_NS
from vehicle_sim.vehicle import Summary, Vehicle, warm_up


@pytest.fixture(scope="module", autouse=True)
def warm() -> None:
    warm_up(AIRFRAME, EMPTY)


def fly_lockstep(companion: ScriptedCompanion) -> tuple[Summary, ManualLink]:
    vehicle, link = Vehicle(AIRFRAME, EMPTY, lockstep=True), ManualLink(companion.answer)
    Runner(vehicle, link, once=True, monotonic_ns=link.monotonic_ns).run_lockstep()
    return vehicle.summary(), link


def fly_lockstep_over_udp(companion: UdpCompanion) -> Summary:
    vehicle = Vehicle(AIRFRAME, EMPTY, lockstep=True)
    transport = Udp("127.0.0.1", companion.port, bind=False)
    try:
        # a slow clock: however slow the machine, the companion is waited for
        Runner(vehicle, transport, once=True, monotonic_ns=lambda: time.monotonic_ns() // 100).run_lockstep()
    finally:
        transport.close()
    return vehicle.summary()


def silent(_: bytes) -> bytes:
    return b""


# --- over UDP ---


def test_a_flight_in_lockstep_ends_after_its_last_telemetry() -> None:
    with started(UdpCompanion(hop)) as companion:
        summary = fly_lockstep_over_udp(companion)
    assert (summary.outcome, summary.contacts) == ("landed", 0)
    assert summary.flight_time_s > 1.0
    assert "Disarmed by landing" in companion.texts
    ticks = round(summary.simulated_s * 1e9) // TICK_NS
    assert len(companion.heard) >= ticks


def test_lockstep_over_udp_is_lockstep_in_memory() -> None:
    """The same datagrams, however often the slower one made the vehicle send a tick again."""
    in_memory = ScriptedCompanion(hop)
    fly_lockstep(in_memory)
    with started(UdpCompanion(hop)) as companion:
        fly_lockstep_over_udp(companion)
    assert list(dict.fromkeys(companion.heard)) == in_memory.heard


# --- lockstep with a companion that is not always there ---


def test_the_first_tick_is_sent_again_until_somebody_answers() -> None:
    companion = ScriptedCompanion(hop, deaf_to=2)
    summary, link = fly_lockstep(companion)
    assert companion.heard[0] == companion.heard[1] == companion.heard[2] != companion.heard[3]
    assert link.sent_at_ns[:3] == pytest.approx([0.0, 1e9 * runner.FIRST_RESEND_S, 2e9 * runner.FIRST_RESEND_S])
    assert summary.outcome == "landed"


def test_without_its_companion_the_vehicle_holds_and_lands_alone() -> None:
    companion = ScriptedCompanion(offboard_until(1200))
    summary, link = fly_lockstep(companion)
    assert summary.outcome == "landed"
    assert summary.simulated_s > 1200 * 0.004 + 6.0
    resends = round(runner.ANSWER_TIMEOUT_S / runner.RESEND_S)
    assert companion.heard[1200 : 1200 + resends] == [companion.heard[1200]] * resends
    assert companion.heard[1200 + resends] != companion.heard[1200]
    assert link.now_ns == pytest.approx(1e9 * runner.ANSWER_TIMEOUT_S), "it waits for one tick alone"
    assert {"Failsafe: offboard stream lost, holding", "Failsafe: offboard stream lost, landing"} <= set(
        companion.texts
    )


def test_a_companion_that_comes_back_is_waited_for_again() -> None:
    flying = offboard_until(1200)
    answered: list[int] = []

    def script(tick: int) -> list[object] | None:
        if 1200 < tick < 1300:
            return None
        answered.append(tick)
        return flying(tick) if tick <= 1200 else []

    summary, _ = fly_lockstep(ScriptedCompanion(script))
    assert summary.outcome == "landed"
    after = [tick for tick in answered if tick >= 1300]
    assert len(after) > 1000
    assert after == list(range(after[0], after[0] + len(after))), "each tick is answered once, none is left out"


# --- ends ---


@pytest.mark.parametrize("lockstep", [True, False])
def test_a_vehicle_that_hears_nobody_ends_on_the_ground(lockstep: bool) -> None:
    vehicle, link = Vehicle(AIRFRAME, EMPTY, lockstep=lockstep), ManualLink(silent)
    run = Runner(vehicle, link, once=True, monotonic_ns=link.monotonic_ns)
    run.run_lockstep() if lockstep else run.run_timed(1.0)
    assert vehicle.summary().outcome == "stopped"
    assert runner.SILENCE_TIMEOUT_S < link.now_ns * 1e-9 < runner.SILENCE_TIMEOUT_S + 1.0


@pytest.mark.parametrize("lockstep", [True, False])
def test_a_peer_that_leaves_before_the_start_is_waited_for_a_shorter_time(lockstep: bool) -> None:
    first = [b"here"]
    vehicle = Vehicle(AIRFRAME, EMPTY, lockstep=lockstep)
    link = ManualLink(lambda _: first.pop() if first else b"")
    run = Runner(vehicle, link, once=True, monotonic_ns=link.monotonic_ns)
    run.run_lockstep() if lockstep else run.run_timed(1.0)
    assert vehicle.summary().outcome == "stopped"
    assert runner.SILENCE_TIMEOUT_DISARMED_S < link.now_ns * 1e-9 < runner.SILENCE_TIMEOUT_DISARMED_S + 1.0


def test_the_time_before_the_run_is_no_silence() -> None:
    """Compiling may take longer than the longest silence."""
    companion = ScriptedCompanion(hop)
    vehicle, link = Vehicle(AIRFRAME, EMPTY, lockstep=True), ManualLink(companion.answer)
    run = Runner(vehicle, link, once=True, monotonic_ns=link.monotonic_ns)
    link.now_ns += round(10e9 * runner.SILENCE_TIMEOUT_S)
    run.run_lockstep()
    assert vehicle.summary().outcome == "landed"


# --- timed ---


@pytest.mark.parametrize("factor", [0.5, 1.0, 25.0])
def test_a_timed_run_keeps_the_pace_of_its_clock(factor: float) -> None:
    """Commands come when they come; each tick is sent when the clock has reached its time."""
    reader, writer = mavlink.MAVLink(None), mavlink.MAVLink(None, 1, 191)
    results: dict[int, int] = {}

    def answer(datagram: bytes) -> bytes:
        out = b""
        for message in reader.parse_buffer(datagram) or []:
            if message.get_type() == "COMMAND_ACK":
                results[message.command] = message.result
            if message.get_type() != "ATTITUDE_QUATERNION" or message.time_boot_ms < 1100:
                continue
            for number, params in ((22, (UNSET,) * 7), (400, (1.0,)), (21, ())):
                if number not in results and (number != 21 or message.time_boot_ms > 3000):
                    out += command(number, *params).pack(writer)  # type: ignore[attr-defined]
        return out

    vehicle, link = Vehicle(AIRFRAME, EMPTY), ManualLink(answer)
    Runner(vehicle, link, once=True, monotonic_ns=link.monotonic_ns).run_timed(factor)
    assert vehicle.summary().outcome == "landed"
    assert results == {22: 0, 400: 0, 21: 0}
    assert link.now_ns * factor == pytest.approx(vehicle.time_ns, rel=1e-3)


def test_a_late_timed_run_catches_up() -> None:
    """A pause of the machine is made up for by ticks without a pause between them."""
    pause_ns = 400_000_000
    vehicle = Vehicle(AIRFRAME, EMPTY)
    link = ManualLink(silent)
    paused: list[int] = []

    def monotonic_ns() -> int:
        if not paused and vehicle.tick == 100:
            paused.append(len(link.sent_at_ns))
            link.now_ns += pause_ns
        return link.now_ns

    Runner(vehicle, link, once=True, monotonic_ns=monotonic_ns).run_timed(1.0)
    assert paused
    assert link.now_ns == pytest.approx(vehicle.time_ns, abs=2 * TICK_NS)


# --- keys ---


@pytest.mark.parametrize("takes_keys", [True, False])
def test_a_key_is_taken_from_this_machine_only(takes_keys: bool) -> None:
    """With one, an unsigned order is none; who has it is obeyed, and may end signing by a key of zeros."""
    key = bytes(range(1, 33))
    near, far = Memory.pair()
    pilot, vehicle = GuardedLink(near), Vehicle(AIRFRAME, EMPTY)
    link, sender = GuardedLink(far), Encoder(1, 191)
    run = Runner(vehicle, link, once=True, takes_keys=takes_keys)

    def setup(secret: bytes, system: int = 1) -> bytes:
        return sender.encode_fields(mavlink.MAVLink_setup_signing_message, system, 1, list(secret), 0)

    def is_heard(datagram: bytes) -> bool:
        pilot.send(datagram)
        return run._receive(link, 0.0)

    assert is_heard(sender.encode_fields(mavlink.MAVLink_ping_message, 1, 1, 0, 0))
    assert not is_heard(setup(key, system=9)) and not link.signed
    assert not is_heard(setup(key))
    assert link.signed == takes_keys
    if not takes_keys:
        return
    assert not is_heard(setup(bytes(32))) and link.signed  # it is not signed
    assert not is_heard(sender.encode_fields(mavlink.MAVLink_ping_message, 1, 1, 0, 0))
    pilot.use(Keeper(key))
    assert is_heard(sender.encode_fields(mavlink.MAVLink_ping_message, 1, 1, 0, 0))
    assert not is_heard(setup(bytes(32)))
    assert not link.signed
