"""One interface for both places where calls run; in Ray's the workers are other processes."""

import math
import os
from dataclasses import replace

import numpy as np
import pytest
import ray

from lidarplace.base.errors import InputError
from sweeps.configuration.sweep import RaySettings
from sweeps.execution import ray_cluster
from sweeps.execution.backends import BackendLost, OnRay, WorkerDied, _translated, backend_for
from sweeps.execution.failures import Failure
from sweeps.execution.ray_cluster import THREADS, ClusterError
from sweeps.execution.worker import Ended


@pytest.fixture(scope="module", params=["debug", "local"])
def backend(request, tmp_path_factory):
    own = {"num_cpus": 1} if request.param == "local" else {}
    long = tmp_path_factory.mktemp("as_on_slurm_" + 80 * "x")  # too long for a socket's path
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TMPDIR", str(long))
        with backend_for(RaySettings(address=request.param, **own)) as found:
            yield found


def test_ray_starts_when_it_is_needed():
    with (
        backend_for(RaySettings(address="127.0.0.1:1")) as never_used,
        pytest.raises(ClusterError, match="cannot be reached"),
    ):
        never_used.submit(os.getcwd)


@pytest.fixture
def on_ray(backend):
    if isinstance(backend, OnRay):
        return backend
    return pytest.skip("runs in this process")


def test_every_job_is_waited_for_once(backend):
    jobs = {backend.submit(math.factorial, n, name=f"{n}!"): n for n in range(4)}
    found = []
    while jobs:
        if (job := backend.wait(list(jobs))) is not None:
            found.append((jobs.pop(job), job.result()))
    assert sorted(found) == [(0, 1), (1, 1), (2, 2), (3, 6)]


def test_what_a_call_raises_is_raised(backend):
    with pytest.raises(ValueError, match=r"math domain error|nonnegative"):
        backend.submit(math.sqrt, -1.0).result()


def test_why_a_task_failed_arrives_as_it_is(backend):
    ended = Ended(Failure("no such thing", "in epoch 1", lasting=True), 1.5)
    assert backend.submit(replace, ended).result() == ended


def test_what_is_shared_arrives_as_it_is(backend):
    shared = backend.share(np.arange(1000.0))
    jobs = [backend.submit(np.dot, shared, shared) for _ in range(2)]
    assert {float(job.result()) for job in jobs} == {float(np.dot(*[np.arange(1000.0)] * 2))}


def test_a_worker_is_in_the_drivers_folder(backend, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert backend.submit(os.getcwd).result() == str(tmp_path)


def test_a_folder_that_a_worker_has_not_got_is_told(on_ray, tmp_path, monkeypatch):
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    monkeypatch.setattr("sweeps.execution.backends.Path.cwd", lambda: gone)
    with pytest.raises(FileNotFoundError, match=r"has no folder .*gone"):
        on_ray.submit(os.getcwd).result()


@pytest.mark.parametrize(
    ("error", "found", "text"),
    [
        (ray.exceptions.WorkerCrashedError(), WorkerDied, "the worker died: WorkerCrashedError"),
        (ray.exceptions.LocalRayletDiedError(), BackendLost, "Ray's node on this machine died"),
        (ConnectionError("lost"), BackendLost, "the Ray cluster is gone: lost"),
    ],
)
def test_a_worker_or_a_cluster_that_is_gone_is_told(error, found, text):
    with pytest.raises(BackendLost, match=text) as told, _translated(ray):
        raise error
    assert told.type is found


@pytest.mark.parametrize("name", THREADS)
def test_a_task_has_one_thread(on_ray, name):
    """Libraries read the variable when they are imported."""
    assert on_ray.submit(os.getenv, name).result() == "1"


@pytest.mark.parametrize(
    ("probe", "wanted", "usable", "line"),
    [
        ("print('cuda')", None, None, ""),
        ("print('cuda')", 2, 2, ""),
        ("print('GPU: no driver')", None, 0, "GPU: no driver; networks run on the CPU"),
        ("raise OSError('libcudart')", None, 0, "OSError: libcudart; networks run on the CPU"),
        ("print('cpu')", None, 0, ""),
    ],
)
def test_a_local_ray_has_gpus_that_networks_can_use(card, caplog, probe, wanted, usable, line):
    card(probe)
    assert ray_cluster._usable_gpus(RaySettings(num_gpus=wanted)) == usable
    assert caplog.messages == ([line] if line else [])


def test_gpus_that_a_user_asks_for_in_vain(card):
    card("print('cpu')")
    with pytest.raises(InputError) as caught:
        ray_cluster._usable_gpus(RaySettings(num_gpus=1))
    expected = "ray.num_gpus: networks cannot use a GPU; ray.num_gpus=0 trains on the CPU"
    assert str(caught.value) == expected
    card("print('GPU: no driver')")
    with pytest.raises(InputError, match=r"^ray.num_gpus: GPU: no driver; ray.num_gpus=0"):
        ray_cluster._usable_gpus(RaySettings(num_gpus=1))
    assert ray_cluster._usable_gpus(RaySettings(num_gpus=0)) == 0


def test_the_card_of_this_machine_is_tried_once(card, tmp_path):
    file = tmp_path / "tries"
    card(f"open({str(file)!r}, 'a').write('.'); print('cpu')")
    assert [ray_cluster._usable_gpus(RaySettings()) for _ in range(3)] == [0, 0, 0]
    assert file.read_text() == "."


def test_a_debugger_without_gpus_hides_them(monkeypatch):
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "1")
    with backend_for(RaySettings(address="debug", num_gpus=0)) as backend:
        assert backend.submit(os.getenv, "CUDA_VISIBLE_DEVICES").result() == ""
    with backend_for(RaySettings(address="debug")) as backend:
        assert backend.submit(os.getenv, "CUDA_VISIBLE_DEVICES").result() == "1"
