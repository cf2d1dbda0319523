"""Frames that a network predicts at once."""

import logging
from collections.abc import Callable
from typing import TypeVar

import torch

from training.nvidia import is_out_of_memory

ON_CPU = 4
"""Frames at once on a CPU, whose caches hold their images."""
LARGEST = 64
"""Frames at once at most: more bring nothing, and indices fit 32 bits."""
MEMORY_SHARE = 0.7
"""Of the GPU memory that is free for this process; the rest is for frames with more points."""

Result = TypeVar("Result")


class PredictionBatches:
    """Batches of a prediction: as many frames as the memory of the device holds.

    With `size` "auto" a CPU takes 4 frames. A GPU takes 4, whose memory is measured, then as many
    as fit into what is free, `LARGEST` at most. Results must not depend on the batch."""

    def __init__(self, device: torch.device, size: int | str) -> None:
        self._device = device
        self._measures = size == "auto" and device.type != "cpu"
        self._size = size if isinstance(size, int) else ON_CPU
        self._reduced = False

    def results(self, predict: Callable[[range], list[Result]], count: int) -> list[Result]:
        """Return what `predict` returns of batches of `count` frames, one after the other.

        If the GPU is out of memory, halves the batch and says so once. Raises the error
        if it does not hold one frame."""
        results: list[Result] = []
        while len(results) < count:
            first = len(results)
            batch = range(first, min(first + self._size, count))
            before = self._reserved() if self._measures else 0
            try:
                results += predict(batch)
            except Exception as error:
                if len(batch) == 1 or not is_out_of_memory(error):
                    raise
            else:
                if self._measures:
                    self._enlarge(before, len(batch))
                continue
            # Out of the handler, whose traceback holds the tensors of the batch.
            self._halve(len(batch))
        return results

    def _reserved(self) -> int:
        gpu = torch.get_device_module(self._device)
        gpu.empty_cache()
        gpu.reset_peak_memory_stats(self._device)
        return int(gpu.memory_reserved(self._device))

    def _enlarge(self, before: int, frames: int) -> None:
        """Choose the size from the peak of the first batch."""
        gpu = torch.get_device_module(self._device)
        taken = max(1, gpu.max_memory_reserved(self._device) - before)
        gpu.empty_cache()
        free, total = gpu.mem_get_info(self._device)
        share = gpu.get_per_process_memory_fraction(self._device) * total
        free = min(free, share - gpu.memory_reserved(self._device))
        self._size = max(frames, min(LARGEST, int(MEMORY_SHARE * free * frames / taken)))
        self._measures = False

    def _halve(self, frames: int) -> None:
        self._size, self._measures = frames // 2, False
        torch.get_device_module(self._device).empty_cache()
        if not self._reduced:
            problem = f"{self._device}: out of memory with {frames} frames at once"
            logging.getLogger(__name__).warning("%s; predicting with smaller batches", problem)
            self._reduced = True
