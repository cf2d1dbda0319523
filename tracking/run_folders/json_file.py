"""What a sweep or a search says of itself in a file of JSON: written from its model, and read as
it or refused."""

import json
from pathlib import Path
from typing import ClassVar, Self, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from lidarplace.configuration.settings import fault
from lidarplace.files.atomic import replacing
from lidarplace.files.regular import regular


class Part(BaseModel):
    """Frozen; keys that a page does not show are ignored."""

    model_config = ConfigDict(frozen=True, use_attribute_docstrings=True)


Model = TypeVar("Model", bound=Part)


class ResultFile(Part):
    """The whole of a file."""

    FILE: ClassVar[str]

    def write(self, folder: Path) -> None:
        """Write the keys that were given, in the order of the model, in one step.

        NaN and infinity, which JSON does not know, become null.
        """
        plain = json.loads(self.model_dump_json(by_alias=True, exclude_unset=True))
        with replacing(folder / self.FILE) as partial:
            partial.write_text(json.dumps(plain, indent=1), encoding="utf-8")

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Read it in `folder`; raises as `read_result_file`."""
        return read_result_file(folder / cls.FILE, cls)


def read_result_file(path: Path, model: type[Model]) -> Model:
    """Read `path`.

    Raises:
        ValueError: it is no JSON, or a key is missing or not as it must be; one line that names
            the file and the key.
        OSError: it cannot be read.
    """
    try:
        return model.model_validate_json(regular(path).read_bytes())
    except ValidationError as error:
        raise fault(error, str(path)) from None
