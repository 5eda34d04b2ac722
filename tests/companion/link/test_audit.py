"""The settings audit: what must be so, what is unsafe, what is said of it, and which output follows."""

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.config import Supervision
from companion.link.audit import LONGEST_HOLD_OF_RATES_S, Audit
from companion.link.firmware.ardupilot import FIRMWARE as ARDUPILOT
from companion.link.firmware.firmware import Firmware, Terms
from companion.link.firmware.px4 import FIRMWARE as PX4
from companion.link.vehicle_link import VehicleLink
from companion.reports import Finding
from companion.state import NO_FENCE, Announcement, Output, OwnFence, Safety, Setpoint, Severity
from protocol.framing import Framer
from protocol.messages import decode, dialect
from tests.companion.link.sender import (
    ARDUPILOT as ARDUPILOT_ID,
)
from tests.companion.link.sender import MS, NOW, SECOND, SETTINGS, Sender, hear, names, sent

TERMS = Terms(None, 1, 45.0, 0.8)
SAFE: dict[str, dict[str, float]] = {
    "PX4": {
        "COM_OF_LOSS_T": 1.0,
        "COM_OBL_RC_ACT": 0.0,
        "COM_RCL_EXCEPT": 0.0,
        "COM_DISARM_LAND": 2.0,
        "MPC_THR_HOVER": 0.5,
        "MPC_TILTMAX_AIR": 45.0,
        "FD_FAIL_P": 60.0,
        "FD_FAIL_R": 60.0,
        "CBRK_FLIGHTTERM": 121212.0,
        "GF_MAX_HOR_DIST": 0.0,
        "GF_MAX_VER_DIST": 0.0,
    },
    "ArduPilot": {
        "GUID_OPTIONS": 8.0,
        "GUID_TIMEOUT": 1.0,
        "FS_GCS_ENABLE": 5.0,
        "MAV_GCS_SYSID": 1.0,
        "ATC_ANGLE_BOOST": 1.0,
        "ATC_ANGLE_MAX": 30.0,
        "MOT_THST_HOVER": 0.35,
        "FENCE_ENABLE": 1.0,
        "FENCE_TYPE": 7.0,
        "FENCE_TOTAL": 0.0,
        "FENCE_ALT_MAX": 100.0,
        "FENCE_RADIUS": 300.0,
        "FENCE_MARGIN": 2.0,
    },
}
FIRMWARES = [PX4, ARDUPILOT]
NO_VALUE = -1e9
"""Stands for a parameter that the vehicle does not have."""


def audited(firmware: Firmware, terms: Terms = TERMS, /, **changes: float) -> dict[str, Finding]:
    values = {name: value for name, value in {**SAFE[firmware.name], **changes}.items() if value != NO_VALUE}
    return {each.parameter: each for each in firmware.audit(values, terms)}


def worst(firmware: Firmware, terms: Terms = TERMS, /, **changes: float) -> dict[str, Safety]:
    """What is not safe."""
    return {
        name: each.safety
        for name, each in audited(firmware, terms, **changes).items()
        if each.safety is not Safety.SAFE
    }


@pytest.mark.parametrize("firmware", FIRMWARES, ids=lambda firmware: firmware.name)
def test_a_vehicle_as_it_should_be_is_safe(firmware: Firmware) -> None:
    assert worst(firmware) == {}
    asked = {name for question in firmware.parameters for name in question}
    assert set(SAFE[firmware.name]) <= asked, "what is judged is read"
    assert firmware.hold_parameter in asked


