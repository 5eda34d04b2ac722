"""The programs in docs/vehicle-sim.md fly the vehicle to their end."""

import re
from typing import Any

import pytest
from pymavlink import mavutil

from protocol.toml_files import ROOT
from tests.vehicle_sim.served import HOST, PATIENCE_S, served

PACES = pytest.mark.parametrize("pace", [1.0, 5.0])
PAGE = (ROOT / "docs" / "vehicle-sim.md").read_text(encoding="utf-8")
MAVSDK, PYMAVLINK, *_ = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)


@PACES
def test_mavsdk(pace: float) -> None:
    pytest.importorskip("mavsdk")
    with served(pace) as vehicle:
        program = MAVSDK.replace("udpin://127.0.0.1:14540", f"udpout://{HOST}:{vehicle.port}")
        names: dict[str, Any] = {}
        try:
            exec(program.replace("(10.0)", f"({PATIENCE_S})"), names)
        finally:
            names["mavsdk"].destroy()
        assert vehicle.flown.finished and vehicle.flown.crash is None


@PACES
def test_pymavlink(pace: float, monkeypatch: pytest.MonkeyPatch) -> None:
    listening = mavutil.mavlink_connection(f"udpin:{HOST}:0")
    monkeypatch.setattr(mavutil, "mavlink_connection", {"udpin:127.0.0.1:14540": listening}.__getitem__)
    with served(pace, listening.port.getsockname()) as vehicle:
        exec(PYMAVLINK, {})
        assert vehicle.flown.finished and vehicle.flown.crash is None
    listening.close()
