"""What holds for the settings of every kind of file."""

import math
from itertools import pairwise

import annotated_types
import pytest
from pydantic import TypeAdapter, ValidationError

from lidarplace.configuration import settings
from lidarplace.configuration.settings import Settings
from lidarplace.plugins.carla.command import Collection
from sweeps.configuration.search import SearchFile
from sweeps.configuration.sweep import SweepFile

FILES = (SweepFile, SearchFile, Collection)


def all_settings(model=Settings):
    for child in model.__subclasses__():
        yield child
        yield from all_settings(child)


def fields():
    for model in all_settings():
        for name, field in model.model_fields.items():
            yield pytest.param(field, id=f"{model.__name__}.{name}")


@pytest.mark.parametrize("field", list(fields()))
def test_a_field_narrows_its_kind(field):
    """Of two limits of one sort pydantic takes the last: it has to be the narrower one."""
    for limit, value, order in (
        (annotated_types.Ge, "ge", 1),
        (annotated_types.Gt, "gt", 1),
        (annotated_types.Le, "le", -1),
        (annotated_types.Lt, "lt", -1),
        (annotated_types.MaxLen, "max_length", -1),
    ):
        limits = [getattr(own, value) * order for own in field.metadata if isinstance(own, limit)]
        assert all(first < second for first, second in pairwise(limits))


def numbers(schema, where):
    """Places of a JSON schema that hold numbers."""
    if isinstance(schema, list):
        for i, inner in enumerate(schema):
            yield from numbers(inner, f"{where}[{i}]")
    if not isinstance(schema, dict):
        return
    if schema.get("type") in ("number", "integer"):
        yield where, schema
    for key, inner in schema.items():
        yield from numbers(inner, f"{where}.{key}")


@pytest.mark.parametrize("model", FILES)
def test_every_number_has_a_range(model):
    # Records of a LiDAR check themselves.
    free = (".Correction.", ".Mask.")
    for where, schema in numbers(model.model_json_schema(), model.__name__):
        if not any(name in where for name in free) and ".Lidar." not in where:
            assert {"minimum", "exclusiveMinimum"} & set(schema), where
            assert {"maximum", "exclusiveMaximum"} & set(schema), where


@pytest.mark.parametrize(
    "kind",
    [
        *("Count", "CountFromOne", "Seed", "Length", "Distance", "Angle", "Degrees", "Elevation"),
        *("Probability", "Seconds", "Factor", "Amount", "Number"),
    ],
)
@pytest.mark.parametrize("value", [True, "1", math.nan, math.inf, -math.inf, 1e308, -1e308, None])
def test_a_number_is_a_number_in_its_range(kind, value):
    adapter = TypeAdapter(getattr(settings, kind))
    assert adapter.validate_python(1) == 1
    with pytest.raises(ValidationError):
        adapter.validate_python(value)