@pytest.mark.parametrize(
    ("firmware", "changes", "safety"),
    [
        (PX4, {"COM_OF_LOSS_T": 3.0}, Safety.UNSAFE),
        (PX4, {"COM_OF_LOSS_T": 0.0}, Safety.UNSAFE),
        (PX4, {"COM_OF_LOSS_T": 0.8}, Safety.UNSAFE),
        (PX4, {"COM_OBL_RC_ACT": 1.0}, Safety.UNSAFE),
        (PX4, {"COM_OBL_RC_ACT": 5.0}, Safety.UNSAFE),
        (PX4, {"COM_OBL_RC_ACT": 6.0}, Safety.REFUSED),
        (PX4, {"COM_OBL_RC_ACT": 7.0}, Safety.REFUSED),
        (PX4, {"COM_DISARM_LAND": 0.0}, Safety.UNSAFE),
        (PX4, {"COM_DISARM_LAND": -1.0}, Safety.UNSAFE),
        (ARDUPILOT, {"GUID_OPTIONS": 0.0}, Safety.REFUSED),
        (ARDUPILOT, {"GUID_OPTIONS": 7.0}, Safety.REFUSED),
        (ARDUPILOT, {"GUID_OPTIONS": NO_VALUE}, Safety.REFUSED),
        (ARDUPILOT, {"GUID_TIMEOUT": 3.0}, Safety.UNSAFE),
        (ARDUPILOT, {"FS_GCS_ENABLE": 0.0}, Safety.UNSAFE),
        (ARDUPILOT, {"MAV_GCS_SYSID": 255.0}, Safety.UNSAFE),
    ],
)
def test_one_wrong_parameter_is_the_one_that_is_named(
    firmware: Firmware, changes: dict[str, float], safety: Safety
) -> None:
    ((name, value),) = changes.items()
    assert worst(firmware, **changes) == {name: safety}
    finding = audited(firmware, **changes)[name]
    assert finding.value == (None if value == NO_VALUE else value)
    assert finding.wanted and finding.why


@pytest.mark.parametrize("firmware", FIRMWARES, ids=lambda firmware: firmware.name)
def test_what_is_not_known_is_not_safe(firmware: Firmware) -> None:
    for name in SAFE[firmware.name]:
        if name == "CBRK_FLIGHTTERM":
            continue  # judged with what it switches off
        assert worst(firmware, **{name: NO_VALUE}).popitem()[1] is not Safety.SAFE


@given(options=st.integers(0, 255))
@settings(max_examples=50)
def test_thrust_must_be_thrust_whatever_else_is_set(options: int) -> None:
    assert ("GUID_OPTIONS" in worst(ARDUPILOT, GUID_OPTIONS=float(options))) is not bool(options & 8)


def test_whose_heartbeats_ardupilot_watches_matters_where_it_acts_on_them() -> None:
    assert "MAV_GCS_SYSID" not in worst(ARDUPILOT, FS_GCS_ENABLE=0.0, MAV_GCS_SYSID=255.0)
    assert worst(ARDUPILOT, Terms(None, 255, 45.0), MAV_GCS_SYSID=255.0) == {}
    older = {"MAV_GCS_SYSID": NO_VALUE, "SYSID_MYGCS": 255.0, "ATC_ANGLE_MAX": NO_VALUE, "ANGLE_MAX": 3000.0}
    assert worst(ARDUPILOT, **older) == {"SYSID_MYGCS": Safety.UNSAFE}


def test_the_failure_detector_counts_where_it_can_end_a_flight() -> None:
    assert set(worst(PX4, CBRK_FLIGHTTERM=0.0, FD_FAIL_P=40.0, FD_FAIL_R=45.0)) == {"FD_FAIL_P", "FD_FAIL_R"}
    assert worst(PX4, CBRK_FLIGHTTERM=0.0) == {}
    assert worst(PX4, CBRK_FLIGHTTERM=0.0, FD_FAIL_P=0.0) == {}
    assert worst(PX4, FD_FAIL_P=40.0) == {}


@given(value=st.floats(-1e38, 1e38), firmware=st.sampled_from(FIRMWARES), data=st.data())
@settings(max_examples=200)
def test_any_value_can_be_judged(value: float, firmware: Firmware, data: st.DataObject) -> None:
    name = data.draw(st.sampled_from(sorted(SAFE[firmware.name])))
    values = {**SAFE[firmware.name], name: value}
    found = [each.parameter for each in firmware.audit(values, TERMS)]
    assert len(set(found)) == len(found)
    if not name.startswith("FENCE_"):
        assert found == [each.parameter for each in firmware.audit(SAFE[firmware.name], TERMS)]
    known = firmware.settings(values)
    assert known.setpoint_hold is None or 0.0 <= known.setpoint_hold <= 1e3
    assert known.fence.radius > 0.0 and known.fence.max_height > 0.0 and known.fence.margin >= 0.0


