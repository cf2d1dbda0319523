"""Frames of a log that are not in memory are read when somebody looks at them."""

import pandas as pd
import pytest

from lidarplace.logs.box_log import read_box_log, write_box_log
from lidarplace.studio import log_frames
from lidarplace.studio.log_frames import PORTIONS, LogFrames
from lidarplace.studio.rigs_file import read_rigs
from lidarplace.studio.studio import Studio
from tests.lidarplace.studio.rigs import ROI, log_of, written
from tests.refused import refused

FRAMES = 23
CARS = [(-9.0, 2.0), (-6.0, -3.0)]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A log of which three frames are read at a time; its numbers are not its places."""
    monkeypatch.setattr(log_frames, "PORTION", 3)
    log = log_of(CARS, FRAMES)
    for table in (log.boxes, log.frames):
        table["frame"] = 10 * table["frame"] + 5
    boxes = log.boxes[log.boxes["frame"] != 25]  # a frame without a box
    write_box_log(tmp_path / "log", type(log)(boxes, log.frames))
    return tmp_path / "log"


def test_who_plays_a_log_reads_each_portion_once_and_few_are_kept(folder, monkeypatch):
    reads = []

    def counted(folder, frames):
        reads.append(frames)
        return read_boxes(folder, frames)

    read_boxes = log_frames.read_boxes
    monkeypatch.setattr(log_frames, "read_boxes", counted)
    few = read_box_log(folder, 2)  # the first and the last
    frames = LogFrames(few, folder)
    for number in frames.numbers:
        frames.log_of(number)
    assert reads == [frames.numbers[at : at + 3] for at in range(0, FRAMES, 3)]
    assert len(frames._read) == PORTIONS
    frames.log_of(frames.numbers[-3])  # is still there
    assert frames.log_of(frames.numbers[0]) is few
    assert len(reads) == 8
    frames.log_of(frames.numbers[1])
    assert len(reads) == 9


def test_a_studio_shows_all_frames_and_its_numbers_are_of_some(folder, tmp_path):
    file, few = read_rigs(written(tmp_path)), read_box_log(folder, 4)
    studio = Studio(file, few, ROI, folder=folder)
    whole = Studio(file, read_box_log(folder), ROI)
    assert studio.frame_numbers == whole.frame_numbers
    for number in (5, 25, 35, 115, 225):
        for one in (studio, whole):
            one.show_frame(number)
        seen, expected = (one.view.objects(one.placement) for one in (studio, whole))
        pd.testing.assert_frame_equal(seen.reset_index(drop=True), expected.reset_index(drop=True))
        assert len(seen) == (0 if number == 25 else 2)
    assert studio.numbers() == Studio(file, few, ROI).numbers() != whole.numbers()
    studio.show_frame(115)
    assert studio.plot().data
    with refused(("", "frame", "6"), "23 frames, 5 to 225"):
        studio.show_frame(6)
    assert studio.view.number == 115


def test_a_frame_that_cannot_be_read_is_told(folder, tmp_path):
    studio = Studio(read_rigs(written(tmp_path)), read_box_log(folder, 2), ROI, folder=folder)
    (folder / "boxes.parquet").write_bytes(b"")
    studio.show_frame(115)
    with refused(("boxes.parquet", "", "")):
        _ = studio.view
    studio.show_frame(225)
    assert studio.view.number == 225
