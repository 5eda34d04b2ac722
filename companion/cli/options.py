"""Commands whose options are the fields of a record, as a command line needs more of them than a function should have;
and an option of several commands."""

import functools
import inspect
from collections.abc import Callable
from typing import Annotated, Any, TypeVar

import typer

Options = TypeVar("Options")
Insecure = Annotated[
    bool, typer.Option("--insecure", help="Bind addresses beyond this machine though there is no key.")
]


def options(record: type[Options]) -> Callable[[Callable[[Options], None]], Callable[..., None]]:
    """Make a command for typer of a function that takes a record (a dataclass).

    The fields become options and arguments in their order; their types may be `Annotated` as typer's parameters are.
    """

    def decorate(function: Callable[[Options], None]) -> Callable[..., None]:
        @functools.wraps(function)
        def command(**values: Any) -> None:
            function(record(**values))

        command.__signature__ = inspect.signature(record)  # type: ignore[attr-defined]
        return command

    return decorate