def test_what_the_autopilot_is_told_is_in_its_units() -> None:
    px4 = PX4.settings(SAFE["PX4"])
    assert (px4.setpoint_hold, px4.angle_boost) == (1.0, False)
    ardupilot = ARDUPILOT.settings({"GUID_TIMEOUT": 3.0, "ATC_ANGLE_BOOST": 0.0})
    assert (ardupilot.setpoint_hold, ardupilot.angle_boost) == (3.0, False)
    assert ARDUPILOT.settings({}).angle_boost


# -- the vehicle's own fence -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("firmware", "changes", "fence"),
    [
        (PX4, {}, NO_FENCE),
        (PX4, {"GF_MAX_HOR_DIST": 80.0}, OwnFence(radius=80.0)),
        (PX4, {"GF_MAX_VER_DIST": 30.0}, OwnFence(max_height=30.0)),
        (PX4, {"GF_MAX_VER_DIST": NO_VALUE, "GF_MAX_HOR_DIST": -1.0}, NO_FENCE),
        (ARDUPILOT, {}, OwnFence(300.0, 100.0, margin=2.0)),
        (ARDUPILOT, {"FENCE_ENABLE": 0.0}, NO_FENCE),
        (ARDUPILOT, {"FENCE_ENABLE": 0.0, "FENCE_AUTOENABLE": 3.0}, OwnFence(300.0, 100.0, margin=2.0)),
        (ARDUPILOT, {"FENCE_TYPE": 1.0}, OwnFence(max_height=100.0, margin=2.0)),
        (ARDUPILOT, {"FENCE_TYPE": 2.0}, OwnFence(300.0, margin=2.0)),
        (ARDUPILOT, {"FENCE_TYPE": 8.0, "FENCE_ALT_MIN": -10.0}, OwnFence(min_height=-10.0, margin=2.0)),
        (ARDUPILOT, {"FENCE_ALT_MIN": 5.0, "FENCE_MARGIN": NO_VALUE}, OwnFence(300.0, 100.0)),
    ],
)
def test_the_vehicle_s_own_fence_is_known(firmware: Firmware, changes: dict[str, float], fence: OwnFence) -> None:
    values = {name: value for name, value in {**SAFE[firmware.name], **changes}.items() if value != NO_VALUE}
    assert firmware.settings(values).fence == fence


def test_what_is_not_known_of_a_fence_is_told_where_it_is_up() -> None:
    assert worst(ARDUPILOT, FENCE_RADIUS=NO_VALUE) == {"FENCE_RADIUS": Safety.UNSAFE}
    assert worst(ARDUPILOT, FENCE_TYPE=1.0, FENCE_RADIUS=NO_VALUE) == {}
    assert worst(ARDUPILOT, FENCE_ENABLE=0.0, FENCE_RADIUS=NO_VALUE) == {}


def test_an_uploaded_fence_is_told_of_as_one_that_is_not_read() -> None:
    assert worst(ARDUPILOT, FENCE_TOTAL=6.0) == {"FENCE_TYPE": Safety.UNSAFE}
    assert worst(ARDUPILOT, FENCE_TOTAL=6.0, FENCE_TYPE=3.0) == {}
    assert worst(ARDUPILOT, FENCE_TOTAL=6.0, FENCE_ENABLE=0.0) == {}
    _, said = concluded(ARDUPILOT, None, FENCE_TOTAL=6.0)
    assert any("FENCE_TYPE is 7" in each.text and "not read" in each.text for each in said)


# -- the output --------------------------------------------------------------------------------------------------------


def concluded(firmware: Firmware, asked: Output | None, **changes: float) -> tuple[Audit, list[Announcement]]:
    audit = Audit(firmware, Terms(asked, 1, 45.0), Supervision())
    vehicle = Sender()
    values = {**SAFE[firmware.name], **changes}
    for question in firmware.parameters:
        name = question[0]
        value = values.get(name, NO_VALUE)
        data = vehicle.parameter_error(name) if value == NO_VALUE else vehicle.parameter(name, value)
        (frame,) = Framer().datagram(data)
        (audit.refuse if value == NO_VALUE else audit.take)(decode(frame))
    asked_for, said = audit.go_on(NOW)
    assert asked_for == [] and audit.done
    return audit, said


