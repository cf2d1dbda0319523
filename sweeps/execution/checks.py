"""What a machine has of what sweeps need: one plain function a check."""

from __future__ import annotations

import os
import platform
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias

from lidarplace.command_line.invocation import command
from lidarplace.files.secret_urls import hide_secrets, public_url

if TYPE_CHECKING:
    from packaging.requirements import Requirement

State: TypeAlias = Literal["good", "weak", "optional", "missing"]

_GB = 1e9
_RAY_S = 120.0
_SERVER_S = 10.0
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
class Finding:
    """What a check found.

    Attributes:
        check: what was looked at.
        found: what is there, in one line.
        needed_for: what does not work without it.
        state: "good"; "weak": works, but worse than it could; "optional": not there, and not asked
            for; "missing": needed and not there.
        remedy: one command or step that mends it.
    """

    check: str
    found: str
    needed_for: str
    state: State = "good"
    remedy: str = ""


def python_version() -> Finding:
    """Python's version."""
    good = sys.version_info >= (3, 11)
    return Finding(
        "Python",
        f"{platform.python_version()}, {sys.executable}",
        "everything",
        "good" if good else "missing",
        "" if good else "make clean && make setup PYTHON=python3.11",
    )


def packages(extra: str | None, name: str, needed_for: str, needed: bool) -> Finding:
    """The packages of an extra of this project, or those of every installation."""
    missing: State = "missing" if needed else "optional"
    try:
        wanted = _requirements(extra)
    except PackageNotFoundError:
        return Finding(name, "this project is not installed", needed_for, missing, "make setup")
    if not wanted:
        found = "this project was installed before it had a use for it"
        return Finding(name, found, needed_for, missing, _install(["--editable", f".[{extra}]"]))
    wrong, versions = {}, []
    for requirement in wanted:
        try:
            there = version(requirement.name)
        except PackageNotFoundError:
            wrong[_text(requirement)] = f"{requirement.name} is missing"
            continue
        versions.append(f"{requirement.name} {there}")
        if not requirement.specifier.contains(there, prereleases=True):
            wrong[_text(requirement)] = f"{versions[-1]}, needed {requirement.specifier}"
    if wrong:
        return Finding(name, "; ".join(wrong.values()), needed_for, missing, _install(list(wrong)))
    found = ", ".join(versions) if len(versions) < 4 else f"{len(versions)} packages"
    return Finding(name, found, needed_for)


def gpu() -> Finding:
    """Whether torch can use the GPU that is there."""
    import torch

    build = f"torch {torch.__version__}"
    name = "GPU"
    needed_for = "fast trainings"
    if torch.cuda.is_available():
        names = [torch.cuda.get_device_name(i) for i in range(torch.cuda.device_count())]
        return Finding(name, f"{', '.join(names)}; {build}", needed_for)
    if shutil.which("nvidia-smi") is None:
        return Finding(name, f"none; {build} trains on the CPU", needed_for, "optional")
    if torch.version.cuda is None:
        found = f"there is one, but {build} is built for the CPU"
        return Finding(name, found, needed_for, "weak", _GPU_SETUP)
    found = f"there is one, but {build} cannot use it"
    return Finding(name, found, needed_for, "weak", f"nvidia-smi, then {_GPU_SETUP}")


def ray(address: str) -> Finding:
    """Ray starts, or the cluster is joined, and runs a task on one thread."""
    name, needed_for = "Ray", "parallel tasks"
    if address == "debug":
        return Finding(name, "not used: ray is debug", needed_for)
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
        return Finding(
            name,
            f"no task ended within {_RAY_S:.0f} s",
            needed_for,
            "missing",
            _ray_remedy(address),
        )
    if process.returncode:
        found = (err.strip().splitlines() or [f"exit code {process.returncode}"])[-1]
        return Finding(name, found, needed_for, "missing", _ray_remedy(address))
    cpus, threads = out.split()[-2:]
    found = f"{version('ray')}, {address}: {cpus} CPUs, a task has {threads} thread"
    if threads != "1":
        return Finding(name, f"{found}s", needed_for, "weak", "unset NUMBA_NUM_THREADS")
    return Finding(name, found, needed_for)


