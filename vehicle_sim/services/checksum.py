"""PX4's CRC-32, of its parameters' hash and of files: that of zlib without its inversions."""

import zlib


def crc32(data: bytes) -> bytes:
    """Four bytes, the lowest first."""
    return (zlib.crc32(data, 0xFFFFFFFF) ^ 0xFFFFFFFF).to_bytes(4, "little")
