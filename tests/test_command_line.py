"""Commands: one style of help, one line for a mistake, exit codes, completion."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest
from typer.testing import CliRunner

from sweeps.command_line import VERBS, app
from tests.sweeps.small_log import write_small_log

ROOT = Path(__file__).parents[1]
CONVERT = ("nuscenes", "truckscenes", "argoverse", "table", "kitti", "openpcdet", "pandaset")
COMMANDS = [
    *(name for name in VERBS if name not in ("convert", "sensors")),
    *(f"convert {name}" for name in CONVERT),
    *("sensors list", "sensors fit", "sensors import"),
]


SHARED = {
    "--set": ["override a key path"],
    "--json": ["print JSON for a script"],
    "--dry-run": ["print the plan and exit", "print what would be removed"],
    "--schema": ["print the JSON schema of the file"],
}
"""Options that are the same in all commands, and their help."""


def lidarplace(*arguments, **options):
    words = [str(argument) for argument in arguments]
    return CliRunner().invoke(app, words, prog_name="lidarplace", **options)


def assert_one_line(result, *texts):
    """Expect exit code 2 and one line on stderr that has `texts`."""
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    assert result.exit_code == 2, result.output
    assert result.stdout == ""
    assert result.stderr.count("\n") == 1, result.stderr
    for text in texts:
        assert str(text) in result.stderr


# Help


@pytest.mark.parametrize("command", COMMANDS)
def test_help_has_examples_exit_codes_and_the_same_names_everywhere(command):
    result = lidarplace(*command.split(), "--help")
    assert result.exit_code == 0, result.output
    assert not re.search(r"list\[|docs/", result.stdout), "an installed package has no docs/"
    first, *lines = result.stdout.splitlines()
    assert first.startswith(f"Usage: lidarplace {command} ")
    start = next(i for i, line in enumerate(lines) if re.fullmatch("Examples?:", line))
    assert lines[start + 1].startswith(f"  lidarplace {command}")
    codes = lines[lines.index("Exit codes:") + 1 :]
    assert codes[0] == "  0    done"
    assert re.match("  (1|2)    ", codes[1])
    assert codes[-2:] == [
        "  2    invalid input: one line on stderr names it",
        "  130  stopped by Ctrl-C; 143 by SIGTERM",
    ]
    for line in re.findall(r"^  (--(?:set|json|dry-run|schema) .*)$", result.stdout, re.MULTILINE):
        name, rest = line.split(maxsplit=1)
        assert rest.split("  ")[-1].strip() in SHARED[name]
    for name in re.findall(r"^  ([^\s-]\S*) <", result.stdout, re.MULTILINE):
        assert name == name.upper()


def test_the_list_of_verbs_has_all_modules():
    """Every module with commands has a verb."""
    programs = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for package in ("lidarplace", "sweeps", "tracking")
        for path in (ROOT / package).rglob("*.py")
        if "\napp = new_app(" in path.read_text(encoding="utf-8")
    }
    assert programs == {verb.module for verb in VERBS.values()}


def test_the_list_of_verbs_says_what_they_do():
    assert lidarplace("--version").stdout.startswith("lidarplace 1.")
    text = lidarplace("--help").stdout
    for name, verb in VERBS.items():
        assert re.search(rf"^  {name} +{re.escape(verb.help())}$", text, re.MULTILINE)


def test_heavy_libraries_wait_until_they_are_needed():
    """Holds for `--help` and completion; `lidarplace --help` needs typer alone."""
    code = """
import sys
from importlib import import_module
from sweeps.command_line import VERBS
light = {"numpy", "rich", "lidarplace"} & set(sys.modules)
for verb in VERBS.values():
    import_module(verb.module)
