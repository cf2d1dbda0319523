"""Wrong checkpoints: tensors of other types and layouts, other keys, other content."""

from pathlib import Path
from random import Random

import torch

from tests.fuzz.nasty import value

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


ANY = (*[entries] * 4, around, keys)
