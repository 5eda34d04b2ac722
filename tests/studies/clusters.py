"""A scheduler and workers as processes of their own, by dask's command lines; a network namespace for some of them."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

DASK = (sys.executable, "-m", "dask")
ROOT = Path(__file__).resolve().parents[2]


class NoNamespaceError(Exception):
    """Network namespaces can't be made here; the text says why."""


@contextmanager
def process(command: Sequence[str]) -> Iterator[None]:
    """A process that is ended afterwards."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    running = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield
    finally:
        running.terminate()
        try:
            running.wait(30.0)
        except subprocess.TimeoutExpired:
            running.kill()
            running.wait()


@contextmanager
def namespace() -> Iterator[tuple[str, str, str]]:
    """A network namespace that a pair of virtual interfaces joins with ours: its name, our address and its own.

    Raises NoNamespaceError."""
    if shutil.which("ip") is None:
        raise NoNamespaceError("there is no `ip` (Debian: iproute2)")
    number = os.getpid()
    name, ours, theirs = f"courier-{number}", f"cu{number}", f"ct{number}"
    net = f"198.18.{number % 256}"  # for tests, by RFC 2544
    try:
        _ip("netns", "add", name)
    except subprocess.CalledProcessError as error:
        raise NoNamespaceError(f"ip netns add: {error.stderr.strip()}") from error
    try:
        try:
            _ip("link", "add", ours, "type", "veth", "peer", "name", theirs, "netns", name)
            _ip("addr", "add", f"{net}.1/30", "dev", ours)
            _ip("link", "set", ours, "up")
            for step in (("addr", "add", f"{net}.2/30", "dev", theirs), ("link", "set", theirs, "up"),
                         ("link", "set", "lo", "up")):  # fmt: skip
                _ip("-n", name, *step)
        except subprocess.CalledProcessError as error:
            raise NoNamespaceError(f"ip link: {error.stderr.strip()}") from error
        yield name, f"{net}.1", f"{net}.2"
    finally:
        _ip("netns", "del", name)  # and the pair with it


def _ip(*arguments: str) -> None:
    subprocess.run(("ip", *arguments), check=True, capture_output=True, text=True)


@contextmanager
def by_command_lines(folder: Path, workers: int) -> Iterator[tuple[Path, str]]:
    """A scheduler and so many workers, the last of them in a namespace: the scheduler's file, which has its address as
    soon as it listens, and the last worker's address. Raises NoNamespaceError."""
    file = folder / "scheduler.json"
    with ExitStack() as stack:
        name, ours, theirs = stack.enter_context(namespace())
        scheduler = (*DASK, "scheduler", "--host", ours, "--port", "0", "--scheduler-file", str(file), "--no-dashboard")
        stack.enter_context(process(scheduler))
        for number in range(workers):
            inside = ("ip", "netns", "exec", name) if number == workers - 1 else ()
            host = theirs if inside else ours
            worker = (*inside, *DASK, "worker", "--scheduler-file", str(file), "--nthreads", "1", "--host", host)
            stack.enter_context(process((*worker, "--no-dashboard", "--local-directory", str(folder))))
        yield file, theirs
