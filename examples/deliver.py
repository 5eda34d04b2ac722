"""Deliver a parcel 16 m north: python examples/deliver.py udpin:127.0.0.1:14540"""

import asyncio
import sys

from companion import Companion, FlightError


async def watch(vehicle: Companion) -> None:
    async for event in vehicle.events():
        print(f"{event.time_s:7.2f} {event.text}")


async def deliver(url: str, *options: str) -> None:
    async with Companion.connect(url, *options) as vehicle, asyncio.TaskGroup() as tasks:
        tasks.create_task(watch(vehicle))
        await vehicle.take_off(3.0)
        await vehicle.go_to(north=16.0, east=0.0, height=3.0)
        await vehicle.deliver()
        await vehicle.go_to(north=0.0, east=0.0, height=3.0)
        await vehicle.land()


if __name__ == "__main__":
    reason = ""
    try:
        asyncio.run(deliver(*(sys.argv[1:] or ["udpin:127.0.0.1:14540"])))
    except* FlightError as errors:
        reason = str(errors.exceptions[0])
    sys.exit(reason or 0)
