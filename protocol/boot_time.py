"""Times since boot, which are 32 bits of milliseconds and wrap after 49.7 days."""


def later_ms(time_ms: int, than_ms: int) -> int:
    """By how much one is later than the other; negative if it is sooner."""
    return (time_ms - than_ms + 0x8000_0000) % 0x1_0000_0000 - 0x8000_0000
