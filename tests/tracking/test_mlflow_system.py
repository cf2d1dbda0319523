"""System metrics: MLflow's monitors, handed over from a thread."""

from __future__ import annotations

import sys
from threading import Event

from tracking.mlflow.system import SystemMonitor


def test_values_come_by_their_names_in_mlflow_until_the_block_ends():
    samples: list[dict[str, float]] = []
    twice = Event()

    def log(values):
        samples.append(values)
        if len(samples) == 2:
            twice.set()

    with SystemMonitor(log, print, interval_s=0.01):
        assert twice.wait(60)
    first = samples[0]
    assert {
        "system/cpu_utilization_percentage",
        "system/system_memory_usage_megabytes",
        "system/disk_usage_percentage",
        "system/network_receive_megabytes",
        "system/driver_memory_megabytes",
    } <= set(first)
    assert 0 <= first["system/cpu_utilization_percentage"] <= 100
    assert first["system/driver_memory_megabytes"] > 10
    assert first["system/driver_memory_megabytes"] < first["system/system_memory_usage_megabytes"]


def test_a_full_disk_does_not_end_the_samples():
    again = Event()
    calls = []

    def log(values):
        calls.append(values)
        if len(calls) == 1:
            raise OSError("no space left")
        again.set()

    with SystemMonitor(log, print, interval_s=0.01):
        assert again.wait(60)


def test_a_missing_package_is_told(monkeypatch):
    for name in [name for name in sys.modules if name.startswith("mlflow.system_metrics.metrics")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "psutil", None)
    said: list[str] = []
    with SystemMonitor(lambda values: said.append("a sample"), said.append, interval_s=0.01):
        pass
    assert said == ["MLflow: no system metrics: the package psutil is missing"]
