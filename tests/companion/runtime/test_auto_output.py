"""A flight whose output is left to the vehicle: what is chosen, what its log says, and that it replays."""

from pathlib import Path

import numpy as np

from companion.logs.recorded import open_flight
from companion.logs.replay import replay
from companion.records import AUDIT
from companion.state import Output, Safety
from protocol.flightlog import LogReader
from protocol.messages import dialect
from tests.companion.runtime import hop

SETPOINTS = "/mavlink/1/191/SET_ATTITUDE_TARGET"


def test_it_flies_on_attitudes_where_the_last_setpoint_is_held_and_replays(tmp_path: Path) -> None:
    autopilot = hop.fly(tmp_path, output=None)
    assert autopilot.supervisor.fault is None and autopilot.link.readiness.output is Output.ATTITUDE
    log = LogReader(tmp_path / hop.LOG)
    findings = [AUDIT.unpack(record.data) for record in log.records((AUDIT.topic,))]
    by_name = {each["parameter"]: each for each in findings}
    assert len(by_name) == len(findings) and by_name["COM_OF_LOSS_T"]["value"] == 1.0
    assert by_name["COM_OF_LOSS_T"]["safety"] == Safety.SAFE
    masks = {int(mask) for mask in np.unique(log.array(SETPOINTS)["type_mask"])}
    assert masks == {dialect.ATTITUDE_TARGET_TYPEMASK_BODY_ROLL_RATE_IGNORE | 6}
    assert open_flight(log.path).output is None
    again = replay(log.path)
    assert again.differences == [] and again.datagrams > 100
