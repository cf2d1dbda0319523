"""Secrets in addresses, which stay in the process: what is written or printed has *** instead."""

import re
from collections.abc import Sequence
from typing import Any
from urllib.parse import unquote

from lidarplace.base.errors import InputError

HIDDEN = "***"

# Up to the last @: a password in which @ or / was not escaped must not show its end.
_PASSWORD = re.compile(r"(://[^\s:/@\"']*):([^\s\"]*)@")
_TOKEN_AS_USER = re.compile(r"(https?://)([^\s:/@\"']+)@")
_QUERY = re.compile(
    r"([?&;](?:[\w.%-]*(?:passw|pwd|token|secret|signature|credential|key)[\w.%-]*|sig)=)"
    r"([^&\s\"'#;]+)",
    re.IGNORECASE,
)
_NAME = re.compile(
    r"(?:^|[-_.])(?:passw(?:or)?d|pwd|token|secret|credentials?|"
    r"(?:api|access|auth|secret|private)[-_]?key)$",
    re.IGNORECASE,
)
_TOKEN = re.compile(
    r"(?<![A-Za-z0-9])(?:hf_|gh[opsu]_|github_pat_|glpat-|sk-|xox[a-z]-|AKIA|eyJ)[\w.-]{12,}"
)
_SHORTEST = 4
"""Least characters of a secret to look for by itself: shorter ones are parts of other words."""


def hide_secrets(text: str, *urls: str | None) -> str:
    """Return `text` with *** for the password of every address in it, and for tokens of its query.

    `urls` are addresses whose secrets the text may hold by themselves, or in spaces."""
    for url in filter(None, urls):
        for secret in secrets_in(url):
            if len(secret) >= _SHORTEST:
                text = text.replace(secret, HIDDEN).replace(unquote(secret), HIDDEN)
    text = _PASSWORD.sub(rf"\1:{HIDDEN}@", text)
    text = _TOKEN_AS_USER.sub(rf"\1{HIDDEN}@", text)
    return _QUERY.sub(rf"\1{HIDDEN}", text)


def public_url(url: str) -> str:
    """Return an address without its secrets, whatever is in them."""
    return hide_secrets(url, url)


def hide_secrets_in(value: Any) -> Any:
    """Return plain data, such as a configuration, with `public_url` for every text in it."""
    if isinstance(value, str):
        return public_url(value)
    if isinstance(value, dict):
        return {key: hide_secrets_in(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [hide_secrets_in(item) for item in value]
    return value


def secrets_in(url: str) -> list[str]:
    """Return the password and the tokens of one address, which may have spaces in them."""
    secrets = re.findall(r"://[^:/@]*:(.*)@", url) + [m[2] for m in _TOKEN_AS_USER.finditer(url)]
    return [secret for secret in secrets + [m[2] for m in _QUERY.finditer(url)] if secret]


def secret_argument(words: Sequence[str]) -> str | None:
    """Return the option, variable or beginning of a word of a command that looks like a secret.

    Such as `--api-key …`, `HF_TOKEN=…`, `ghp_…`; None if there is none."""
    for word, following in zip(words, [*words[1:], ""], strict=True):
        name, equals, value = word.partition("=")
        value = value if equals else following if word.startswith("-") else ""
        if _NAME.search(name) and value and value[0] not in "-{$":
            return name
        if token := _TOKEN.search(word):
            return f"{token[0][:4]}…"
    return None


def check_whole(key: str, url: str) -> None:
    """Raise ValueError if a secret was hidden, as in the files that a command leaves."""
    if HIDDEN in secrets_in(url):
        problem = "the secret was left out where this was written"
        raise InputError(problem, key=key, found=url, fix="give the whole address")
