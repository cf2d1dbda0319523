"""What a sweep or a search says of itself in a file of JSON, read as its model or refused."""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from lidarplace.configuration.settings import fault


class Part(BaseModel):
    """Frozen; keys that a page does not show are ignored."""

    model_config = ConfigDict(frozen=True)


Model = TypeVar("Model", bound=Part)


def read_result_file(path: Path, model: type[Model]) -> Model:
    """Read `path`.

    Raises:
        ValueError: it is no JSON, or a key is missing or not as it must be; one line that names
            the file and the key.
        OSError: it cannot be read.
    """
    try:
        return model.model_validate_json(path.read_bytes())
    except ValidationError as error:
        raise ValueError(f"{path}: {fault(error)}") from None
