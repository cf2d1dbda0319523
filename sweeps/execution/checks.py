"""Checks of what sweeps need of a machine: one function a check."""

from __future__ import annotations

import math
import os
import platform
import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias

from lidarplace.command_line.invocation import command
from lidarplace.files.atomic import check_takes_files
from lidarplace.files.secret_urls import hide_secrets, public_url
from sweeps.execution.memory import machine_memory
from training.nvidia import driver_version, has_card

if TYPE_CHECKING:
    from packaging.requirements import Requirement

State: TypeAlias = Literal["good", "weak", "optional", "missing"]

_GB = 1e9
_RAY_S = 120.0
_CPU_SETUP = "pip install uv; uv pip install --torch-backend cpu 'lidarplace[all]'"
_GPU_SETUP = "make clean && make setup TORCH_BACKEND=auto"
_RAY_TASK = """
import sys
from sweeps.execution.backends import backend_for
from sweeps.configuration.sweep import RaySettings

def threads():
    import numba
    return numba.get_num_threads()

try:
    with backend_for(RaySettings(address=sys.argv[1])) as backend:
        print(backend.cores, backend.submit(threads).result())
except ValueError as error:
    sys.exit(str(error))
"""


@dataclass(frozen=True)
class CheckResult:
    """The result of a check.

    `found`: a line. `state`: "good"; "weak": works, but worse than it could; "optional": missing,
    and not needed; "missing": needed and missing. `remedy`: one command or step that mends it."""

    found: str
    state: State = "good"
    remedy: str = ""


def packages(extra: str | None, needed: bool) -> CheckResult:
    """Check the packages of an extra of this project, or those of every installation."""
    missing: State = "missing" if needed else "optional"
    try:
        requirements = _requirements(extra)
    except PackageNotFoundError:
        return CheckResult("this project is not installed", missing, "make setup")
    if not requirements:
        problem = "this project was installed before it had a use for it"
        return CheckResult(problem, missing, _install(["--editable", f".[{extra}]"]))
    faults, versions = {}, []
    for requirement in requirements:
        try:
            installed = version(requirement.name)
        except PackageNotFoundError:
            faults[_text(requirement)] = f"{requirement.name} is missing"
            continue
        versions.append(f"{requirement.name} {installed}")
        if not requirement.specifier.contains(installed, prereleases=True):
            faults[_text(requirement)] = f"{versions[-1]}, needed {requirement.specifier}"
    if faults:
        remedy = _install(list(faults))
        if any(text.startswith("torch") for text in faults) and not has_card():
            remedy = f"{_CPU_SETUP}, without the 5 GB of CUDA that {remedy} brings"
        return CheckResult("; ".join(faults.values()), missing, remedy)
    return CheckResult(", ".join(versions) if len(versions) < 4 else f"{len(versions)} packages")


def gpu(needed: bool = False) -> CheckResult:
    """Check for a GPU, and that torch and triton can use it."""
    import torch

    from training.device import device, gpu_problem

    build = f"torch {torch.__version__}"
    if problem := gpu_problem():
        return CheckResult(f"{problem} ({build})", "missing" if needed else "weak")
    if device().type == "cuda":
        names = [torch.cuda.get_device_name(i) for i in range(torch.cuda.device_count())]
        free, total = (size / _GB for size in torch.cuda.mem_get_info())
        versions = f"driver {driver_version()}, {build}, CUDA {torch.version.cuda}"
        import triton  # its distribution has several names

        text = f"{', '.join(names)}; {free:.0f} of {total:.0f} GB free; {versions}"
        text += f", triton {triton.__version__}"
        return CheckResult(text)
    if not has_card():
        state: State = "missing" if needed else "optional"
        smaller = f"in a new environment, 5 GB less: {_CPU_SETUP}" if torch.version.cuda else ""
        return CheckResult(f"none; {build} trains on the CPU", state, smaller)
    if torch.version.cuda is None:
        problem = f"there is one, but {build} is built for the CPU"
        return CheckResult(problem, "missing" if needed else "weak", _GPU_SETUP)
    hidden = f"hidden by CUDA_VISIBLE_DEVICES; {build} trains on the CPU"
    return CheckResult(hidden, "missing" if needed else "optional", "unset CUDA_VISIBLE_DEVICES")


