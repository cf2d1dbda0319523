"""LiDARs known by name, `lidarplace sensors [NAME …]`, fitted or imported from files."""

from collections.abc import Iterator
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from lidarplace.command_line.terminal import output, say, table
from lidarplace.command_line.verbs import JsonOption, checked_input, new_app, print_json, verb
from lidarplace.commands.sensors_fit import fit
from lidarplace.commands.sensors_import import import_
from lidarplace.rigs.catalogue.datasheet import Datasheet, catalogue, datasheet


class _NamesOrFit(TyperGroup):
    """Group that lists the LiDARs that are named, unless the first word is another command."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        is_command = args and (args[0] in self.commands or args[0] == "--help")
        return super().parse_args(ctx, args if is_command else ["list", *args])


app = new_app(
    cls=_NamesOrFit,
    help="List the LiDARs that are known by name (`list` may be left out), fit one, or import "
    "one from its maker's file.",
)
verb(app, "metadata.json", "VLP16db.yaml --out lidar.yaml", name="import")(import_)
verb(app, "sweeps/ --like vlp32c --out lidar.yaml", "000000.bin --like hdl64e")(fit)

HEAD = (
    *("name", "model", "beams", "elevation", "azimuth", "rays"),
    *("range", "at 10 %", "at 80 %", "nearest", "noise", "nm", "kg", "W"),
)
"""Columns of the table, in degrees and metres."""


@verb(app, "", "vlp16 at128", "vlp16 --json", name="list")
def main(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[NAME...]",
            help="show only these, with all values and their sources",
            autocompletion=lambda: list(catalogue()),
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """List the LiDARs for `lidar: NAME` and `Lidar.named`, at 10 frames per second.

    Angles in degrees, ranges in metres: the farthest, those at reflectivities of 10 % and 80 %, the
    nearest, and the standard deviation. A dash means unknown."""
    with checked_input():
        sheets = [datasheet(name) for name in names or catalogue()]
    if as_json:
        print_json({sheet.name: sheet.model_dump(mode="json") for sheet in sheets})
        return
    words = ("model", "elevation")
    output().print(table(None, HEAD, (row(sheet) for sheet in sheets), words))
    for sheet in sheets if names else ():
        say("\n".join(["", f"{sheet.maker} {sheet.model}", *more(sheet)]))


def row(sheet: Datasheet) -> tuple[str, ...]:
    """Return the cells of `HEAD`."""
    named = sheet.name, f"{sheet.maker} {sheet.model}"
    ranges = sheet.range, sheet.range_10, sheet.range_80, sheet.min_range, sheet.range_noise
    others = sheet.wavelength_nm, sheet.mass_kg, sheet.power_w
    return (*named, *_view(sheet), f"{sheet.rays:,}", *map(_number, (*ranges, *others)))


def _view(sheet: Datasheet) -> tuple[str, str, str]:
    if sheet.rosette is not None:
        half = sheet.rosette.field_of_view_deg / 2
        return "rosette", f"{-half:.1f} to {half:.1f}", f"{2 * half:g}"
    low, high = sheet.azimuth_deg
    beams = sheet.elevations_deg
    return str(len(beams)), f"{beams[0]:.1f} to {beams[-1]:.1f}", f"{high - low:g}"


def more(sheet: Datasheet) -> Iterator[str]:
    """Yield lines of what `row` leaves out."""
    if sheet.size_mm is not None:
        yield f"  size: {' × '.join(f'{side:g}' for side in sheet.size_mm)} mm"
    if sheet.accuracy is not None:
        yield f"  accuracy: ±{sheet.accuracy:g} m"
    if sheet.points_per_second is not None:
        yield f"  points a second: {sheet.points_per_second:,}"
    if sheet.price_usd is not None:
        yield f"  price: {sheet.price_usd:,g} US dollars"
    yield from (f"  approximate: {value}" for value in sheet.approximate)
    yield from (f"  {source.title}: {source.url}" for source in sheet.sources)


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:g}"
