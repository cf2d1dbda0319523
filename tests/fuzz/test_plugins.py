"""Plug-ins that misbehave when they are imported or called: one line names each."""

import contextlib
import io
import warnings
from collections.abc import Callable
from functools import cache, partial
from itertools import count
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pandas as pd
import pytest
import torch

from lidarplace import Lidar, Mount, OccupancyGrid, Placement, Roi, evaluate
from lidarplace.base.errors import InputError
from lidarplace.base.metrics import METRICS
from lidarplace.base.plugin_folders import PLUGINS
from lidarplace.clouds.clouds import PointClouds
from lidarplace.commands.convert import READERS, app
from lidarplace.logs.boxes import GEOMETRY
from lidarplace.pog.surrogates.table import SURROGATES
from sweeps.execution.failures import Failure
from tests.fuzz.judge import DONE, REFUSED, Outcome, judge_reader, judge_verb
from training import NETWORKS, build_detector
from training.detect import detect
from training.detectors.build import PLUG_INS
from training.kitti_ap import evaluation
from training.optimisation import Optimisation
from training.settings import TrainingSettings

HEAD = """
import math, sys, warnings
from pathlib import Path
import numpy as np
import torch
from lidarplace.base.metrics import Metric
from lidarplace.logs.box_log import read_box_log
from lidarplace.pog.surrogates.table import Surrogate
from training.detectors.detector import Detector
BOX = torch.tensor([[5.0, 2.0, 0.8, 4.0, 2.0, 1.6, 0.5]])
LOSS, ONE = torch.ones((), requires_grad=True), torch.ones(1)
{imported}
def act(*_):
    return {called}
"""
_NET = """
class Net(Detector):
    {methods}
def THING(classes, *_):
    return Net(classes, (0, -8, 0, 16, 8, 4))
"""
TAILS = {
    "surrogate": """THING = Surrogate(
    **dict(label="l", unit="u", meaning="m", of_seen=act, sense=1) | dict({field}))""",
    "metric": "THING = Metric(**dict(label='l', short='s', of_matches=act) | dict({field}))",
    "reader": "def THING(path, ignored):\n    'Read.'\n    return act()",
    "loss": _NET.format(methods="predict = None; loss = act"),
    "predict": _NET.format(
        methods="loss = None; predict = lambda *_: [dict(boxes=act(), scores=ONE, labels=ONE)]"
    ),
}
_RIGHT_NUMBER = ("1.5", "0", "np.float32(3)", "1e308")
RIGHT = {
    "surrogate": _RIGHT_NUMBER,
    "metric": _RIGHT_NUMBER,
    "reader": ("read_box_log(Path('log'))",),
    "loss": ("{'loss': LOSS}", "{'loss': LOSS, 'part': 3}"),
    "predict": ("BOX", "BOX * 7"),
}
ACTS = """
sys.exit(0); sys.exit('no\\nweights'); 1 / 0; {}['a\\nb']; int('x'); exec('1 +'); act(1, 2)(3)
__import__('no_such_package'); sys.stdout.close(); sys.stderr.close()
warnings.simplefilter('error')
warnings.filterwarnings('error', category=UserWarning)"""
_NO_NUMBER = """
math.inf; -math.inf; math.nan; None; 1 + 2j; np.ones(1); np.ones((2, 2)); '3'; [1.0]; 10 ** 400
np.float32('nan'); ONE; Surrogate; {}"""
WRONG = {
    "surrogate": _NO_NUMBER,
    "metric": _NO_NUMBER,
    "reader": "None; 3; 'log'; BOX; read_box_log(Path('log')).boxes",
    "loss": "None; LOSS; {}; {'loss': 1.0}; {'loss': torch.ones(2)}; {'loss': BOX[0, 0]}",
    "predict": """
None; BOX[0]; BOX * math.nan; BOX * math.inf; -BOX; BOX.numpy(); BOX * 1000; BOX * 100; BOX[:, :6]
torch.cat([BOX[:, :6], 0 * BOX[:, :1] + 179], 1); BOX * torch.tensor([1, 1, 1, 1, 0, 1, 1])
BOX * torch.tensor([1, 1, 1] + 3 * [1000] + [1])""",
}
FIELDS = {
    "surrogate": """
sense=5; sense=None; power=math.nan; power='2'; label=None; label=''; unit=3; of_seen=None
of_seen=3; of_others=act; needs_rays='no'; headline='x'; colour=1""",
    "metric": "label=None; label=''; short=3; direction='up'; ranks=3; of_matches=None",
}


