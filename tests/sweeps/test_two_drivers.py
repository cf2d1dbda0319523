"""Two drivers at once: on one sweep the second is refused, of two sweeps each gets its results."""

import pandas as pd
from killing import Sweep

from sweeps.store.lock import locked
from tests.forked import GUARD_S


def test_the_second_driver_of_a_sweep_is_refused(tmp_path):
    sweep = Sweep(tmp_path / "sweep", "debug")
    with locked(sweep.folder / "runs/tiny", alone=True):
        process = sweep.start()
        assert process.wait(timeout=GUARD_S) == 2
    assert sweep.output().count("\n") == 1
    assert "runs/tiny is in use by a running sweep" in sweep.output()
    assert not (sweep.folder / "runs/store").exists()


def test_two_sweeps_share_a_store(tmp_path):
    """They compute the same at the same time, and create one database."""
    sweep = Sweep(tmp_path / "sweep", "debug")
    options = ("--set", "training.epochs=1", "--set", "grid.seed=[1]")
    one = sweep.start(*options)
    other = sweep.start(*options, "--set", "name=other")
    codes = [process.wait(timeout=GUARD_S) for process in (one, other)]
    assert codes == [0, 0], "\n".join((sweep.folder / f"run{n}.log").read_text() for n in (1, 2))
    for name in ("surrogates", "results"):
        ours, theirs = (
            pd.read_parquet(sweep.folder / f"runs/{run}/{name}.parquet")
            for run in ("tiny", "other")
        )
        assert len(ours)
        pd.testing.assert_frame_equal(ours, theirs)
    hidden = [p.name for p in sweep.folder.glob("runs/store/*/.*")]
    assert hidden == [], "nothing is left of the slower one"
