"""Secrets of addresses are in nothing that leaves the process, and in all that it uses."""

import sys

import pytest

from lidarplace.command_line.invocation import called
from lidarplace.files.secret_urls import check_whole, hide_secrets, hide_secrets_in, public_url
from tests.refused import refused


@pytest.mark.parametrize(
    ("url", "hidden"),
    [
        ("sqlite:////runs/a:b@c.db", "sqlite:////runs/a:b@c.db"),
        ("http://host:5000", "http://host:5000"),
        ("ftp://me:s3cret@host:5000/x", "ftp://me:***@host:5000/x"),
        ("s3://bucket/folder", "s3://bucket/folder"),
        ("s3://key:s3cret@bucket/folder", "s3://key:***@bucket/folder"),
        ("postgresql://me:s@cr/3t@host:5432/db", "postgresql://me:***@host:5432/db"),
        ("postgresql://me:s3cret two@host/db", "postgresql://me:***@host/db"),
        ("postgresql://me@host/db?password=s3cret&x=1", "postgresql://me@host/db?password=***&x=1"),
        ("https://s3cret@host/x", "https://***@host/x"),
        ("https://h/x?X-Amz-Signature=s3cret&keep=2", "https://h/x?X-Amz-Signature=***&keep=2"),
        ("https://h/x?sv=1&sig=s3cret%2F&se=2", "https://h/x?sv=1&sig=***&se=2"),
        ("https://h/x?access_token=s3cret#end", "https://h/x?access_token=***#end"),
        ("abfs://container@account.host/x", "abfs://container@account.host/x"),
    ],
)
def test_secrets_of_an_address(url, hidden):
    assert public_url(url) == hidden
    quoted = f'{{"url": "{url}", "n": 1}}'
    assert public_url(url) in hide_secrets(quoted, url)
    assert hide_secrets_in({"store": {"url": [url]}, "n": 1}) == {
        "store": {"url": [hidden]},
        "n": 1,
    }
    if hidden != url:
        with refused(("", "store", hidden)):
            check_whole("store", hidden)
    check_whole("store", url)


def test_a_secret_by_itself():
    url = "ftp://me:s3cr%40t@host/x"
    text = hide_secrets("login of me with s3cr@t or s3cr%40t failed", url)
    assert text == "login of me with *** or *** failed"
    short = "ftp://me:e@host/x"
    assert hide_secrets("the end", short) == "the end"


def test_a_recorded_command_has_no_secret(monkeypatch):
    words = ["x", "--set", "store.url=ftp://me:s3cret@host/x", "--set", "tracking.uri=http://a:b@c"]
    monkeypatch.setattr(sys, "argv", words)
    assert "s3cret" not in called()
    assert "store.url=ftp://me:***@host/x" in called()