def sumo(needed: bool) -> Finding:
    """Eclipse SUMO: its library, and the program that generates towns."""
    from lidarplace.scenes.sumo.town import sumo_home

    name, needed_for = "SUMO", "simulated traffic (scene.source: sumo)"
    missing: State = "missing" if needed else "optional"
    remedy = _install([_text(requirement) for requirement in _requirements("sumo")])
    try:
        program = sumo_home() / "bin" / "netgenerate"
    except ImportError as error:
        return Finding(name, f"{error.__cause__ or error}", needed_for, missing, remedy)
    try:
        done = subprocess.run(
            [program, "--version"], capture_output=True, text=True, timeout=60, check=True
        )
    except (OSError, subprocess.SubprocessError) as error:
        return Finding(name, f"{program}: {error}", needed_for, missing, f"{remedy} --force")
    return Finding(name, done.stdout.splitlines()[0].strip(), needed_for)


def disk(folder: Path, what: str, cleaned: str) -> Finding:
    """Space, inodes and the right to write where results lie.

    Args:
        cleaned: the argument with which `sweeps.clean` makes room.
    """
    name, needed_for = f"disk: {what}", f"results in {folder}"
    existing = _existing(folder)
    try:
        with tempfile.TemporaryFile(dir=existing):
            pass
    except OSError as error:
        found = f"{existing}: {error.strerror}"
        return Finding(name, found, needed_for, "missing", "name another output in the file")
    free = shutil.disk_usage(existing).free
    inodes = os.statvfs(existing)
    found = f"{free / _GB:,.0f} GB free"
    if inodes.f_files:  # some file systems do not count them
        found += f", {inodes.f_favail:,} files"
    state: State = "good"
    if free < 20 * _GB or (inodes.f_files and inodes.f_favail < 200_000):
        state = "weak"
    if free < _GB or (inodes.f_files and inodes.f_favail < 5_000):
        state = "missing"
    if state == "good":
        return Finding(name, found, needed_for)
    clean = command("sweeps.clean", cleaned)
    return Finding(name, found, needed_for, state, f"{clean}, or another output in the file")


def memory() -> Finding:
    """RAM against the number of CPUs, each of which runs a task."""
    total, available, cpus = *_memory(), os.cpu_count() or 1
    found = f"{total / _GB:.0f} GB, {available / _GB:.0f} GB free, {cpus} CPUs"
    needed_for = "a training on every CPU, some 2 GB each"
    fitting = int(available / _GB / 2)
    if fitting >= cpus:
        return Finding("memory", found, needed_for)
    remedy = f"--set ray.num_cpus={max(1, fitting)}"
    return Finding("memory", found, needed_for, "weak" if fitting else "missing", remedy)


def shared_memory() -> Finding:
    """/dev/shm, where Ray keeps its objects; a sweep's results go through files."""
    name, needed_for = "shared memory", "Ray's object store, 0.1 GB or more"
    free = shutil.disk_usage("/dev/shm").free
    state: State = "good" if free >= 0.1 * _GB else "weak"
    remedy = "" if state == "good" else "mount -o remount,size=2G /dev/shm (docker: --shm-size=2g)"
    return Finding(name, f"{free / _GB:.1f} GB free in /dev/shm", needed_for, state, remedy)


def mlflow(uri: str) -> Finding:
    """MLflow's database can be made, or its server answers. Asks only a server that is named."""
    from tracking.mlflow.uri import absolute_uri, is_server, sqlite_file

    name, needed_for, shown = "MLflow", "logging of trials", public_url(uri)
    try:
        absolute = absolute_uri(uri)
    except ValueError as error:
        return Finding(name, str(error), needed_for, "missing", "mend tracking.uri in the file")
    if is_server(uri):
        import requests  # as MLflow does: it sends the user and the password of the address

        from tracking.mlflow.connection import reason

        try:
            answer = requests.get(f"{uri.rstrip('/')}/health", timeout=_SERVER_S)
        except requests.RequestException as error:
            found = f"{shown}: {hide_secrets(reason(error), uri)}"
        else:
            if answer.ok:
                return Finding(name, f"{shown} answers", needed_for)
            found = f"{shown}: HTTP {answer.status_code}"
        return Finding(name, found, needed_for, "missing", "start the server, or mend tracking.uri")
    file = sqlite_file(absolute)
    if file is not None:
        folder = _existing(file.parent)
        if os.access(folder, os.W_OK) and (not file.exists() or os.access(file, os.W_OK)):
            return Finding(name, f"{shown}{'' if file.exists() else ', made at need'}", needed_for)
        return Finding(
            name, f"{file} cannot be written", needed_for, "missing", f"chmod u+w {folder}"
        )
    import sqlalchemy

    try:
        sqlalchemy.create_engine(
            absolute, connect_args={"connect_timeout": int(_SERVER_S)}
        ).connect().close()
    except ImportError as error:
        package = "psycopg2-binary" if "psycopg2" in str(error) else error.name or "its driver"
        return Finding(name, f"{shown}: {error}", needed_for, "missing", _install([package]))
    except sqlalchemy.exc.SQLAlchemyError as error:
        found = f"{shown}: {hide_secrets(str(error).splitlines()[0], uri)}"
        return Finding(
            name, found, needed_for, "missing", "start the database, or mend tracking.uri"
        )
    return Finding(name, f"{shown} answers", needed_for)