def ray(address: str) -> CheckResult:
    """Check that Ray starts, or the cluster is joined, and runs a task on one thread."""
    if address == "debug":
        return CheckResult("not used: ray is debug")
    process = subprocess.Popen(
        [sys.executable, "-c", _RAY_TASK, address],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        out, err = process.communicate(timeout=_RAY_S)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        return CheckResult(f"no task ended within {_RAY_S:.0f} s", "missing", _ray_remedy(address))
    if process.returncode:
        problem = (err.strip().splitlines() or [f"exit code {process.returncode}"])[-1]
        return CheckResult(problem, "missing", _ray_remedy(address))
    cpus, threads = out.split()[-2:]
    text = f"{version('ray')}, {address}: {cpus} CPUs, a task has {threads} thread"
    if threads != "1":
        return CheckResult(f"{text}s", "weak", "unset NUMBA_NUM_THREADS")
    return CheckResult(text)


SUMO_LIBRARIES = ("libatomic1", "libexpat1", "libgl1", "libx11-6", "libxext6", "libxrender1")
"""Debian's packages of the libraries that SUMO links and its wheel lacks."""


def sumo(needed: bool) -> CheckResult:
    """Check the library of Eclipse SUMO, and the program that generates towns."""
    from lidarplace.scenes.sumo.town import sumo_home

    missing: State = "missing" if needed else "optional"
    remedy = _install([_text(requirement) for requirement in _requirements("sumo")])
    try:
        program = sumo_home() / "bin" / "netgenerate"
    except ImportError as error:
        problem = f"{error.__cause__ or error}"
        if "shared object file" in problem:  # as on a server without a desktop
            remedy = f"apt-get install {' '.join(SUMO_LIBRARIES)}"
        return CheckResult(problem, missing, remedy)
    try:
        process = subprocess.run(
            [program, "--version"], capture_output=True, text=True, timeout=60, check=True
        )
    except (OSError, subprocess.SubprocessError) as error:
        return CheckResult(f"{program}: {error}", missing, f"{remedy} --force")
    return CheckResult(process.stdout.splitlines()[0].strip())


def disk(folder: Path, cleaned: str) -> CheckResult:
    """Check space, inodes and the right to write in the folder of results.

    `cleaned`: argument of `lidarplace clean` that makes room."""
    try:
        existing = check_takes_files(folder)
    except OSError as error:
        return _not_writable(error, "name another output or store in the file")
    free, inodes = shutil.disk_usage(existing).free, os.statvfs(existing)
    files = inodes.f_favail if inodes.f_files else math.inf  # some file systems do not count them
    text = f"{free / _GB:,.0f} GB free" + (f", {files:,} files" if inodes.f_files else "")
    if free >= 20 * _GB and files >= 200_000:
        return CheckResult(text)
    state: State = "missing" if free < _GB or files < 5_000 else "weak"
    return CheckResult(text, state, f"{command('clean', cleaned)}, or another output in the file")


def memory() -> CheckResult:
    """Check RAM against the number of CPUs, each of which runs a task."""
    total, available, cpus = *machine_memory(), os.cpu_count() or 1
    text = f"{total / _GB:.0f} GB, {available / _GB:.0f} GB free, {cpus} CPUs"
    fitting = int(available / _GB / 2)
    if fitting >= cpus:
        return CheckResult(text)
    remedy = f"--set ray.num_cpus={max(1, fitting)}"
    return CheckResult(text, "weak" if fitting else "missing", remedy)


def shared_memory() -> CheckResult:
    """Check /dev/shm, where Ray keeps its objects; results of a sweep go through files."""
    free = shutil.disk_usage("/dev/shm").free
    text = f"{free / _GB:.1f} GB free in /dev/shm"
    remedy = "mount -o remount,size=2G /dev/shm (docker: --shm-size=2g)"
    return CheckResult(text) if free >= 0.1 * _GB else CheckResult(text, "weak", remedy)


def mlflow(uri: str) -> CheckResult:
    """Check that MLflow's database can be made, or that the server at `uri` answers."""
    from tracking.mlflow.connection import connect, reason
    from tracking.mlflow.uri import absolute_uri, sqlite_file

    public, remedy = public_url(uri), "correct tracking.uri in the file"
    try:
        uri = absolute_uri(uri)
        if (file := sqlite_file(uri)) is not None:
            try:
                check_takes_files(file.parent)
                if not file.exists():
                    return CheckResult(f"{public}, made at need")
                file.open("r+b").close()
            except OSError as error:
                return _not_writable(error, remedy)
        connect(uri).search_experiments(max_results=1)
    except Exception as error:  # each kind of server has its own
        problem = hide_secrets(f"{public}: {reason(error, uri)}", uri)
        start = "" if sqlite_file(uri) else "start the server or the database, or "
        return CheckResult(problem, "missing", f"{start}{remedy}")
    return CheckResult(f"{public} answers")


def remote_store(url: str) -> CheckResult:
    """Check that the store at a URL, which the configuration names, can be written."""
    import fsspec

    try:
        filesystem, root = fsspec.core.url_to_fs(url)
    except ImportError as error:
        package = getattr(error.__cause__, "name", None)
        return CheckResult(str(error), "missing", _install([str(package)]))
    except ValueError as error:
        return CheckResult(
            hide_secrets(str(error), url), "missing", "correct store.url in the file"
        )
    probe = f"{root}/.doctor-{platform.node()}-{os.getpid()}"
    try:
        filesystem.makedirs(root, exist_ok=True)
        filesystem.pipe_file(probe, b"written by lidarplace doctor")
        filesystem.rm_file(probe)
    except Exception as error:  # every kind of store has its own errors
        problem = hide_secrets(f"cannot be written: {type(error).__name__}: {error}", url)
        return CheckResult(problem, "missing", "correct store.url or its credentials")
    return CheckResult("can be written")


def _requirements(extra: str | None, package: str = "lidarplace") -> list[Requirement]:
    """List what a package requires with an extra, or without. Raises PackageNotFoundError."""
    from packaging.requirements import Requirement

    requirements = []
    for requirement in map(Requirement, requires(package) or []):
        marker = requirement.marker
        always = marker is None or marker.evaluate({"extra": ""})
        if always if not extra else not always and marker and marker.evaluate({"extra": extra}):
            requirements.append(requirement)
            for further in requirement.extras:
                with suppress(PackageNotFoundError):  # it is missing itself, which is reported
                    requirements += _requirements(further, requirement.name)
    return requirements


def _text(requirement: Requirement) -> str:
    extras = f"[{','.join(sorted(requirement.extras))}]" if requirement.extras else ""
    return f"{requirement.name}{extras}{requirement.specifier}"


def _install(requirements: Sequence[str]) -> str:
    python = Path(sys.executable)
    if python.is_relative_to(Path.cwd()):
        python = python.relative_to(Path.cwd())
    return shlex.join([str(python), "-m", "pip", "install", *requirements])


def _ray_remedy(address: str) -> str:
    head = "start the head node, `ray start --head`, or --set ray.address=local"
    return head if address != "local" else "--set ray=debug, to run without Ray"


def _not_writable(error: OSError, remedy: str) -> CheckResult:
    return CheckResult(f"{error.filename}: {error.strerror}", "missing", remedy)
