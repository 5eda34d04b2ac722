"""The command that reads the vehicle's parameters without flying: check."""

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from companion.cli.flights import (
    DEFAULT_URL,
    ConnectUrl,
    KeyFile,
    OutputName,
    SettingsFile,
    VehicleSystem,
    security_of,
)
from companion.cli.options import Insecure, options
from companion.cli.shell import exit_as_failed, exit_on_interrupt, exit_on_user_error
from companion.cli.values import output_of, pinned

if TYPE_CHECKING:
    from companion.reports import Finding
    from companion.runtime.check import Examination


@dataclass(frozen=True, slots=True)
class CheckOptions:
    """What `companion check` is asked for."""

    connect: ConnectUrl = DEFAULT_URL
    vehicle: VehicleSystem = None
    signing_key: KeyFile = None
    insecure: Insecure = False
    output: OutputName = "auto"
    settings: SettingsFile = None
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", help="Change one setting: --set limits.tilt_deg=30", metavar="KEY=VALUE"),
    ] = None
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object in place of the table.")] = False


def register(app: typer.Typer) -> None:
    """Add the command to the program."""
    app.command()(check)


@options(CheckOptions)
def check(asked: CheckOptions) -> None:
    """Read the parameters of the vehicle that answers at a URL, and say whether a flight with it would be refused
    (exit code 1) or unsafe. Nothing is flown or changed."""
    with exit_on_interrupt("companion: abandoned"):
        from companion.runtime.check import examine
        from companion.runtime.files import load_settings
        from companion.runtime.side_links import open_vehicle_link, unheard

        overrides = [*(asked.overrides or ()), *pinned(asked.vehicle)]
        settings = exit_on_user_error(load_settings, asked.settings, overrides)
        output = exit_on_user_error(output_of, asked.output)
        security = exit_on_user_error(security_of, asked.signing_key, asked.insecure)
        transport = exit_on_user_error(open_vehicle_link, asked.connect, security, settings.identity.vehicle)
        try:
            found = exit_on_user_error(examine, settings, output, transport)
        finally:
            transport.close()
    if asked.as_json:
        typer.echo(json.dumps(_record(found)))
    elif found.vehicle:
        _show(found)
    if found.refusal is not None:
        where = unheard(asked.connect, settings.identity.vehicle)
        exit_as_failed(found.refusal if found.vehicle else f"{found.refusal} at {where}")


def _record(found: "Examination") -> dict[str, object]:
    return {
        "vehicle": found.vehicle,
        "output": found.output.value,
        "refusal": found.refusal,
        "findings": [
            {
                "parameter": each.parameter,
                "value": each.value,
                "wanted": each.wanted,
                "why": each.why,
                "verdict": each.safety.name.lower(),
            }
            for each in found.findings
        ],
    }


def _show(found: "Examination") -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table(
        "parameter", "value", "wanted", "why", "verdict", title=f"{found.vehicle}, output {found.output.value}"
    )
    for each in found.findings:
        table.add_row(each.parameter, _value(each), each.wanted or "any", each.why, each.safety.name.lower())
    Console().print(table)


def _value(finding: "Finding") -> str:
    return "not known" if finding.value is None else f"{finding.value:g}"
