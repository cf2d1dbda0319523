"""Where a search stands, told from what lies on the disk; nothing is touched."""

import json
from types import SimpleNamespace

import pytest
import yaml

from sweeps.commands import clean, doctor, status
from sweeps.commands.search import app as search_app
from sweeps.search.output import state
from sweeps.search.output.state import search_state
from sweeps.search.problem.assess import Assessment
from sweeps.search.problem.problem import read_problem
from sweeps.search.trials.study import journal_path, open_study, quiet, storage_in, tell
from sweeps.search.trials.traffic import SurrogateEvaluator
from sweeps.store.local import Store
from sweeps.store.lock import locked
from sweeps.store.open import reference
from sweeps.sweep_or_search import is_search, read_either
from tests.sweeps.search_files import write_search
from tests.sweeps.toy import call


class Answers(SurrogateEvaluator):
    """Trial 2 keeps no constraint, trial 3 fails, the others are worth their number."""

    begun = ()

    def begin(self, trial, candidate):
        self.begun = [*self.begun, trial]

    def finish(self):
        for trial in self.begun:
            n = trial.number
            assessment = Assessment(None if n == 2 else {"expected_ig": float(n)}, {}, {}, {}, 0.1)
            values = None if n in (2, 3) else [float(n)]
            tell(self.study, trial, assessment, values, "out of memory" if n == 3 else None)
        self.begun = ()


@pytest.fixture
def path(tmp_path):
    return write_search(tmp_path, search={"trials": 8, "sampler": "random"}, verify={"seeds": [1]})


@pytest.fixture
def begun(path):
    """The first batch of four trials of eight."""
    problem = read_problem(path, ["search.trials=4"])
    problem.folder.mkdir(parents=True)
    with quiet():
        name = f"{reference(problem.sweep(), 'search')}-{problem.key}"
        study = open_study(storage_in(problem.folder), name, problem.file.search, [])
        Answers(study, problem, pool=None).run(lambda number: None)
    return problem


def told(path, *options):
    return call(status.app, path, *options).stdout


def test_nothing_has_begun(path, tmp_path):
    search = search_state(read_problem(path))
    assert search.trials == {"wanted": 8, "done": 0, "feasible": 0, "failed": 0}
    assert (search.alive, search.best, search.failures, search.verify) == (False, [], [], None)
    assert not (tmp_path / "runs").exists(), "a look leaves no trace"


def test_halfway(path, begun):
    journal = journal_path(begun.folder)
    with journal.open("ab") as file:
        file.write(b'{"half a li')  # as a driver that is writing
    before = journal.read_bytes()
    with locked(begun.folder, alone=True):
        content = json.loads(told(path, "--json"))
        text = told(path)
    assert journal.read_bytes() == before
    expected = {"kind": "search", "name": "small", "alive": True, "azimuth_stride": 1}
    expected["trials"] = {"wanted": 8, "done": 4, "feasible": 3, "failed": 1}
    expected["best"] = [{"trial": 1, "values": {"expected_ig": 1.0}}]
    expected |= {"failures": [{"trial": 3, "reason": "out of memory"}], "verify": None}
    assert content == expected
    assert "small: running; 4 of 8 trials done, 3 keep all constraints, 1 failed" in text
    assert "best so far: trial 1: expected_ig 1\n" in text
    assert "trial 3 failed: out of memory" in text


@pytest.mark.parametrize(("objective", "stride"), [("expected_ig", 3), ("covered_entropy", 1)])
def test_values_of_fewer_rays_are_told_of(path, monkeypatch, objective, stride):
    rays = " (as searched, rays of 1 in 3 azimuth steps)" if stride == 3 else ""
    trials = [SimpleNamespace(number=0, values=[4.0], params={})]
    monkeypatch.setattr(state, "stored_study", lambda *arguments: SimpleNamespace(trials=[]))
    monkeypatch.setattr(state, "best_trials", lambda study, space: trials)
    monkeypatch.setattr(state, "finished_trials", lambda study: [])
    options = ("--set", "search.azimuth_stride=3", "--set", f"search.objective={objective}")
    assert f"best so far: trial 0: {objective} 4{rays}\n" in told(path, *options)
    assert json.loads(told(path, "--json", *options))["azimuth_stride"] == stride


def test_the_trainings_of_verify(path, begun):
    sweep = yaml.safe_load(path.read_text())
    sweep = {key: sweep[key] for key in ("scene", "output", "classes")} | {"name": "small-verify"}
    sweep["surrogate"] = {"accuracy": False, "sampling_error": False}
    sweep["grid"] = {"placement": ["line", "center"], "seed": [1]}
    (begun.folder / "sweep.yaml").write_text(yaml.safe_dump(sweep))
    assert json.loads(told(path, "--json"))["verify"] is None, "it has not begun"
    (begun.file.output / "small-verify").mkdir()
    verify = json.loads(told(path, "--json"))["verify"]
    assert verify["stages"]["finetune"] == {"waiting": 2}
    assert "small-verify: no driver runs; 2 trials: 2 waiting" in told(path)


@pytest.mark.parametrize(
    "line", [b"nonsense\n", b"[1]\n", b'{"op_code": 99}\n', b"{}\n", b"\xff\n"]
)
def test_a_damaged_journal_is_one_line(path, begun, line):
    lines = journal_path(begun.folder).read_bytes().splitlines(keepends=True)
    journal_path(begun.folder).write_bytes(line + b"".join(lines))
    for app in (status.app, search_app):
        result = call(app, path, code=2)
        assert result.stderr.count("\n") == 1
        assert "optuna.journal: cannot be read" in result.stderr


def test_a_file_of_a_sweep_is_none_of_a_search(path, tmp_path):
    other = tmp_path / "grid.yaml"
    other.write_text("placement: line\n")
    assert is_search(path)
    assert not is_search(other)
    assert read_either(other).common.name == "grid"
    assert read_either(path).common.name == "small"


def test_the_store_of_a_search_is_cleaned(path, tmp_path):
    Store(tmp_path / "runs/store").refer("small.search", [])
    result = call(clean.app, path, "--dry-run", "--json")
    none = {"count": 0, "bytes": 0}
    expected = {"dry_run": True, "stages": {}, "leftovers": none, "removed": none, "left_bytes": 0}
    expected["sweeps"] = {"small.search": {"refers_to": 0} | none}
    assert json.loads(result.stdout) == expected


def test_the_doctor_reads_a_search(path):
    assert doctor.machine_needs(path).ray == "debug"
    assert doctor.scenes(path).found == "8 trials"


def test_the_plan_as_json(path):
    plan = json.loads(call(search_app, path, "--dry-run", "--json").stdout)
    assert (plan["name"], plan["trials"], plan["lidars"]) == ("small", 8, [2, 2])
    assert plan["objectives"] == [{"name": "expected_ig", "best": "maximize"}]
    assert [limit["name"] for limit in plan["constraints"]] == ["blind_lidars", "distance"]
