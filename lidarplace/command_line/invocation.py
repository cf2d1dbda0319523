"""Invocation of this program, so that the commands that it prints can be typed as they are."""

import json
import shlex
import sys
from collections.abc import Mapping
from typing import Any

from lidarplace.files.secret_urls import hide_secrets


def called() -> str:
    """Return the command that this process was started with, for a shell, without secrets."""
    return command(*map(hide_secrets, sys.argv[1:]))


def command(*words: str) -> str:
    """Return a command of this project for a shell: a verb and its arguments."""
    return shlex.join(["lidarplace", *words])


def with_settings(line: str, settings: Mapping[str, Any]) -> str:
    """Return the command `line` with `--set KEY=VALUE` for each key path, in place of earlier ones.

    Values are written as JSON, which is YAML."""
    words = iter(shlex.split(line))
    result: list[str] = []
    for word in words:
        pair = next(words, "") if word == "--set" else word.removeprefix("--set=")
        if pair == word or pair.partition("=")[0].strip() not in settings:
            result += [word] if pair == word else ["--set", pair]
    for key, value in settings.items():
        result += ["--set", f"{key}={json.dumps(value, separators=(',', ':'))}"]
    return shlex.join(result)
