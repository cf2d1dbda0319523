"""Wrong text of lines and fields: labels, calibrations, lists."""

from pathlib import Path
from random import Random

from tests.fuzz.nasty import NUMBERS, TEXTS


def field(path: Path, random: Random) -> str:
    lines = path.read_text().splitlines() or [""]
    row = random.randrange(len(lines))
    fields = lines[row].split() or [""]
    at = random.randrange(len(fields))
    fields[at] = random.choice((*map(str, NUMBERS), *TEXTS))
    lines[row] = " ".join(fields)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return f"line {row + 1}, field {at + 1}: {fields[at]!r:.30}"


def line(path: Path, random: Random) -> str:
    lines = path.read_text().splitlines() or [""]
    row = random.randrange(len(lines))
    change = random.choice(("left out", "twice", "cut", "longer"))
    if change == "left out":
        del lines[row]
    elif change == "twice":
        lines.insert(row, lines[row])
    elif change == "cut":
        lines[row] = lines[row][: len(lines[row]) // 2]
    else:
        lines[row] += " 1 2 3"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return f"line {row + 1} {change}"


ANY = (field, field, field, line)
