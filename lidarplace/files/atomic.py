"""Files of text, and files that appear in one step, so that a reader never meets half of one."""

import errno
import os
import re
import secrets
import shutil
import socket
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from lidarplace.base.errors import InputError
from lidarplace.files.regular import regular


def read_text(path: Path) -> str:
    """Read the text of a file. Raises OSError: it cannot be read; ValueError: it is not UTF-8."""
    try:
        return regular(path).read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise InputError(f"not a text file: {first_line(error)}", place=path) from None


@contextmanager
def reading(path: Path, kind: str = "", *errors: type[Exception]) -> Iterator[None]:
    """Raise InputError that names `path` for an OSError of the block that reads it.

    Also for `errors`, which mean that the file is not of that kind."""
    try:
        yield
    except errors as error:
        raise InputError(f"not {kind}: {first_line(error)}", place=path) from None
    except FileNotFoundError:
        raise InputError("no such file", place=path) from None
    except OSError as error:  # libraries raise it without a number too
        raise InputError(f"cannot be read: {first_line(error)}", place=path) from None


def first_line(error: Exception) -> str:
    """Return a library's reason for a failure, without further lines about itself."""
    if isinstance(error, UnicodeDecodeError):
        return f"byte {error.start} is not UTF-8"
    if isinstance(error, KeyError):
        return f"no {error}"
    text = getattr(error, "strerror", None) or (str(error).strip().splitlines() or [""])[0]
    return text or type(error).__name__


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path next to `path`, a file or a folder, that takes its place at the end.

    Raises OSError: `path` is a device, a pipe or a socket, which stays."""
    check_replaceable(path)
    partial = temporary(path)
    try:
        with naming(path):
            yield partial
            sync(partial)
            partial.replace(path)
    finally:
        if partial.is_dir():
            shutil.rmtree(partial, ignore_errors=True)
        else:
            partial.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write a file of text, see `replacing`."""
    with replacing(path) as partial:
        partial.write_text(text, encoding="utf-8")


def temporary(path: Path) -> Path:
    """Return a hidden name next to `path` that no other process uses, on any host."""
    return path.with_name(f".{path.name}.{unique()}.part")


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Raise errors of a full disk again with the file, the disk and the room on it.

    Also those of a temporary file, with the file that it stands for."""
    try:
        yield
    except OSError as error:
        reason = error.strerror
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            disk = next(p for p in (path.absolute(), *path.absolute().parents) if p.is_mount())
            free = shutil.disk_usage(disk).free
            reason = f"{os.strerror(error.errno)}: {free / 1e6:.1f} MB are free on {disk}"
        elif not str(error.filename).startswith(str(path.with_name(f".{path.name}."))):
            raise
        raise OSError(error.errno, reason, str(path)) from error


def check_replaceable(path: Path) -> None:
    """Raise OSError if `path` is neither a file, a folder nor free: /dev/full is not replaced."""
    if path.exists() and not path.is_file() and not path.is_dir():
        reason = "is a device, a pipe or a socket, which is not replaced; a file is expected"
        raise OSError(errno.EEXIST, reason, str(path))


def check_takes_files(folder: Path) -> Path:
    """Return `folder`, or the one above it in which it would be made; leave nothing behind.

    Raises OSError if it takes no file."""
    try:
        existing = next(p for p in (folder, *folder.parents) if p.is_symlink() or p.exists())
        tempfile.TemporaryFile(dir=existing).close()
    except OSError as error:
        reason = f"cannot be written: {error.strerror}"
        raise OSError(error.errno, reason, str(folder)) from None
    return existing


def remove_leftovers(folder: Path, pattern: str = ".*.part*") -> None:
    """Remove what processes of this host were writing into a folder when they were killed.

    What a running process writes stays, and what another host of a shared disk wrote."""
    of_host = re.compile(
        rf"\..+\.{re.escape(socket.gethostname())}-(\d+)-[0-9a-f]{{8}}\.part(-\w+)?"
    )
    for path in list(folder.glob(pattern)):
        match = of_host.fullmatch(path.name)
        if match is None or _runs(int(match[1])):
            continue
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)


def _runs(process: int) -> bool:
    """Return whether a process of this host has that number, which may be another one's by now."""
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:  # of another user
        return True
    return True


def unique() -> str:
    """Return a unique name with the host and the process."""
    return f"{socket.gethostname()}-{os.getpid()}-{secrets.token_hex(4)}"


def sync(path: Path) -> None:
    """Wait until a file, or the list of names in a folder, is on the disk.

    Without it a machine that loses power can keep a later rename and lose what was written
    before."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
