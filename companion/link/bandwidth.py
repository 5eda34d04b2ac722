"""Telemetry rates that a slow link carries."""

import msgspec

from companion.config import Rates

_SHARE = 0.7
"""Part of a link's bytes for telemetry; the rest is left for answers, texts and ground stations."""
_ATTITUDE, _POSITION, _ODOMETRY, _RING, _SETPOINT = 44.0, 40.0, 245.0, 300.0, 51.0
"""Bytes on the wire: ATTITUDE_QUATERNION, LOCAL_POSITION_NED, ODOMETRY, a ring (of eight sectors, which is the larger
form) and SET_ATTITUDE_TARGET, one of which answers each attitude."""
_SIGNATURE = 13.0
_OTHERS = 900.0
"""Bytes a second of all else, a third of them for ten TIMESYNCs."""
_SLOWEST, _SLOWEST_SCAN, _SLOWEST_ODOMETRY = 20.0, 5.0, 5.0
"""Hz; nothing is flown with less, and of ODOMETRY less is of no use."""


def fitted(rates: Rates, bytes_per_s: float, *, scans: bool, signed: bool = False) -> Rates:
    """The rates, as they are or made smaller, so that both ways of a link carry them; `scans`: rings are needed;
    `signed`: each message carries a signature.

    Raises ValueError, with what is needed and what there is, for a link that carries no flight.
    """
    budget = _SHARE * bytes_per_s - _OTHERS
    more = _SIGNATURE if signed else 0.0
    attitude_bytes, position_bytes, ring = _ATTITUDE + more, _POSITION + more, _RING + more if scans else 0.0
    incoming = attitude_bytes * rates.attitude + position_bytes * rates.position + ring * rates.scan
    share = min(1.0, budget / incoming, budget / ((_SETPOINT + more) * rates.attitude))
    left = max(budget - incoming, 0.0) / (_ODOMETRY + more)
    if left < rates.odometry:  # no flight needs it
        rates = msgspec.structs.replace(rates, odometry=left if left >= _SLOWEST_ODOMETRY else 0.0)
    if share >= 1.0:
        return rates
    scan = min(max(rates.scan * share, _SLOWEST_SCAN), rates.scan)
    rest = budget - ring * scan
    share = min(share, rest / (attitude_bytes * rates.attitude + position_bytes * rates.position))
    slowest = min(_SLOWEST, rates.attitude, rates.position)
    if min(rates.attitude, rates.position) * share < slowest:
        least = ((attitude_bytes + position_bytes) * slowest + ring * _SLOWEST_SCAN + _OTHERS) / _SHARE
        raise ValueError(f"it carries {bytes_per_s:.0f} bytes a second, a flight needs {least:.0f}")
    attitude, position = rates.attitude * share, rates.position * share
    return msgspec.structs.replace(rates, attitude=attitude, position=position, scan=scan)
