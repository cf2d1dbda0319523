"""What happens where a task runs: inputs are loaded, its function is called, its result stored."""

import math
import os
import socket
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
    """Why a task has no result, None if it has one; and the seconds with loading and storing."""

    failure: Failure | None
    seconds: float


def try_task(task: Task, store: Store, halvings: int, gpu_share: float) -> Ended:
    start = time.perf_counter()
    failure = None
    try:
        run_task(task, store, halvings, gpu_share)
    except Exception as error:
        # If the result is there another driver finished it, and tidied up under this one.
        if not store.has(task):
            failure = Failure.of(error)
    return Ended(failure, time.perf_counter() - start)


def run_task(task: Task, store: Store, halvings: int = 0, gpu_share: float = 1.0) -> None:
    """Compute one result from those in the store, and store it. Inputs are mapped from the store's
    files, not sent: workers on one machine share the pages, and clouds larger than the memory can
    be trained on. A network takes `gpu_share` of a GPU's memory; `halvings` is how often its batch
    size is halved, after that was too small."""
    if isinstance(task.stage, Network) and gpu_share:
        import torch

        if torch.cuda.is_available():  # batches that need more do not fit
            torch.cuda.set_per_process_memory_fraction(min(1.0, gpu_share))
    node, pid = socket.gethostname(), os.getpid()
    since = datetime.now().isoformat(" ", timespec="seconds")
    with store.running(task, Note(node, pid, since)) as note:
        reset_peak_memory()
        inputs = [_load(store, needed) for needed in task.inputs]
        start = time.perf_counter()
        call = partial(task.stage.run, *inputs)
        if isinstance(task.stage, FinetuneStage):
            on_step = _Progress(task.stage.training.epochs, note).on_step
            how = {"on_step": on_step, "halvings": halvings}
            with store.working_folder(task) as folder:
                value = call(folder=folder, **how)
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


@cached(LRUCache(maxsize=4), key=lambda store, task: (store, task.key))
def _load(store: Store, task: Task[Stage[R]]) -> R:
    """An input. Tasks that follow one another on a worker often share one, such as a POG."""
    return store.load(task)


class _Progress:
    """Notes now and then how much of a training is done, and when it may end."""

    def __init__(self, epochs: int, note: Callable[[str], None]) -> None:
        self._epochs = epochs
        self._note = note
        self._first: tuple[float, float] | None = None
        self._noted = -math.inf

    def on_step(self, done: float) -> None:
        now, epochs = time.monotonic(), self._epochs
        since, before = self._first = self._first or (now, done)
        if now - self._noted < NOTED_S:
            return
        self._noted = now
        text = f"epoch {min(int(done) + 1, epochs)} of {epochs}, {100 * done / epochs:.0f} %"
        if done > before:
            left = about((epochs - done) * (now - since) / (done - before))
            text += f", about {left} left"
        with suppress(Exception):  # a training outlasts a remote store that does not answer
            self._note(text)


def peak_memory() -> int:
    """Most bytes that this process held since `reset_peak_memory`, mapped files not counted."""
    status = dict(
        line.split(":", 1)
        for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    )

    def kib(name: str) -> int:
        return int(status[name].split()[0])

    return max(0, kib("VmHWM") - kib("RssFile")) * 1024


def reset_peak_memory() -> None:
    """Linux forgets the peak of earlier tasks of this process, where it allows this."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
