"""A mission that releases a parcel at two places, both sides joined in memory."""

from typing import Any

from companion.mission.plan import Mission, Phase, Waypoint, all_delivered
from companion.supervision.operations import LandRequest
from protocol.framing import Framer
from protocol.messages import Encoder, decode, dialect
from studies.joined import Joined
from tests.flights.short import returning

MISSION = Mission(
    "two-parcels", waypoints=[Waypoint(2.0, 0.0, 3.0, release=True), Waypoint(4.0, 0.0, 3.0, release=True)]
)


def test_what_came_of_the_first_parcel_says_nothing_of_the_second() -> None:
    """The vehicle releases the first one, and denies the second."""
    vehicle, answers = Encoder(1, 1), list[int]()

    def deny(time_ns: int, data: bytes) -> bytes:
        sent = b""
        for frame in Framer().datagram(data):
            message: Any = decode(frame)
            if message.get_type() == "COMMAND_ACK" and message.command == dialect.MAV_CMD_DO_GRIPPER:
                answers.append(message.result)
                if len(answers) > 1:
                    message.result = dialect.MAV_RESULT_DENIED
                vehicle.sequence = frame.sequence
                sent += vehicle.encode(message)
            else:
                sent += frame.raw
        return sent

    joined = Joined(MISSION, overrides=("avoidance.method=none",), meddle=deny).fly(until=returning)
    told = [text.split(maxsplit=1)[1] for text in joined.said if "parcel" in text and "vehicle:" not in text]
    assert told == ["parcel released", "parcel not released: denied"]
    assert len(answers) > 2, "it was asked again"
    navigator = joined.autopilot.navigator
    assert all_delivered(MISSION, navigator.steps, navigator.released) is False


def test_a_parcel_whose_release_is_answered_after_the_mission_was_ended_is_delivered() -> None:
    joined = Joined(MISSION, overrides=("avoidance.method=none",))
    joined.fly(until=lambda joined: joined.autopilot.navigator.phase is Phase.RELEASE)
    joined._driver.handle(LandRequest(joined.vehicle.time_ns))
    joined.fly(limit_s=60.0)
    assert joined.vehicle.summary().released and joined.autopilot.navigator.released == 1, joined.said
