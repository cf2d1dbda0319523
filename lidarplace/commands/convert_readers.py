"""Readers of data sets by name, of other packages, too, and the command of each."""

import inspect
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from lidarplace.base.errors import InputError, at
from lidarplace.base.registry import Registry
from lidarplace.command_line.option_groups import with_option_group
from lidarplace.commands.convert_options import DataSetOptions, ReaderOptions
from lidarplace.commands.convert_output import convert_log
from lidarplace.logs.box_log import BoxLog
from lidarplace.scenes.datasets.openpcdet import read_openpcdet
from lidarplace.scenes.datasets.opv2v import read_opv2v
from lidarplace.scenes.datasets.pandaset import read_pandaset

READERS: Registry[Callable[..., BoxLog]] = Registry(
    "lidarplace.readers",
    {"openpcdet": read_openpcdet, "opv2v": read_opv2v, "pandaset": read_pandaset},
)
"""Functions of a path and of the boxes left out by class, with a docstring that is the help. Their
keywords of `SOURCE_OPTIONS`, `class_map`, `keep_ignored` and `lidar` are options."""

Out = Annotated[Path, typer.Argument(help="folder of the box log to write")]
SOURCE_OPTIONS: dict[str, Any] = {
    "origin": Annotated[
        tuple[float, float, float] | None,
        typer.Option(metavar="X Y Z", help="origin of the source's boxes in our ego frame, metres"),
    ],
    "splits": Annotated[
        list[str] | None,
        typer.Option("--split", help="folder of the data set; by default train and validate"),
    ],
    "test": Annotated[list[str] | None, typer.Option(help="name of a test drive; repeatable")],
}


def command_of_reader(name: str) -> Callable[..., None]:
    """Return the command of one of `READERS`; raise PluginError for none."""
    read = READERS[name]
    takes = inspect.signature(read).parameters

    def convert(source: Path, out: Path, options: ReaderOptions, **values: Any) -> None:
        def log(ignored: Counter[str]) -> BoxLog:
            offered = options.arguments(ignored, several=True) | {
                key: value for key, value in values.items() if value is not None
            }
            del offered["ignored"]
            arguments = {key: value for key, value in offered.items() if key in takes}
            with READERS.calls(name, ValueError, OSError), at(name * (name not in READERS.own)):
                box_log = read(source, ignored, **arguments)
            if not isinstance(box_log, BoxLog):
                kind = type(box_log).__name__
                raise InputError("wrong type", place=name, expected="a BoxLog", found=kind)
            return box_log

        convert_log(log, source, out, options)

    annotations = {
        "source": Annotated[Path, typer.Argument(help="what to read")],
        "out": Out,
        # The reader knows the rig, or the user names it.
        "options": DataSetOptions if "lidar" in takes else ReaderOptions,
    }
    required = [_parameter(key, kind) for key, kind in annotations.items()]
    keys = [key for key in SOURCE_OPTIONS if key in takes]
    convert.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
        [*required, *(_parameter(key, SOURCE_OPTIONS[key], default=None) for key in keys)]
    )
    convert.__doc__ = (inspect.getdoc(read) or "").partition("\n\n")[0]
    left_out = [key for key in ("class_map", "keep_ignored") if key not in takes]
    return with_option_group(*left_out)(convert)


def _parameter(name: str, annotation: Any, **default: Any) -> inspect.Parameter:
    kind = inspect.Parameter.POSITIONAL_OR_KEYWORD
    return inspect.Parameter(name, kind, annotation=annotation, **default)
