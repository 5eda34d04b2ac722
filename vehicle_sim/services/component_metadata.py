"""The component metadata (https://mavlink.io/en/services/component_metadata.html): what parameters there are and mean.

The files go by MAVLink FTP. COMPONENT_METADATA names the general one, which names the other.
"""

import json

from vehicle_sim.services.checksum import crc32
from vehicle_sim.services.parameter_store import OBEYED, Parameters
from vehicle_sim.services.parameter_table import TABLE

GENERAL_FILE, PARAMETER_FILE = "general.json", "parameters.json"
GENERAL_URI = f"mftp:///{GENERAL_FILE}"

_PARAMETER_TYPE = 1
"""COMP_METADATA_TYPE_PARAMETER."""


def parameter_metadata(parameters: Parameters) -> bytes:
    """The parameters' file: of each its type, default, limits, and whether the vehicle does something about it."""
    return _json({"version": 1, "parameters": [_described(parameters, name) for name in parameters.names]})


def _described(parameters: Parameters, name: str) -> dict[str, object]:
    entry = TABLE[name]
    short = "Obeyed" if name in OBEYED else "Kept, and does nothing"
    described: dict[str, object] = {
        "name": name,
        "type": "Int32" if entry.is_integer else "Float",
        "shortDesc": "A fact about this vehicle" if parameters.is_fact(name) else short,
        "group": name.partition("_")[0],
        "default": entry.default,
    }
    limits = {"min": entry.least, "max": entry.most}
    return described | {key: limit for key, limit in limits.items() if limit is not None}


def general_metadata(parameters: bytes) -> bytes:
    """Where the metadata of the parameters is, and its checksum."""
    where = {"type": _PARAMETER_TYPE, "uri": f"mftp:///{PARAMETER_FILE}", "fileCrc": checksum(parameters)}
    return _json({"version": 1, "metadataTypes": [where]})


def checksum(file: bytes) -> int:
    """The checksum of a file, as COMPONENT_METADATA tells it."""
    return int.from_bytes(crc32(file), "little")


def _json(value: object) -> bytes:
    return json.dumps(value, separators=(",", ":")).encode()
