"""Damage a file as a bad disk does."""

from pathlib import Path


def flip_bit(path: Path, place: float) -> None:
    """Change one bit; the size and all else stay.

    Args:
        place: where in the file, 0 the first byte, 1 the last.
    """
    data = bytearray(path.read_bytes())
    data[round(place * (len(data) - 1))] ^= 1
    path.write_bytes(data)