@cache
def _traffic() -> pd.DataFrame:
    car = dict(zip(GEOMETRY, (5.0, 2.0, 0.8, 4.0, 2.0, 1.6, 0.5), strict=True))
    return pd.DataFrame([{"frame": 0, "class": "Car"} | car])


def _surrogate(name: str) -> object:
    grid = OccupancyGrid.from_boxes(_traffic(), Roi((0, 8), (-4, 4), (0, 4), 0.5), "Car", frames=1)
    rig = Placement("rig", [Mount(z=2.0)], Lidar((-0.2, -0.1), azimuth_steps=90))
    return evaluate(grid, rig, surrogates=[name])[name]


def _metric(name: str) -> object:
    return evaluation(_traffic(), _traffic().assign(score=0.5), [0], ["Car"], metrics=[name])


def _loss(name: str) -> object:
    model = build_detector(name, ["Car"])
    model.weight = torch.nn.Parameter(torch.ones(()))
    return Optimisation(model, TrainingSettings(), steps=2).step(([], [], []))


def _predict(name: str) -> object:
    empty, state = np.zeros((0, 4), np.float32), build_detector(name, ["Car"]).state_dict()
    clouds = PointClouds.from_frames([0], [(empty, [0])], (0, -8, 0, 16, 8, 4))
    return detect(name, ["Car"], state, clouds, TrainingSettings())


def _in_worker(use: Callable[[str], object], name: str) -> object:
    """Raise what a worker keeps of an error; those of a network stay as they are."""
    try:
        return use(name)
    except Exception as error:
        raise InputError(Failure.of(error).reason) from None


USES: dict[str, Callable[[str], object]] = {"surrogate": _surrogate, "metric": _metric}
USES |= {"loss": partial(_in_worker, _loss), "predict": partial(_in_worker, _predict)}
_numbers = count()


def outcome_of_plugin(kind: str, way: str, misuse: str, world: Path, place: Path) -> Outcome:
    """Outcome of a misuse, and whether later code in this process can still print and warn."""
    place.mkdir(parents=True)
    module = f"fuzz_plugin_{next(_numbers)}"
    (place / "log").symlink_to(world / "log")
    called = RIGHT[kind][0] if way in ("import", "field") else misuse
    text = HEAD.format(called=called, imported=misuse if way == "import" else "")
    text += TAILS[kind].format(field=misuse if way == "field" else "")
    (place / f"{module}.py").write_text(text)
    registries = (SURROGATES, METRICS, READERS, NETWORKS, PLUG_INS)
    name, streams = f"{module}:THING", (io.StringIO(), io.StringIO())
    with (
        contextlib.chdir(place),
        contextlib.redirect_stdout(streams[0]),
        contextlib.redirect_stderr(streams[1]),
        warnings.catch_warnings(record=True),
        patch.dict(PLUGINS, clear=True),
        contextlib.ExitStack() as stack,
    ):
        for registry in registries:
            stack.enter_context(patch.object(registry, "_added", {}))
        if kind == "reader":
            return judge_verb(app, [name, "log", "out"], (module,), (0,))
        try:
            outcome = judge_reader(lambda: USES[kind](name), (module,))
            print(end="", flush=True)
            warnings.warn("a warning is none", stacklevel=1)
        except SystemExit:
            return Outcome("ends the program")
        except (ValueError, UserWarning) as error:
            return Outcome("harms what follows", repr(error))
    return outcome


@pytest.mark.parametrize(
    ("kind", "value"), [(k, value) for k, values in RIGHT.items() for value in values]
)
def test_a_right_plugin_is_done(kind, value, world, tmp_path):
    outcome = outcome_of_plugin(kind, "value", value, world, tmp_path / "place")
    assert outcome.kind == DONE, outcome.told


@pytest.mark.parametrize("kind", RIGHT)
def test_wrong_plugins(kind, world, tmp_path):
    ways = {"import": ACTS, "call": ACTS, "value": WRONG[kind], "field": FIELDS.get(kind, "")}
    for way, text in ways.items():
        for misuse in filter(None, text.strip().replace("\n", "; ").split("; ")):
            # A test of a command has streams of its own, which nobody may close.
            if kind != "reader" or "close" not in misuse:
                place = tmp_path / str(next(_numbers))
                outcome = outcome_of_plugin(kind, way, misuse, world, place)
                assert outcome.kind == REFUSED, (way, misuse, outcome.told)