print(light, {"torch", "ray", "mlflow", "optuna"} & set(sys.modules))
"""
    words = [sys.executable, "-c", code]
    assert subprocess.run(words, cwd=ROOT, capture_output=True).stdout == b"set() set()\n"


# Mistakes in a file

CONFIGURED = {
    "run": ("run", "FILE", "--dry-run"),
    "run --json": ("run", "FILE", "--dry-run", "--json"),
    "search": ("search", "FILE", "--dry-run"),
    "status": ("status", "FILE"),
    "status --json": ("status", "FILE", "--json"),
    "clean": ("clean", "FILE", "--dry-run"),
    "doctor": ("doctor", "FILE"),
    "record": ("record", "FILE", "out"),
    "pretrain": ("pretrain", "FILE", "--out", "base.pt"),
    "calibrate": ("calibrate", "FILE"),
    "requirements": ("requirements", "FILE", "--dry-run"),
    "carla": ("carla", "FILE", "out"),
    "studio": ("studio", "FILE", "--log", "LOG"),
}
CONTENTS = {
    "empty": b"",
    "no text": b"\xff\xfe\x00",
    "no YAML": b"scene: {density: [",
    "a tab": b"scene:\n\tdensity: 3\n",
    "a list": b"- scene\n",
    "unknown key": b"scen: {density: 40}\nscene: {densty: 40}\n",
    "wrong type": b"placement: line\nscene: 7\nsearch: 7\n",
}


@pytest.fixture
def in_folder(tmp_path, monkeypatch):
    """An empty current folder, and a box log beside it."""
    folder = tmp_path / "current"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


def words_of(verb, path, folder):
    return [{"FILE": path, "LOG": folder}.get(word, word) for word in CONFIGURED[verb]]


MISTAKES = [(verb, content) for verb in CONFIGURED for content in CONTENTS]
for verb in ("carla", "studio"):
    MISTAKES.remove((verb, "empty"))  # asks for the defaults


@pytest.mark.parametrize(("verb", "content"), MISTAKES)
def test_a_file_with_a_mistake(in_folder, verb, content, log):
    path = in_folder / "grid.yaml"
    path.write_bytes(CONTENTS[content])
    assert_one_line(lidarplace(*words_of(verb, path, log)), "grid.yaml")
    assert os.listdir(in_folder) == ["grid.yaml"], "nothing is left behind"


@pytest.mark.parametrize("verb", CONFIGURED)
def test_no_file_and_a_folder_in_its_place(in_folder, verb, log):
    words = words_of(verb, "grid.yaml", log)
    assert_one_line(lidarplace(*words), "grid.yaml", "No such file or directory")
    (in_folder / "grid.yaml").mkdir()
    assert_one_line(lidarplace(*words), "grid.yaml", "Is a directory")


@pytest.mark.parametrize("verb", ["run", "status", "record", "pretrain", "doctor", "search"])
@pytest.mark.parametrize(
    ("pair", "texts"),
    [
        ("training.epochs", "expected KEY=VALUE, with = between them, such as"),
        ("trainin.epochs=2", "did you mean training?"),
        ("training.epochs=many", "found 'many'"),
        ("training.epochs=[", "is not YAML"),
    ],
)
def test_an_override_with_a_mistake(in_folder, verb, pair, texts):
    content = "placement: line\n"
    if verb == "search":
        content = (ROOT / "examples/search.yaml").read_text(encoding="utf-8")
    (in_folder / "grid.yaml").write_text(content)
    words = words_of(verb, "grid.yaml", "log")
    assert_one_line(lidarplace(*words, "--set", pair), texts)


# Mistakes in a log or a run


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    folder = tmp_path_factory.mktemp("logs") / "log"
    write_small_log(folder)
    boxes = pd.read_parquet(folder / "boxes.parquet")
    boxes[boxes["frame"] > 0].to_parquet(folder / "boxes.parquet")
    return folder


FOLDERS = {
    "describe": ("describe", "FOLDER"),
    "describe --json": ("describe", "FOLDER", "--json"),
    "view": ("view", "FOLDER"),
    "export": ("export", "FOLDER", "out", "--placement", "line"),
    "report": ("report", "FOLDER"),
    "figures": ("figures", "FOLDER"),
    "search-report": ("search-report", "FOLDER"),
    **{f"convert {name}": ("convert", name, "FOLDER", "out") for name in CONVERT},
}


def prepared(kind, folder):
    """A folder that cannot be read, of some kind."""
    path = folder / "given"
    if kind == "a file":
        path.write_text("text")
    elif kind != "missing":
        path.mkdir()
    if kind == "damaged":
        for name in ("boxes", "frames", "trials", "surrogates", "results", "tasks"):
            (path / f"{name}.parquet").write_bytes(b"PAR1 and then nothing")
        (path / "config.yaml").write_text("name: given\n")
        (path / "search.json").write_text("{}")
        (path / "label_2").mkdir()
        (path / "label_2/000000.txt").write_text("Car 0.0\n")
    return path


@pytest.mark.parametrize("kind", ["missing", "a file", "empty", "damaged"])
@pytest.mark.parametrize("verb", FOLDERS)
def test_a_folder_that_cannot_be_read(in_folder, verb, kind):
    path = prepared(kind, in_folder)
    words = [path if word == "FOLDER" else word for word in FOLDERS[verb]]
    assert_one_line(lidarplace(*words), "given")
    assert os.listdir(in_folder) == [path.name] * path.exists(), "nothing is left behind"


@pytest.mark.parametrize(
    ("words", "texts"),
    [
        (("describe",), "Missing argument 'LOG...'"),
        (("status",), "Missing argument 'CONFIG'"),
        (("pretrain", "grid.yaml"), "Missing option '--out'"),
        (("status", "grid.yaml", "--al"), "No such option: --al"),
        (("view", "log", "--frame", "first"), "--frame"),
        (("view", "log", "--roi", "1", "2"), "--roi"),
        (("convert", "lyft", "a", "b"), "lyft"),
        (("stauts", "grid.yaml"), "Did you mean 'status'?"),
    ],
    ids=" ".join,
)
def test_a_usage_that_is_wrong(words, texts):
    result = lidarplace(*words)
    assert result.exit_code == 2
    assert result.stdout == ""
    last = result.stderr.splitlines()[-1]
    assert last.startswith("Error: ")
    assert texts in last
    assert "Traceback" not in result.stderr


SWEEP = "placement: line\n"
SEARCH = "search: {objective: expected_ig, zones: {roof: {x: [0, 1], y: [0, 1], z: 1.8}}}\n"


@pytest.mark.parametrize("verb", ["run", "record", "pretrain", "search"])
@pytest.mark.parametrize("key", ["output", "store"])
def test_a_place_that_cannot_be_written(in_folder, log, verb, key):
    """A file is in the way: the same command would not go on from there."""
    content = f"scene: {{source: log, folder: {log}}}\nclasses: [Car]\n"
    (in_folder / "grid.yaml").write_text(content + (SEARCH if verb == "search" else SWEEP))
    words = [word for word in words_of(verb, "grid.yaml", log) if word != "--dry-run"]
    result = lidarplace(*words, "--set", f"{key}=grid.yaml")
    assert (result.exit_code, result.stderr.count("\n")) == (2, 1), result.output
    assert "grid.yaml" in result.stderr
    assert "goes on" not in result.output


@pytest.mark.parametrize(("verb", "content"), [("run", SWEEP), ("search", SEARCH)])
def test_the_name_of_a_file_that_can_be_none_of_a_sweep(in_folder, log, verb, content):
    path = in_folder / "mein grüner.yaml"
    path.write_text(f"scene: {{source: log, folder: {log}}}\nclasses: [Car]\n{content}")
    texts = ("mein grüner.yaml: name: ", "'mein grüner'", "--set name=mein_grüner")
    assert_one_line(lidarplace(verb, path, "--dry-run"), *texts)
    result = lidarplace(verb, path, "--dry-run", "--set", "name=mein_grüner")
    assert result.exit_code == 0, result.output


# Ends


@pytest.mark.parametrize("words", [("run", "--schema"), ("--help",)])
def test_a_reader_that_has_gone(words):
    """Close the pipe as `| head` does; what little was printed is flushed at the end."""
    read, write = os.pipe()
    os.close(read)
    command = [sys.executable, "-c", "from sweeps.command_line import app; app()", *words]
    result = subprocess.run(command, cwd=ROOT, stdout=write, stderr=subprocess.PIPE, text=True)
    os.close(write)
    assert result.stderr == ""


# JSON


def test_the_plan_as_json(in_folder, log):
    config = in_folder / "grid.yaml"
    config.write_text(
        f"scene: {{source: log, folder: {log}}}\nclasses: [Car]\n"
        "grid: {placement: [line, center]}\npromote: [{by: expected_ig, keep: 1}]\n"
    )
    plan = json.loads(lidarplace("run", config, "--dry-run", "--json").stdout)
    assert list(plan) == [
        *("name", "stages", "rungs", "scenes", "trials", "requirements", "anchors"),
        *("memory", "cautions"),
    ]
    assert plan["stages"]["surrogates"] == {"tasks": 2, "cached": 0}
    assert plan["stages"]["finetune"] == {"tasks": 1, "cached": 0}
    assert plan["rungs"] == [{"by": "expected_ig", "keep": 1, "set": {}}]
    assert [trial["cached"] for trial in plan["trials"]] == [False, False]
    output = lidarplace("run", config, "--dry-run").stdout
    assert "grid: 2 trials; of these at most" in output
    assert "rung 0: expected_ig, the best 1 placements are kept" in output


def test_a_log_as_json(log):
    description = json.loads(lidarplace("describe", log, "--json").stdout)
    rows = description[str(log)]
    assert [row["scene"] for row in rows] == ["a", "a", "all"]
    assert rows[-1]["frames"] == 4
    assert rows[-1]["ROI Car"] == 3.0  # the mean counts the empty frame


# Completion


def completed(line):
    environment = {"_LIDARPLACE_COMPLETE": "complete_bash", "COMP_WORDS": line}
    return lidarplace(env=environment | {"COMP_CWORD": str(line.count(" "))}).stdout.split()


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("lidarplace re", ["report", "record", "requirements"]),
        ("lidarplace convert n", ["nuscenes"]),
        ("lidarplace clean --q", ["--quota"]),
        ("lidarplace view log --placement pyramid_", ["pyramid_roll", "pyramid_pitch"]),
        ("lidarplace view log --profile re", ["released-code"]),
        ("lidarplace export log out --split te", ["test"]),
        ("lidarplace run grid.yaml --set pl", ["placement", "placements"]),
        ("lidarplace run grid.yaml --set training.ep", ["training.epochs"]),
        ("lidarplace run grid.yaml --set scene.dens", ["scene.density"]),
        ("lidarplace search search.yaml --set search.tri", ["search.trials"]),
        ("lidarplace search search.yaml --set robustness.dr", ["robustness.draws"]),
        ("lidarplace run gr", []),  # the shell completes files
    ],
)
def test_completion(line, words):
    assert completed(line) == words


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_script_of_a_shell(shell):
    result = lidarplace(env={"_LIDARPLACE_COMPLETE": f"source_{shell}"})
    assert "_LIDARPLACE_COMPLETE" in result.stdout


def test_the_command_that_was_given(monkeypatch):
    from lidarplace.command_line.invocation import called, command

    monkeypatch.setattr(sys, "argv", ["/x/bin/lidarplace", "search", "my search.yaml"])
    assert called() == "lidarplace search 'my search.yaml'"
    assert command("search-report", "my run") == "lidarplace search-report 'my run'"


@pytest.mark.parametrize("name", ["training", "sweeps"])
def test_a_foreign_package_in_the_way(tmp_path, name):
    (tmp_path / name).mkdir()
    # An editable installation finds our modules in any package of that name.
    extension = f"__path__.append({str(ROOT / name)!r})" if name == "sweeps" else ""
    (tmp_path / name / "__init__.py").write_text(extension)
    words = [sys.executable, "-m", "sweeps.run", "--help"]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    result = subprocess.run(words, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert (result.returncode, result.stdout) == (2, "")
    assert result.stderr.startswith(f"{tmp_path / name}: hides the package {name} of lidarplace; ")
    assert result.stderr.count("\n") == 1
