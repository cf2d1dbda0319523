"""How busy machine and driver are, by MLflow's own monitors."""

from __future__ import annotations

from collections.abc import Callable
from threading import Event, Thread
from typing import Any

INTERVAL_S = 10.0
"""As MLflow's own."""


class SystemMonitor:
    """Hands values to `log` now and then, in the `with` block, from a thread.

    MLflow's own thread would write to the server itself, and end when that is away.

    Args:
        log: takes "system/NAME" and values: percent, MB, watts, as in MLflow.
        say: prints a line for the user.
        interval_s: from one sample to the next.
    """

    def __init__(
        self,
        log: Callable[[dict[str, float]], None],
        say: Callable[[str], None],
        interval_s: float = INTERVAL_S,
    ) -> None:
        self._log = log
        self._say = say
        self._interval_s = interval_s
        self._ended = Event()
        self._thread = Thread(target=self._watch, name="system metrics", daemon=True)

    def __enter__(self) -> SystemMonitor:
        try:
            self._monitors = _monitors()
        except ModuleNotFoundError as error:
            self._say(f"MLflow: no system metrics: the package {error.name} is missing")
            return self
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join()

    def _watch(self) -> None:
        self._sample()  # the processor's share is counted from the call before, by thread
        while not self._ended.wait(self._interval_s):
            try:
                self._log(self._sample())
            except OSError:  # the disk is full: the next result that is kept tells
                continue

    def _sample(self) -> dict[str, float]:
        import psutil

        values: dict[str, float] = {}
        for monitor in self._monitors:
            monitor.collect_metrics()
            values |= monitor.aggregate_metrics()
            monitor.clear_metrics()
        values["driver_memory_megabytes"] = round(psutil.Process().memory_info().rss / 1e6, 1)
        return {f"system/{name}": float(value) for name, value in values.items()}


def _monitors() -> list[Any]:
    from mlflow.system_metrics.metrics.cpu_monitor import CPUMonitor
    from mlflow.system_metrics.metrics.disk_monitor import DiskMonitor
    from mlflow.system_metrics.metrics.gpu_monitor import GPUMonitor
    from mlflow.system_metrics.metrics.network_monitor import NetworkMonitor

    monitors: list[Any] = [CPUMonitor(), DiskMonitor(), NetworkMonitor()]
    try:
        monitors.append(GPUMonitor())
    except (ImportError, RuntimeError):  # no nvidia-ml-py, or no GPU
        return monitors
    return monitors
