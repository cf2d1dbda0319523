"""Blocks of code in the pages of the docs."""

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md")),
    *sorted((ROOT / "docs").glob("*.md")),
]


@dataclass(frozen=True)
class Block:
    """A block of code, or a command in a line of text.

    Attributes:
        page: name of the page.
        number: of the block on its page.
        text: what is in it.
    """

    page: str
    number: int
    text: str

    def __str__(self) -> str:
        return f"{self.page}-{self.number}-{self.text}"


def blocks(language: str) -> list[Block]:
    """List all blocks in that language."""
    return [
        Block(page.name, number, text)
        for page in PAGES
        for number, text in enumerate(
            re.findall(rf"^```{language}\n(.*?)^```", page.read_text("utf-8"), re.M | re.S)
        )
    ]


def commands() -> list[Block]:
    """Every command of every block of shell, without comments and broken lines."""
    shell_commands = []
    for block in blocks("sh"):
        for line in block.text.replace("\\\n", " ").splitlines():
            command = " ".join(re.sub(r"(^|\s)#.*", "", line).split())
            if command:
                shell_commands.append(Block(block.page, block.number, command))
    return shell_commands


def commands_in_text() -> list[Block]:
    """Commands between backticks outside of blocks: `python …`, `pytest …`, `make …`."""
    commands = []
    for page in PAGES:
        text = re.sub(r"^```.*?^```", "", page.read_text("utf-8"), flags=re.M | re.S)
        for number, span in enumerate(re.findall(r"`([^`]+)`", text)):
            command = " ".join(span.split())
            if re.match(r"(\w+=\S* )*(python|pytest|make|lidarplace) ", command):
                commands.append(Block(page.name, number, command))
    return commands
