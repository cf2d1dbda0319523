from contextlib import suppress

from lidarplace.files import replacing, temporary


def test_a_file_is_replaced_at_the_end_or_not_at_all(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old")
    with suppress(KeyError), replacing(path) as partial:
        partial.write_text("half of the ne")
        raise KeyError
    assert path.read_text() == "old"
    with replacing(path) as partial:
        partial.write_text("new")
        assert path.read_text() == "old"
    assert path.read_text() == "new"
    assert list(tmp_path.iterdir()) == [path]


def test_two_writers_with_the_same_process_id_do_not_meet(tmp_path, monkeypatch):
    monkeypatch.setattr("os.getpid", lambda: 1)  # as on two hosts, or in two containers
    path = tmp_path / "a.txt"
    with replacing(path) as one, replacing(path) as other:
        one.write_text("one")
        other.write_text("other")
    assert path.read_text() == "one", "the outer one ends last"
    monkeypatch.setattr("socket.gethostname", lambda: "node7")
    assert temporary(path).name.startswith(".a.txt.node7-1-")