@pytest.mark.parametrize("firmware", FIRMWARES, ids=lambda firmware: firmware.name)
@pytest.mark.parametrize(
    ("hold", "expected"),
    [
        (LONGEST_HOLD_OF_RATES_S, Output.RATES),
        (0.1, Output.RATES),
        (0.31, Output.ATTITUDE),
        (3.0, Output.ATTITUDE),
        (NO_VALUE, Output.ATTITUDE),
    ],
)
def test_rates_are_chosen_only_where_the_vehicle_soon_drops_the_last_one(
    firmware: Firmware, hold: float, expected: Output
) -> None:
    audit, said = concluded(firmware, None, **{firmware.hold_parameter: hold})
    assert audit.output is expected
    assert said[-1].severity is Severity.INFO and expected.value in said[-1].text


@pytest.mark.parametrize("firmware", FIRMWARES, ids=lambda firmware: firmware.name)
def test_an_attitude_that_was_asked_for_is_flown_however_soon_the_last_one_is_dropped(firmware: Firmware) -> None:
    assert concluded(firmware, Output.ATTITUDE, **{firmware.hold_parameter: 0.1})[0].output is Output.ATTITUDE


@pytest.mark.parametrize("firmware", FIRMWARES, ids=lambda firmware: firmware.name)
@pytest.mark.parametrize("hold", [0.2, 1.0, NO_VALUE])
def test_rates_that_were_asked_for_are_flown_and_the_time_is_named(firmware: Firmware, hold: float) -> None:
    audit, said = concluded(firmware, Output.RATES, **{firmware.hold_parameter: hold})
    assert audit.output is Output.RATES
    last = said[-1]
    assert last.severity is (Severity.INFO if hold == 0.2 else Severity.WARNING)
    assert firmware.hold_parameter in last.text
    assert ("unknown" if hold == NO_VALUE else f"{hold:g} s") in last.text[:50], "a STATUSTEXT has 50 letters"


def test_what_is_unsafe_is_warned_of_with_its_value_and_what_is_wanted() -> None:
    audit, said = concluded(ARDUPILOT, None, GUID_TIMEOUT=3.0, FS_GCS_ENABLE=0.0, MOT_THST_HOVER=NO_VALUE)
    warned = [each.text for each in said if each.severity is Severity.WARNING]
    assert len(warned) == 3 and audit.refusal is None
    assert warned[0].startswith("GUID_TIMEOUT is 3, wanted: at most 1 s")
    assert warned[1].startswith("FS_GCS_ENABLE is 0, wanted: 5 (land)")
    assert warned[2] == "not known of the vehicle: MOT_THST_HOVER"


def test_a_refusal_has_parameter_value_wish_and_reason() -> None:
    audit, _ = concluded(ARDUPILOT, None, GUID_OPTIONS=0.0)
    assert audit.refusal == ("GUID_OPTIONS is 0, wanted: bit 3 (8) set; without it thrust is taken as a climb rate")


# -- over the link -----------------------------------------------------------------------------------------------------


class Vehicle(Sender):
    """Answers requests for its parameters."""

    def __init__(self, firmware: Firmware, autopilot: int) -> None:
        super().__init__()
        self.values = dict(SAFE[firmware.name])
        self.autopilot = autopilot

    def answer(self, messages: list[Any]) -> bytes:
        data = b""
        for message in messages:
            if message.get_type() == "PARAM_REQUEST_READ":
                assert (message.target_system, message.target_component, message.param_index) == (1, 1, -1)
                name = message.param_id
                data += self.parameter(name, self.values[name]) if name in self.values else b""
        return data


def meet(vehicle: Vehicle, output: Output | None = None) -> VehicleLink:
    link = VehicleLink(SETTINGS, output)
    hear(link, vehicle.heartbeat(vehicle.autopilot))
    return link


