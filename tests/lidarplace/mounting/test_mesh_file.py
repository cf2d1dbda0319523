"""Mesh files that are damaged: read or refused in one line, and nothing else on the terminal."""

from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lidarplace.mounting.mesh_file import read_mesh
from tests.refused import refused

trimesh = pytest.importorskip("trimesh")


def written(kind):
    body = trimesh.creation.box((4.0, 2.0, 1.5))
    body.apply_translation((0.0, 0.0, 0.8))
    more = {"encoding": "ascii"} if kind == "ply" else {}
    data = body.export(file_type=kind, **more)
    return data.encode() if isinstance(data, str) else data


FILES = {kind: written(kind) for kind in ("stl_ascii", "stl", "ply", "obj")}


@pytest.mark.parametrize("kind", FILES)
def test_a_changed_bit_is_read_or_refused_in_silence(kind, tmp_path_factory, capfd, recwarn):
    path = tmp_path_factory.mktemp("mesh") / f"body.{kind.partition('_')[0]}"

    @settings(max_examples=60)
    @given(bit=st.integers(0, 8 * len(FILES[kind]) - 1))
    def check(bit):
        data = bytearray(FILES[kind])
        data[bit // 8] ^= 1 << bit % 8
        path.write_bytes(data)
        with suppress(ValueError):
            read_mesh(path)

    check()
    assert capfd.readouterr() == ("", "")
    assert [str(w) for w in recwarn.list] == []


@pytest.mark.parametrize("number", [b"1e300", b"inf", b"nan", b"1e999"])
def test_huge_coordinates_are_one_line(tmp_path, capfd, recwarn, number):
    path = tmp_path / "body.stl"
    path.write_bytes(FILES["stl_ascii"].replace(b"vertex -2.0", b"vertex " + number, 1))
    with pytest.raises(ValueError, match=r"body\.stl: "):
        read_mesh(path)
    assert capfd.readouterr() == ("", "")
    assert [str(w) for w in recwarn.list] == []


def test_a_damaged_normal_is_named(tmp_path, capfd):
    path = tmp_path / "body.stl"
    path.write_bytes(FILES["stl_ascii"].replace(b"normal ", b"normal !", 1))
    with refused(("body.stl", "", "face_normals")):
        read_mesh(path)
    path.write_bytes(FILES["stl_ascii"])
    assert np.allclose(np.ptp(read_mesh(path).vertices, axis=0), [4.0, 2.0, 1.5])
    assert capfd.readouterr() == ("", "")
