"""The work of a worker: it loads the inputs of a task, runs its stage, stores its result."""

import math
import os
import socket
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from pathlib import Path

from cachetools import LRUCache, cached

from sweeps.execution.failures import Failure
from sweeps.execution.progress import NOTED_S, about
from sweeps.stages.stage import Stage
from sweeps.stages.task import Task
from sweeps.stages.train import FinetuneStage, Network, TrainedDetector
from sweeps.store.local import Note, Store
from sweeps.store.result_folder import R, Ran


@dataclass(frozen=True)
class Ended:
    """The failure of a task, None if it has a result, and its seconds with input and output."""

    failure: Failure | None
    seconds: float


def try_task(task: Task, store: Store, halvings: int, gpu_share: float) -> Ended:
    """Run a task, and describe its failure; arguments as of `run_task`."""
    start = time.perf_counter()
    failure = None
    try:
        run_task(task, store, halvings, gpu_share)
    except Exception as error:
        # If there is a result another driver finished it, and removed files of this one.
        if not store.has(task):
            failure = Failure.of(error)
    return Ended(failure, time.perf_counter() - start)


def run_task(task: Task, store: Store, halvings: int = 0, gpu_share: float = 1.0) -> None:
    """Compute one result from those in the store, and store it.

    Inputs are mapped from files of the store, not sent: workers on one machine share the pages, and
    clouds larger than the memory can be trained on. A network gets `gpu_share` of the memory of a
    GPU; `halvings` is how often its batch size is halved, after that memory was too small. Raises
    RuntimeError if a network has another device than planned, or cannot use an assigned GPU."""
    if isinstance(task.stage, Network):
        _prepare_device(task.stage, gpu_share)
    node, pid = socket.gethostname(), os.getpid()
    since = datetime.now().isoformat(" ", timespec="seconds")
    with store.running(task, Note(node, pid, since)) as note:
        reset_peak_memory()
        inputs = [_load(store, needed) for needed in task.inputs]
        start = time.perf_counter()
        call = partial(task.stage.run, *inputs)
        if isinstance(task.stage, FinetuneStage):
            on_step = _Progress(task.stage.training.epochs, note).on_step
            settings = {"on_step": on_step, "halvings": halvings}
            with store.working_folder(task) as folder:
                value = call(folder=folder, **settings)
        else:
            value = call()
        seconds = time.perf_counter() - start
        ran = Ran(node, pid, peak_memory())
        if isinstance(value, TrainedDetector):
            seconds += value.earlier_seconds
            ran = Ran(node, pid, ran.peak_memory, value.batch_size_reduced, value.earlier_seconds)
        store.save(task, value, seconds, ran)
        if task.stage.resumable:
            store.discard(task)


def _prepare_device(stage: Network, gpu_share: float) -> None:
    import torch

    from training.device import device, gpu_problem

    on_gpu = device().type == "cuda"
    planned = on_gpu or _has_assigned_gpu() if stage.gpu is None else stage.gpu
    if on_gpu != planned:
        place, names = socket.gethostname(), {True: "GPU", False: "CPU"}
        problem = gpu_problem() or f"expected the {names[planned]}, found the {names[on_gpu]}"
        fix = "ray.num_gpus=0 plans for the CPU" if planned else "CUDA_VISIBLE_DEVICES= hides it"
        raise RuntimeError(f"{place}: {problem}; {fix}")  # another try may have a better device
    if on_gpu and gpu_share:  # batches that need more do not fit
        torch.cuda.set_per_process_memory_fraction(min(1.0, gpu_share))


def _has_assigned_gpu() -> bool:
    """Test if Ray assigned a GPU to this task."""
    ray = sys.modules.get("ray")
    return ray is not None and ray.is_initialized() and bool(ray.get_gpu_ids())


@cached(LRUCache(maxsize=4), key=lambda store, task: (store, task.key))
def _load(store: Store, task: Task[Stage[R]]) -> R:
    """Load an input. Successive tasks of a worker often share one, such as a POG."""
    return store.load(task)


class _Progress:
    """Notes now and then how far a training is, and when it may end."""

    def __init__(self, epochs: int, note: Callable[[str], None]) -> None:
        self._epochs = epochs
        self._note = note
        self._first: tuple[float, float] | None = None
        self._noted = -math.inf

    def on_step(self, finished: float) -> None:
        """Note that so many epochs are finished."""
        now, epochs = time.monotonic(), self._epochs
        since, before = self._first = self._first or (now, finished)
        if now - self._noted < NOTED_S:
            return
        self._noted = now
        text = (
            f"epoch {min(int(finished) + 1, epochs)} of {epochs}, {100 * finished / epochs:.0f} %"
        )
        if finished > before:
            left = about((epochs - finished) * (now - since) / (finished - before))
            text += f", about {left} left"
        with suppress(Exception):  # a training outlasts a remote store that does not answer
            self._note(text)


def peak_memory() -> int:
    """Return the most bytes that this process held since `reset_peak_memory`, less mapped files."""
    status = dict(
        line.split(":", 1)
        for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    )

    def kib(name: str) -> int:
        return int(status[name].split()[0])

    return max(0, kib("VmHWM") - kib("RssFile")) * 1024


def reset_peak_memory() -> None:
    """Make Linux forget the peak of earlier tasks of this process, where it allows this."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
