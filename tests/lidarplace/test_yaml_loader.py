"""YAML files as plain data: what is taken, what is refused and in which words."""

import re

import pytest
import yaml

from lidarplace.configuration import yaml as settings_yaml
from lidarplace.configuration.yaml import YamlError, parse_yaml, read_yaml_file
from tests.refused import refused


def refusal(text):
    with pytest.raises(YamlError) as error:
        parse_yaml(text)
    assert "\n" not in str(error.value)
    return error.value


def test_plain_data_is_as_pyyaml_reads_it():
    text = """
numbers: [1, -2, 0x10, 1.5, -.5, 1.0e-3, .inf, 1_000]
texts: [a, "b", 'c d', ~, null, yes, No, "", 1e, e1, 12e3x, a=b]
nested: {a: [{b: {}}, []]}
lines: |
  two
    lines
"""
    assert parse_yaml(text) == yaml.safe_load(text)
    assert parse_yaml("") is None


@pytest.mark.parametrize(
    ("text", "value"),
    [("1e-3", 0.001), ("-2E+4", -20000.0), ("2026-11-22", "2026-11-22"), ("=", "="), ("é", "é")],
)
def test_a_number_needs_no_dot_and_a_date_is_text(text, value):
    found = parse_yaml(text)
    assert (found, type(found)) == (value, type(value))


def test_what_an_alias_stands_for_is_not_shared():
    found = parse_yaml("a: &m {x: [1]}\nb: *m\nc: {<<: *m, y: 2}")
    found["a"]["x"].append(2)
    assert found == {"a": {"x": [1, 2]}, "b": {"x": [1]}, "c": {"x": [1], "y": 2}}
    text = "p: {q: &b {<<: &a {x: 0}, x: 1}}\nc: {<<: *b}"  # own keys win wherever they are
    assert parse_yaml(text) == {"p": {"q": {"x": 1}}, "c": {"x": 1}}


@pytest.mark.parametrize("key", ["b", "2", "2.0", "~", "'b'"])
def test_a_key_given_twice_is_named_with_its_place(key):
    text = f"b: 1\n2: 1\n~: 1\nc:\n  a: 1\n{key}: 3"
    assert refusal(text).place == "line 6, column 1"


def test_keys_are_compared_by_their_hashes(monkeypatch):
    """And so in linear time: no pair of these keys is compared."""
    compared = []

    class Key(str):
        def __eq__(self, other):
            compared.append(other)
            return str.__eq__(self, other)

        __hash__ = str.__hash__

    loader = settings_yaml._Loader
    as_key = {"tag:yaml.org,2002:str": lambda loader, node: Key(node.value)}
    monkeypatch.setattr(loader, "yaml_constructors", loader.yaml_constructors | as_key)
    assert len(parse_yaml("\n".join(f"k{i}: 1" for i in range(500)))) == 500
    assert len(compared) < 50  # of keys whose hashes happen to be alike


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a:\n  b: \0", "line 2, column 6: is not YAML: .*characters are not allowed"),
        ("a: 1\n---\nb: 2", "line 2, column 1: .*found another document"),
        ("a: [1", "line 2, column 1: is not YAML: "),
        ("a: %", "line 1, column 4: is not YAML: "),
    ],
)
def test_what_is_no_plain_data_is_refused_with_its_place(text, words):
    assert re.match(words, str(refusal(text)))


@pytest.mark.parametrize("opening", ["[", "{a: ", "- ", "[{? "])
def test_nesting_beyond_the_limit_is_refused_however_deep(opening):
    assert "more than 100 mappings and lists inside each other" in str(refusal(opening * 100_000))
    depth = settings_yaml.DEEPEST - 1
    text = "[" * depth + "1" + "]" * depth
    assert str(parse_yaml(text)) == text


def test_aliases_of_aliases_count_as_what_they_stand_for():
    """A few hundred bytes would be ten thousand million values."""
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 10)]
    assert "values, aliases written out" in str(refusal("\n".join(lines)))
    merged = ["b0: &b0 {x: 1}"]
    merged += [f"b{i}: &b{i} {{<<: [{', '.join([f'*b{i - 1}'] * 10)}]}}" for i in range(1, 10)]
    assert "values, aliases written out" in str(refusal("\n".join(merged)))


def test_a_file_is_read_with_its_name_in_every_mistake(tmp_path, monkeypatch):
    path = tmp_path / "own.yaml"
    path.write_bytes(b"\xef\xbb\xbfa: 1")  # as Windows' editors write it
    assert read_yaml_file(path) == {"a": 1}
    for content, line in (
        (b"a: 1\nb: \xff", "line 2"),
        ("a: 1".encode("utf-16"), "line 1"),
        (b"a: [", "line 2, column 1"),
        (b"a: 1\na: 2", "line 2, column 1"),
    ):
        path.write_bytes(content)
        with pytest.raises(YamlError) as error:
            read_yaml_file(path)
        assert error.value.place == f"{path}: {line}"
    with pytest.raises(IsADirectoryError):
        read_yaml_file(tmp_path)
    monkeypatch.setattr(settings_yaml, "MOST_BYTES", 4)
    path.write_text("a: 1")
    assert read_yaml_file(path) == {"a": 1}
    path.write_text("a: 12")
    with refused((str(path), "", "")):
        read_yaml_file(path)
