"""The program `lidarplace`: set-up before other imports."""

import signal
import sys
from importlib.util import find_spec
from pathlib import Path


def main(*verb: str) -> None:
    """Start the program; `verb` comes before the words of the command line."""
    # Until a verb takes care of it, Ctrl-C ends the program without the traceback of an import.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    if (folder := _foreign_package()) is not None:
        hint = "run lidarplace in another folder, or rename this one"
        hides = f"{folder}: hides the package {folder.stem} of lidarplace"
        print(f"{hides}; {hint}", file=sys.stderr)
        sys.exit(2)
    from sweeps.command_line import app

    sys.argv[1:1] = verb
    app(prog_name="lidarplace")


def _foreign_package() -> Path | None:
    """Return the folder or file that Python finds in place of a package of ours."""
    for name in ("sweeps", "lidarplace", "training", "tracking"):
        spec = find_spec(name)
        if spec is not None and spec.origin is not None:
            origin = Path(spec.origin)
            if not origin.samefile(Path(__file__).parents[1] / name / "__init__.py"):
                return origin.parent if origin.name == "__init__.py" else origin
    return None


if __name__ == "__main__":
    main()
