"""Claims about the command line as a whole: help, examples, exit codes, completion, and no traceback for a mistake."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import click
import pytest
from click.testing import CliRunner, Result

import softclose_workflows
from softclose import __version__
from softclose_workflows.cli import COMMANDS, folded, main

HEAVY = ["dask", "distributed", "matplotlib", "numba", "numpy", "pandas", "pydantic", "rich", "scipy"]
HEAVY += ["skopt", "sklearn", "xarray", "zarr"]


def softclose(*arguments: str) -> Result:
    return CliRunner().invoke(main, list(arguments))


def commands(
    command: click.Command = main, path: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], click.Command]]:
    """Every command with the words that call it."""
    yield path, command
    if isinstance(command, click.Group):
        arguments = tuple("STORE" for p in command.params if isinstance(p, click.Argument))
        for name, sub in command.commands.items():
            yield from commands(sub, (*path, *arguments, name))


EVERY = list(commands())


@pytest.mark.parametrize(("path", "command"), EVERY, ids=[" ".join(p) or "softclose" for p, _ in EVERY])
def test_every_command_has_help_with_examples_that_parse(path: tuple[str, ...], command: click.Command) -> None:
    done = softclose(*path, "--help")
    assert done.exit_code == 0
    assert command.help
    examples = re.findall(r"^\s+(softclose .*)$", command.epilog or "", re.MULTILINE)
    assert examples, "no example in the epilog"
    for example in examples:
        words = shlex.split(re.split(r" [|>] | && ", example)[0], comments=True)[1:]
        parse(main, words)


@pytest.mark.parametrize(("path", "command"), EVERY, ids=[" ".join(p) or "softclose" for p, _ in EVERY])
def test_help_fits_80_columns(path: tuple[str, ...], command: click.Command) -> None:
    wide = [line for line in softclose(*path, "--help").output.splitlines() if len(line) > 80]
    assert wide == []


def test_an_example_that_is_folded_is_the_same_command() -> None:
    example = """  softclose bench tell a.zarr 5 b.csv --reason "a guess, no more" --json | jq '.a | .b'"""
    for width in (30, 45, 60, 200):
        lines = folded(example, width).split("\n")
        assert shlex.split(" ".join(line.removesuffix("\\") for line in lines)) == shlex.split(example)
        assert all(len(line) <= width for line in lines)
        assert all(line.endswith(" \\") for line in lines[:-1])
    assert folded(example, 200) == example


def parse(command: click.Command, words: list[str]) -> None:
    """Resolve a command line without running it."""
    context = command.make_context("softclose", list(words), resilient_parsing=False)
    if isinstance(command, click.Group):
        rest = [*context._protected_args, *context.args]
        name, sub, rest = command.resolve_command(context, rest)
        assert sub is not None, name
        parse(sub, rest)


def test_every_option_says_what_it_does() -> None:
    silent = [
        f"{' '.join(path)} {option.opts[-1]}"
        for path, command in EVERY
        for option in command.params
        if isinstance(option, click.Option) and not option.help and option.opts[-1] != "--format"
    ]
    assert silent == []


def test_help_has_every_command_in_one_group_with_a_sentence_that_fits_80_columns() -> None:
    listed = [name.replace("_", "-") for group in COMMANDS.values() for name in group]
    assert sorted(listed) == sorted(main.commands)
    assert len(set(listed)) == len(listed)
    lines = softclose("--help").output.splitlines()
    for title, group in COMMANDS.items():
        place = lines.index(f"{title}:")
        for offset, (name, does) in enumerate(group.items(), start=1):
            assert lines[place + offset].split(None, 1) == [name.replace("_", "-"), does]
            assert len(lines[place + offset]) <= 80
            assert does.endswith(".")


def test_no_two_commands_begin_with_the_same_five_letters() -> None:
    """`certify` stood beside `certificates`, and people took one for the other; what belongs together may."""
    names = sorted(set(main.commands) - {"compare-engines"})
    assert len({name[:5] for name in names}) == len(names)


def test_version_is_the_package_s() -> None:
    assert softclose("--version").output.strip() == f"softclose, version {__version__}"


@pytest.mark.parametrize("arguments", [("--help",), ("run", "--help"), ("--version",), ("completion", "bash")])
def test_help_imports_nothing_heavy(arguments: tuple[str, ...]) -> None:
    code = (
        "import sys\nfrom softclose_workflows.cli import main\n"
        f"try: main({list(arguments)!r}, prog_name='softclose')\nexcept SystemExit: pass\n"
        f"found = sorted(set({HEAVY!r}) & set(sys.modules))\nassert not found, found"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_prints_a_script_for_each_shell(shell: str) -> None:
    done = softclose("completion", shell)
    assert done.exit_code == 0
    assert f"{shell}_complete" in done.output


def test_bash_completes_commands(tmp_path: Path) -> None:
    if shutil.which("bash") is None:
        pytest.skip("bash is not installed")
    launcher = tmp_path / "softclose"
    launcher.write_text(
        f'#!/bin/sh\nexec "{sys.executable}" -c "from softclose_workflows.cli import main; '
        'main(prog_name=\'softclose\')" "$@"\n'
    )
    launcher.chmod(0o755)
    script = (
        'eval "$(softclose completion bash)"\n'
        "COMP_WORDS=(softclose sta); COMP_CWORD=1; _softclose_completion softclose\n"
        'echo "${COMPREPLY[@]}"\n'
    )
    env = os.environ | {"PATH": f"{tmp_path}:{os.environ['PATH']}", "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, timeout=60, env=env, check=False)
    assert done.stdout.split() == ["status"], done.stderr


@pytest.mark.parametrize(
    "arguments",
    [
        ("run", "curent", "--store", "{}/a.zarr"),
        ("run", "absent.toml", "--store", "{}/a.zarr"),
        ("run", "current"),
        ("run", "current", "--store", ""),
        ("run", "current", "--store", "{}/a.zarr", "--set", "campaign.seeed=1"),
        ("run", "current", "--store", "{}/a.zarr", "--set", "campaign.seed"),
        ("run", "current", "--store", "{}/a.zarr", "--set", "population.n_switches=many"),
        ("run", "current", "--store", "{}/file/a.zarr"),
        ("resume", "{}/none.zarr"),
        ("status", "{}/none.zarr"),
        ("status", "{}/none.zarr", "--watch"),
        ("status", "{}"),
        ("status", "{}/file"),
        ("export", "{}/none.zarr", "history"),
        ("completion", "tcsh"),
        ("runn",),
    ],
    ids=" ".join,
)
def test_a_mistake_is_one_message_and_exit_code_2(tmp_path: Path, arguments: tuple[str, ...]) -> None:
    (tmp_path / "file").write_text("a file")
    done = softclose(*(a.replace("{}", str(tmp_path)) for a in arguments))
    assert done.exit_code == 2, (done.output, done.exception)
    assert done.output.strip()
    assert "Traceback" not in done.output
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_verbose_shows_where_an_error_came_from(tmp_path: Path) -> None:
    done = softclose("--verbose", "run", "curent", "--store", str(tmp_path / "a.zarr"))
    assert done.exit_code == 2
    assert "Traceback" in done.output
    assert "did you mean 'current'?" in done.output


def test_output_to_a_pipe_has_no_colour(finished_store: Path) -> None:
    for arguments in (["status", str(finished_store)], ["status", str(finished_store), "--watch"]):
        done = subprocess.run(
            [sys.executable, "-m", "softclose_workflows", *arguments],
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        )
        assert done.returncode == 0, done.stderr
        assert "\x1b" not in done.stdout


def test_no_table_loses_its_units(capsys: pytest.CaptureFixture[str]) -> None:
    """rich takes `[cm/s]` for markup, and drops it, unless its console is told not to: there is one console."""
    from rich.table import Table

    from softclose_workflows.tell.console import wide_console

    table = Table(title="speeds [m/s]", caption="times [s]")
    table.add_column("v_u [cm/s]")
    table.add_row("3 [m]")
    wide_console().print(table)
    said = capsys.readouterr().out
    assert [unit for unit in ("[m/s]", "[s]", "[cm/s]", "[m]") if unit not in said] == []
    package = Path(softclose_workflows.__file__).parent
    made = {p.name for p in package.rglob("*.py") if re.search(r"import .*\bConsole\b", p.read_text("utf-8"))}
    assert made == {"terminal.py", "console.py", "watch.py"}, "and what is live is drawn on one of these"
