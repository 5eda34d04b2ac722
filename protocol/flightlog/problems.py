"""What is wrong with a file that is read."""


class Problems:
    """Each problem once, in the order in which they were found."""

    def __init__(self) -> None:
        self._texts: dict[str, None] = {}

    def report(self, text: str) -> None:
        """Add a problem, in a few words."""
        self._texts[text] = None

    def __bool__(self) -> bool:
        return bool(self._texts)

    def __str__(self) -> str:
        return "; ".join(self._texts)