def settle(link: VehicleLink, vehicle: Vehicle, seconds: float = 10.0) -> list[str]:
    """What is said until the parameters are known."""
    said = []
    for ms in range(0, round(seconds * 1e3), 20):
        now = NOW + ms * MS
        said += [each.text for each in link.beat(now, asks_rates=False)]
        hear(link, vehicle.answer(sent(link)), now)
    return said


@pytest.mark.parametrize(("firmware", "autopilot"), [(PX4, dialect.MAV_AUTOPILOT_PX4), (ARDUPILOT, ARDUPILOT_ID)])
def test_a_flight_waits_until_the_parameters_are_known(firmware: Firmware, autopilot: int) -> None:
    vehicle = Vehicle(firmware, autopilot)
    link = meet(vehicle)
    hear(link, vehicle.version(1, 14))
    waiting = link.report(NOW, None, before_flight=True).shortcoming or ""
    assert "parameters are being read (0 of" in waiting
    assert len(settle(link, vehicle)) == 1, "all is safe: only the output is named"
    assert "parameters" not in (link.report(NOW, None, before_flight=True).shortcoming or "")
    audit = link.readiness.audit
    assert audit is not None and audit.vehicle == firmware.settings(SAFE[firmware.name])


def test_the_flight_is_refused_at_once_without_waiting_for_telemetry() -> None:
    vehicle = Vehicle(ARDUPILOT, ARDUPILOT_ID)
    vehicle.values["GUID_OPTIONS"] = 0.0
    link = meet(vehicle)
    settle(link, vehicle)
    refusal = link.report(NOW, None, before_flight=True).refusal
    assert refusal is not None and refusal.startswith("GUID_OPTIONS is 0")
    assert link.report(NOW, None, before_flight=False).refusal is None


@pytest.mark.parametrize("stranger", [Sender(2, 1), Sender(1, 2), Sender(255, 190)])
def test_answers_of_others_count_for_nothing(stranger: Sender) -> None:
    vehicle = Vehicle(ARDUPILOT, ARDUPILOT_ID)
    link = meet(vehicle)
    hear(link, stranger.parameter("GUID_OPTIONS", 0.0) + stranger.parameter_error("GUID_TIMEOUT"))
    hear(link, vehicle.parameter_error("GUID_OPTIONS", system=255))  # to a ground station
    settle(link, vehicle)
    assert link.report(NOW, None, before_flight=True).refusal is None
    audit = link.readiness.audit
    assert audit is not None and all(each.safety is Safety.SAFE for each in audit.findings)


def test_a_vehicle_without_parameters_is_known_to_have_none() -> None:
    vehicle = Vehicle(PX4, dialect.MAV_AUTOPILOT_PX4)
    vehicle.values.clear()
    link = meet(vehicle)
    said = settle(link, vehicle, 15.0)
    assert len(said) == 2 and said[0].startswith("not known of the vehicle: COM_OF_LOSS_T")
    assert link.report(NOW, None, before_flight=True).refusal is None


@pytest.mark.parametrize(("hold", "mask"), [(0.2, 0x80), (1.0, 0x07)])
def test_setpoints_go_out_on_the_output_that_was_chosen(hold: float, mask: int) -> None:
    vehicle = Vehicle(PX4, dialect.MAV_AUTOPILOT_PX4)
    vehicle.values["COM_OF_LOSS_T"] = hold
    link = meet(vehicle)
    settle(link, vehicle)
    link.outbox.setpoint(Setpoint([1.0, 0.0, 0.0, 0.0], [0.0] * 3, [0.0] * 3, 0.5), 1234)
    (message,) = sent(link)
    assert message.type_mask == mask


def test_after_a_reboot_the_parameters_are_read_again() -> None:
    vehicle = Vehicle(PX4, dialect.MAV_AUTOPILOT_PX4)
    link = meet(vehicle)
    settle(link, vehicle)
    hear(link, vehicle.quaternion(60_000), NOW + 11 * SECOND)
    vehicle.values["COM_OF_LOSS_T"] = 0.2
    hear(link, vehicle.quaternion(1_000), NOW + 12 * SECOND)
    link.beat(NOW + 12 * SECOND, asks_rates=False)
    assert "PARAM_REQUEST_READ" in names(sent(link))