def remote_store(url: str) -> Finding:
    """The store at a URL can be written. Asks the server that the configuration names."""
    import fsspec

    name, needed_for = "store", f"results in {public_url(url)}"
    try:
        filesystem, root = fsspec.core.url_to_fs(url)
    except ImportError as error:
        package = getattr(error.__cause__, "name", None)
        return Finding(name, str(error), needed_for, "missing", _install([str(package)]))
    except ValueError as error:
        found = hide_secrets(str(error), url)
        return Finding(name, found, needed_for, "missing", "mend store.url in the file")
    probe = f"{root}/.doctor-{platform.node()}-{os.getpid()}"
    try:
        filesystem.makedirs(root, exist_ok=True)
        filesystem.pipe_file(probe, b"written by sweeps.doctor")
        filesystem.rm_file(probe)
    except Exception as error:  # every kind of store has its own errors
        found = hide_secrets(f"cannot be written: {type(error).__name__}: {error}", url)
        return Finding(name, found, needed_for, "missing", "mend store.url or its credentials")
    return Finding(name, "can be written", needed_for)


def _requirements(extra: str | None, package: str = "lidarplace") -> list[Requirement]:
    """What a package asks for with an extra, or without any.

    Raises:
        PackageNotFoundError: the package is not installed.
    """
    from packaging.requirements import Requirement

    found = []
    for requirement in map(Requirement, requires(package) or []):
        marker = requirement.marker
        always = marker is None or marker.evaluate({"extra": ""})
        for_extra = marker is not None and not always and marker.evaluate({"extra": extra or ""})
        if for_extra if extra else always:
            found.append(requirement)
            for further in requirement.extras:
                with suppress(PackageNotFoundError):  # it is missing itself, which is found
                    found += _requirements(further, requirement.name)
    return found


def _text(requirement: Requirement) -> str:
    """A requirement as pip takes it, without the conditions."""
    extras = f"[{','.join(sorted(requirement.extras))}]" if requirement.extras else ""
    return f"{requirement.name}{extras}{requirement.specifier}"


def _install(requirements: Sequence[str]) -> str:
    """The command that installs them here."""
    python = Path(sys.executable)
    shown = python.relative_to(Path.cwd()) if python.is_relative_to(Path.cwd()) else python
    return shlex.join([str(shown), "-m", "pip", "install", *requirements])


def _ray_remedy(address: str) -> str:
    return "see docs/cluster.md" if address != "local" else "--set ray=debug, to go on without Ray"


def _existing(folder: Path) -> Path:
    """The folder, or the one above it that is there."""
    return next(path for path in (folder.resolve(), *folder.resolve().parents) if path.is_dir())


def _memory() -> tuple[int, int]:
    """Bytes of RAM of this machine or its container, and those that are free."""
    lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
    kib = {line.split(":")[0]: int(line.split()[1]) for line in lines}
    total, available = kib["MemTotal"] * 1024, kib["MemAvailable"] * 1024
    limit = Path("/sys/fs/cgroup/memory.max")
    if limit.is_file() and (text := limit.read_text(encoding="ascii").strip()) != "max":
        total = min(total, int(text))
        used = int(Path("/sys/fs/cgroup/memory.current").read_text(encoding="ascii"))
        available = min(available, total - used)
    return total, max(0, available)
