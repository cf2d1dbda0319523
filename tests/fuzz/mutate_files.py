"""Wrong text of lines and fields, arrays of other shapes and types, and checkpoints of others."""

from pathlib import Path
from random import Random

import numpy as np
import torch
from numpy.typing import NDArray

from tests.fuzz.nasty import NUMBERS, TEXTS, number, value


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


TEXT = (field, field, field, line)


def _other(array: NDArray, random: Random) -> tuple[NDArray, str]:
    """The array made wrong, and how."""
    flat = array.reshape(-1)
    ways = {
        "text": lambda: flat.astype(str),
        "complex": lambda: (
            flat.astype(np.complex128) if flat.dtype.kind in "biuf" else flat.astype(str)
        ),
        "objects": lambda: np.array([{"a": 1}, None], dtype=object),
        "flat": lambda: flat,
        "empty": lambda: flat[:0],
        "a scalar": lambda: np.array(1.0),
        "one axis more": lambda: array[None],
        "cut": lambda: array[: len(array) // 2] if array.ndim else array[None],
        "times": lambda: np.zeros(array.shape, "datetime64[s]"),
        "wrong numbers": lambda: np.full(array.shape, number(random), np.float64),
    }
    name = random.choice(list(ways))
    return ways[name](), name


def npz(path: Path, random: Random) -> str:
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files}
    name = random.choice(list(arrays))
    change = random.choice(("changed", "changed", "changed", "left out", "renamed"))
    if change == "changed":
        arrays[name], change = _other(arrays[name], random)
    else:
        taken = arrays.pop(name)
        if change == "renamed":
            arrays[random.choice(("x", "pog", "pog/", "points/nobody"))] = taken
    np.savez(path, **arrays)
    return f"{name}: {change}"


def npy(path: Path, random: Random) -> str:
    array, change = _other(np.load(path), random)
    np.save(path, array)
    return change


WAYS = {
    "int8": lambda t: t.to(torch.int8),
    "int64": lambda t: t.to(torch.int64),
    "bool": lambda t: t.to(torch.bool),
    "uint8": lambda t: t.to(torch.uint8),
    "complex": lambda t: t.to(torch.complex64),
    "half": lambda t: t.to(torch.float16),
    "bfloat16": lambda t: t.to(torch.bfloat16),
    "float8": lambda t: t.to(torch.float8_e4m3fn),
    "double": lambda t: t.to(torch.float64),
    "sparse": lambda t: t.to(torch.float32).reshape(-1).to_sparse(),
    "sparse of the same shape": lambda t: t.to_sparse() if t.ndim else t,
    "quantized": lambda t: torch.quantize_per_tensor(t.to(torch.float32), 0.1, 0, torch.qint8),
    "infinite": lambda t: torch.full_like(t.to(torch.float32), torch.inf),
    "empty": lambda t: t.reshape(-1)[:0],
    "one axis more": lambda t: t[None],
    "on no device": lambda t: t.to("meta"),
    "expanded": lambda t: t.to(torch.float32).reshape(-1)[:1].expand(10**5, 10**9),
    "a list": lambda t: t.tolist(),
}


def entries(path: Path, random: Random) -> str:
    """One entry of the state_dict, or all of them."""
    content = torch.load(path, weights_only=True)
    state, way = content["model_state"], random.choice(list(WAYS))
    changed = list(state) if random.random() < 0.25 else [random.choice(list(state))]
    state |= {key: WAYS[way](state[key]) for key in changed}
    torch.save(content, path)
    return f"{len(changed)} entries {way}"


def around(path: Path, random: Random) -> str:
    """Entries other than tensors."""
    content = torch.load(path, weights_only=True)
    key = random.choice([*content, "model_state", "classes"])
    content[key] = value(random)
    torch.save(content if random.random() < 0.9 else value(random), path)
    return f"{key} replaced"


def keys(path: Path, random: Random) -> str:
    content = torch.load(path, weights_only=True)
    state = content["model_state"]
    key = random.choice(list(state))
    taken = state.pop(key)
    if random.random() < 0.5:
        state[random.choice((1, None, "", "x"))] = taken
    torch.save(content, path)
    return "another key"


CHECKPOINT = (*[entries] * 4, around, keys)
