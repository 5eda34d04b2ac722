"""A package whose laws, planner and output fail in all ways, as their options say."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.companion.installed import installed

BROKEN = """
import sys
import time

def law(control, **options):
    return Law(**options)

class Law:
    def __init__(self, answer=0.0):
        self.answer = answer

    def reset(self):
        pass

    def acceleration_command(self, error, reference_acceleration, dt):
        if self.answer == "exit":
            sys.exit(3)
        if self.answer == "panic":
            raise BaseException("panic")
        if self.answer == "nan":
            return reference_acceleration * float("nan")
        if self.answer == "huge":
            return reference_acceleration - 1e300
        if isinstance(self.answer, str):
            return eval(self.answer)
        return 1 / 0 if self.answer == 0.0 else self.answer

    def turning_command(self, error, dt):
        if self.answer == "exit":
            sys.exit(3)
        if self.answer == "nan":
            return error.reference_rates, error.attitude * float("nan")
        if self.answer == "huge":
            return error.reference_rates, error.attitude - 1e300
        return (1 / 0, 0.0) if self.answer == 0.0 else ([self.answer] * 3, self.answer)

class Brittle(Law):
    def __init__(self, control, after=3.0, **options):
        super().__init__(**options)
        self.left = after

    def acceleration_command(self, error, reference_acceleration, dt):
        self.left -= dt
        if self.left <= 0.0:
            return super().acceleration_command(error, reference_acceleration, dt)
        return reference_acceleration + 7.0 * error.position + 5.0 * error.velocity

class Forgetful:
    def __init__(self, control):
        pass

    acceleration_command = turning_command = Law.acceleration_command

class Stuck(Forgetful):
    def reset(self):
        raise RuntimeError("stuck")

class Slow:
    def __init__(self, control, takes=1.0):
        self.takes = takes

    def reset(self):
        pass

    def acceleration_command(self, error, reference_acceleration, dt):
        until = time.perf_counter() + self.takes
        while time.perf_counter() < until:
            pass
        return reference_acceleration

    def turning_command(self, error, dt):
        return self.acceleration_command(error, error.reference_rates, dt), error.reference_acceleration

    def message(self, output, setpoint, boot_time_ms, target):
        self.acceleration_command(setpoint, None, 0.0)
        from protocol.messages import dialect
        return dialect.MAVLink_set_attitude_target_message, (0, 1, 1, 7, [1, 0, 0, 0], 0, 0, 0, 0.4)

def leaves(control):
    raise SystemExit("leaves")

class Output:
    def __init__(self, control, answer="1 / 0"):
        self.answer = answer

    def message(self, output, setpoint, boot_time_ms, target):
        from protocol.messages import dialect
        return eval(self.answer, {"nan": float("nan"), "exit": sys.exit, "dialect": dialect})

class Planner:
    def __init__(self, settings, answer=""):
        self.answer = answer

    def plan(self, view, position, velocity, goal, speed):
        return eval(self.answer)
"""


@contextmanager
def broken_package(folder: Path) -> Iterator[None]:
    """The package "broken", version 1, written into a folder and installed."""
    package, site = folder / "package", folder / "site"
    package.mkdir()
    site.mkdir()
    (package / "broken.py").write_text(BROKEN)
    (package / "pyproject.toml").write_text(
        '[project]\nname = "broken"\nversion = "1"\n'
        '[project.entry-points."courier.position_laws"]\nbroken = "broken:law"\nnot_there = "broken:missing"\n'
        'forgetful = "broken:Forgetful"\nstuck = "broken:Stuck"\nleaves = "broken:leaves"\n'
        'slow = "broken:Slow"\nbrittle = "broken:Brittle"\n'
        '[project.entry-points."courier.attitude_laws"]\nbroken = "broken:law"\n'
        'forgetful = "broken:Forgetful"\nstuck = "broken:Stuck"\nleaves = "broken:leaves"\n'
        'slow = "broken:Slow"\n'
        '[project.entry-points."courier.outputs"]\nbroken = "broken:Output"\nforgetful = "broken:Forgetful"\n'
        'slow = "broken:Slow"\n'
        '[project.entry-points."courier.planners"]\nbroken = "broken:Planner"\n'
    )
    sys.modules.pop("broken", None)  # that of an earlier folder
    with installed(package, site):
        yield
