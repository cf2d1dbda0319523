"""What happens where a task runs: inputs are loaded, its function is called, its result stored."""

import math
import os
import socket
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

from cachetools import LRUCache, cached

from sweeps.execution.failures import Failure
from sweeps.execution.progress import NOTED_S, about
from sweeps.store.local import Note
from sweeps.store.open import AnyStore
from sweeps.store.result_folder import R, Ran
from sweeps.tasks.parameters import NetworkParams
from sweeps.tasks.results import Trained
from sweeps.tasks.stages import FUNCTIONS
from sweeps.tasks.task import Task


@dataclass(frozen=True)
class Ended:
    """How a task ended.

    Attributes:
        failure: why it has no result; None if it has one.
        seconds: that it took with loading and storing.
    """

    failure: Failure | None
    seconds: float


def try_task(task: Task, store: AnyStore, halvings: int, gpu_share: float) -> Ended:
    """`run_task`; a mistake comes back as a note."""
    start = time.perf_counter()
    failure = None
    try:
        run_task(task, store, halvings, gpu_share)
    except Exception as error:
        # If the result is there another driver finished it, and tidied up under this one.
        if not store.has(task):
            failure = Failure.of(error)
    return Ended(failure, time.perf_counter() - start)


def run_task(task: Task, store: AnyStore, halvings: int = 0, gpu_share: float = 1.0) -> None:
    """Compute one result from those in the store, and store it.

    Inputs are mapped from the store's files, not sent: workers on one machine share the pages, and
    clouds larger than the memory can be trained on.

    Args:
        halvings: how often the batch size is halved, after the GPU's memory was too small.
        gpu_share: of a GPU's memory that a network may take.
    """
    if isinstance(task.params, NetworkParams) and gpu_share:
        _leave_the_rest(gpu_share)
    node, pid = socket.gethostname(), os.getpid()
    since = datetime.now().isoformat(" ", timespec="seconds")
    with store.running(task, Note(node, pid, since)) as note:
        reset_peak_memory()
        inputs = [_load(store, needed) for needed in task.inputs]
        start = time.perf_counter()
        function = FUNCTIONS[task.stage]
        if task.resumable:
            with store.working_folder(task) as folder:
                on_step = _Progress(task, note).on_step
                value = function(
                    task.params, *inputs, folder=folder, on_step=on_step, halvings=halvings
                )
        else:
            value = function(task.params, *inputs)
        seconds = time.perf_counter() - start
        ran = Ran(node, pid, peak_memory())
        if isinstance(value, Trained):
            seconds += value.earlier_seconds
            ran = replace(
                ran,
                batch_size_reduced=value.batch_size_reduced,
                earlier_seconds=value.earlier_seconds,
            )
        store.save(task, value, seconds, ran)
        if task.resumable:
            store.discard(task)


def _leave_the_rest(gpu_share: float) -> None:
    """Limit this process to a share of a GPU's memory; batches that need more do not fit."""
    import torch

    if torch.cuda.is_available():
        torch.cuda.set_per_process_memory_fraction(min(1.0, gpu_share))


@cached(LRUCache(maxsize=4), key=lambda store, task: (store, task.key))
def _load(store: AnyStore, task: Task[R]) -> R:
    """An input. Tasks that follow one another on a worker often share one, such as a POG."""
    return store.load(task)


class _Progress:
    """Notes now and then how much of a training is done, and when it may end."""

    def __init__(self, task: Task, note: Callable[[str], None]) -> None:
        self._task = task
        self._note = note
        self._first: tuple[float, float] | None = None
        self._noted = -math.inf

    def on_step(self, done: float) -> None:
        """Take note of the epochs that are done."""
        now, epochs = time.monotonic(), self._task.params.training.epochs
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
