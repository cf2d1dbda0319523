"""Writes docs/commands.md from the commands themselves: `python docs/commands.py`."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

from typer.main import get_command
from typer.testing import CliRunner

from sweeps.command_line import VERBS

PAGE = Path(__file__).with_suffix(".md")

HEAD = """# Commands

The help of every command, made from the commands (`python docs/commands.py`).

`lidarplace --help` lists the commands, each with the extra that it needs (`pip install
'lidarplace[sweeps]'`), `lidarplace --version` prints the version. Without the extra a command ends
with exit code 2 and the `pip install` line. Its help, and options without the extra, such as
`run --dry-run`, work.

## Exit codes

- **0**: done.
- **1**: something failed or is incomplete; the help of the command lists the cases.
- **2**: invalid input. One line on stderr names the file and the key, the expected and the found
  value. An invalid option is in the last line, after the usage.
- **130**: stopped by Ctrl-C, **143**: by SIGTERM, which Slurm and Kubernetes send. A sweep, a
  search, a recording or a training goes on with the same command.

## Completion

```sh
lidarplace --install-completion    # for bash, zsh, fish or PowerShell, once
lidarplace --show-completion       # only print what would be installed
```

Verbs, options, files, placements, profiles, classes, splits and the key paths of `--set` are
completed.

## JSON

`--json` prints one JSON value to stdout and nothing else; exit codes do not change. Keys keep their
names and meanings; new keys may be added. `run --schema` and `search --schema` print the JSON
schema of the file.

- `run --dry-run`: `name`; `stages`, by stage `tasks` and `cached`; `rungs`, each with `by`, `keep`,
  `set`; `scenes`, each with `scene`, `train_frames`, `test_frames`; `requirements`, as
  `requirements --dry-run`; `trials`, each with `key`, `label`, `cached`; `anchors`; `memory`,
  most bytes that the voxels of a task take; `cautions`.
- `search --dry-run`: `name`, `lidars` (least, most), `zones`, `parameters`, `objectives` (`name`,
  `best`), `constraints` (`name`, `unit`, `limit`, `at_least`), `no_bound` (why there is none, or
  null), `trials`, `sampler`, `batch_size`, `seed`, `warnings`.
- `status` of a sweep: `kind` (`sweep`), `name`, `alive` (a driver runs); `stages`, by stage the
  number of tasks by status; `trials`, each with `label`, `status`, `detail`, `log`. A status is
  `done`, `running`, `stopped`, `waiting`, `failed` or `pruned`.
- `status` of a search: `kind` (`search`), `name`, `alive`; `trials`, with the numbers `wanted`,
  `done`, `feasible`, `failed`; `best`, each with `trial` and `values` by objective, empty
  while no trial keeps all constraints; `failures`, each with `trial`, `reason`; `verify`, as of a
  sweep without `kind`, null before it begins.
- `clean`: `dry_run`; `stages`, by stage `all` and `of_no_sweep`; `sweeps`, by name `refers_to`,
  `count`, `bytes`; `leftovers`, `removed`; `left_bytes`. A size is `count` and `bytes`.
- `doctor`: a list, each with `check`, `found`, `needed_for`, `state` (`good`, `weak`, `optional` or
  `missing`), `remedy`.
- `report`, `search-report`: `report`, the path of the page.
- `describe`: by folder a list of rows with `scene`, `split`, `routes`, `frames` and the objects per
  frame by region and class; null where a number is not known.
- `requirements`: `files`, path by suffix; `outcomes`, each with `rig`, `requirement`, `met`,
  `measure`, `at_least`, `for` and `cases`, each with `case`, `met`, `value`, `short_by`, `enough`,
  `x`, `y`, `heading_deg`, `at_worst`.
- `requirements --dry-run`: `rigs`; `requirements`, each with `requirement`, `measure`, `positions`,
  `objects`.
"""


def commands() -> list[tuple[str, str]]:
    """Verb and sub-command (or nothing), in the order of `lidarplace --help`."""
    found = []
    for name, verb in VERBS.items():
        command = get_command(import_module(verb.module).app)
        inner = getattr(command, "commands", {"": None})
        found += [(name, sub) for sub in inner]
    return found


def page() -> str:
    """The page as Markdown."""
    parts = [HEAD]
    for name, sub in commands():
        program = f"lidarplace {name}"
        app = import_module(VERBS[name].module).app
        words = [sub] if sub else []
        done = CliRunner().invoke(app, [*words, "--help"], prog_name=program, env={"COLUMNS": "80"})
        title = " ".join([name, *words])
        parts.append(f"\n## {title}\n\n```text\n{done.stdout.strip()}\n```\n")
    return "".join(parts)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
