"""XML from files and to files; what is wrong with a file is one line that names it."""

from pathlib import Path
from xml.etree.ElementTree import Element, ElementTree, ParseError, fromstring, indent

from lidarplace.base.errors import InputError
from lidarplace.files.atomic import read_text, reading, replacing


def read_xml(path: Path) -> Element:
    """Read the root of an XML file that declares no entities, which could grow without end.

    Raises ValueError: the file cannot be read, is not XML in UTF-8, or has a document type."""
    with reading(path):
        text = read_text(path)
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InputError("document types are not supported", place=path, fix="remove <!DOCTYPE …>")
    try:
        return fromstring(text.encode())
    except ParseError as error:
        line, column = error.position
        place, why = f"{path}: line {line}, column {column + 1}", str(error).partition(":")[0]
        raise InputError(f"invalid XML: {why}", place=place) from None
    except (LookupError, ValueError) as error:  # of an encoding that is declared
        raise InputError(f"invalid XML: {error}", place=path) from None


def write_xml(path: Path, root: Element) -> None:
    """Write an element as a file, a line for each one in it."""
    indent(root)
    with replacing(path) as partial:
        ElementTree(root).write(partial, encoding="utf-8", xml_declaration=True)
