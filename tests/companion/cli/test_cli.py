"""What the command line says to whoever interrupts it."""

from typing import Any

import pytest
from typer.testing import CliRunner

from companion.cli.app import app


@pytest.mark.parametrize(
    ("function", "command", "flies"),
    [
        ("companion.runtime.demo.prepare", ["demo", "hover"], False),
        ("companion.runtime.flight.prepare", ["fly", "hover", "--connect", "udpin:127.0.0.1:0"], False),
        ("companion.runtime.flight.fly", ["fly", "hover", "--connect", "udpin:127.0.0.1:0"], True),
    ],
)
def test_of_a_vehicle_in_the_air_only_a_flight_speaks(
    function: str, command: list[str], flies: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*arguments: Any, **options: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("companion.runtime.flight.prepare", lambda plan: None)
    monkeypatch.setattr(function, interrupted)
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 130 and "companion: abandoned" in done.output
    assert ("in the air" in done.output) == flies
