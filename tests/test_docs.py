"""Claims about the documentation: every code block of every page runs, and every page can be reached.

Blocks of a page run in order, in one folder of their own with a copy of a small finished store in runs/current.zarr.
`python` blocks share one namespace; `sh` blocks go to bash, with this `softclose` on the PATH; a `toml` or `csv` block,
whose first line names a file, is written there as it is shown, and so is a `python` block that begins with such a name.
Output is shown in `text` blocks, which are not run.
"""

from __future__ import annotations

import os
import re
import runpy
import shlex
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

import pytest
from _pytest.mark import ParameterSet
from click.testing import CliRunner

from softclose_workflows.cli import main

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
GENERATED = DOCS / "reference"
PAGES = sorted(
    p for p in DOCS.rglob("*.md") if p.parent != GENERATED and not {"adr", "_build", "results"} & set(p.parts)
)
LANGUAGES = {"python", "sh", "toml", "csv", "text", "{toctree}"}
FENCE = re.compile(r"^```(\S*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@dataclass(frozen=True)
class Block:
    page: Path
    line: int
    language: str
    text: str

    @property
    def where(self) -> str:
        return f"{self.page.relative_to(ROOT)}:{self.line}"


def blocks(page: Path) -> list[Block]:
    text = page.read_text(encoding="utf-8")
    return [Block(page, text[: m.start()].count("\n") + 1, m.group(1), m.group(2)) for m in FENCE.finditer(text)]


def pages_with_code() -> list[Path]:
    return [p for p in [*PAGES, ROOT / "README.md"] if any(b.language in ("python", "sh", "toml") for b in blocks(p))]


@pytest.fixture(scope="session")
def launchers(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with `softclose` and `python` of this interpreter."""
    folder = tmp_path_factory.mktemp("bin")
    for name, arguments in (("softclose", " -m softclose_workflows"), ("python", "")):
        launcher = folder / name
        launcher.write_text(f'#!/bin/sh\nexec "{sys.executable}"{arguments} "$@"\n')
        launcher.chmod(0o755)
    return folder


SHORT = (
    "README.md",
    *(f"docs/how-to/{name}.md" for name in ("own-simulator", "own-waveform", "xarray")),
)
"""Pages that `make test` runs; `make long` runs the others."""


def every_page() -> list[ParameterSet]:
    """Pages with code, by their names."""
    names = {p.relative_to(ROOT).as_posix(): p for p in pages_with_code()}
    assert set(SHORT) <= set(names)
    return [pytest.param(p, id=name, marks=() if name in SHORT else pytest.mark.long) for name, p in names.items()]


@pytest.mark.slow
@pytest.mark.parametrize("page", every_page())
def test_every_block_of_the_page_runs(
    page: Path, finished_store: Path, launchers: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import matplotlib as mpl

    mpl.use("Agg")
    shutil.copytree(finished_store, tmp_path / "runs" / "current.zarr")
    shutil.copytree(ROOT / "scripts", tmp_path / "scripts")
    monkeypatch.chdir(tmp_path)
    namespace: dict[str, object] = {"__name__": "__main__"}
    for block in blocks(page):
        script = re.match(r"# (\S+\.py)\n", block.text)
        if script is not None:
            (tmp_path / script.group(1)).write_text(block.text, encoding="utf-8")
        elif block.language == "python":
            code = compile("\n" * block.line + block.text, str(page), "exec")
            exec(code, namespace)
        elif block.language in ("toml", "csv"):
            first = re.match(r"# (\S+\.(?:toml|csv))\n", block.text)
            assert first is not None, f"{block.where}: the first line must name the file"
            (tmp_path / first.group(1)).write_text(block.text, encoding="utf-8")
        elif block.language == "sh":
            run_shell(block, launchers, tmp_path)


def run_plain(block: Block, line: str) -> bool:
    """Run one simple command in this process, which saves the start of another; False where it needs a shell."""
    words = shlex.split(line)
    if words[:1] == ["softclose"] and ({"run", "resume"}.isdisjoint(words) or "--serial" in words):
        done = CliRunner().invoke(main, words[1:])
        assert done.exit_code == 0, f"{block.where}: {line}\n{done.output}\n{done.exception}"
        return True
    if words[:1] == ["python"] and words[1].endswith(".py"):
        with patch.object(sys, "argv", words[1:]):
            runpy.run_path(words[1], run_name="__main__")
        return True
    return False


def run_shell(block: Block, launchers: Path, folder: Path) -> None:
    """Run a block in bash, or line by line in this process where no line needs a shell."""
    simple = not set("|<>&;$") & set(block.text)
    lines = []
    for line in block.text.replace("\\\n", " ").splitlines():
        if line.startswith("make "):  # CI runs these itself; here each has to be a target
            target = line.split()[1]
            assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text(), re.MULTILINE), f"{block.where}: {line}"
        elif line.startswith("pip install") or line.startswith("git clone"):
            continue  # needs a network; `make env` does the same in CI
        elif not (simple and run_plain(block, line)):
            lines.append(line)
    if not lines:
        return
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", "\n".join(lines)],
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
        cwd=folder,
        env=os.environ
        | {
            "PATH": f"{launchers}:{os.environ['PATH']}",
            "MPLBACKEND": "Agg",
            "OMP_NUM_THREADS": "1",
            "PYTHONPATH": os.pathsep.join(str(ROOT / part) for part in ("pipeline", "store", "workflows")),
        },
    )
    assert done.returncode == 0, f"{block.where} exits {done.returncode}\n{done.stdout}\n{done.stderr}"


def test_blocks_are_of_languages_that_are_run_or_plainly_output() -> None:
    unknown = [f"{b.where}: {b.language!r}" for p in PAGES for b in blocks(p) if b.language not in LANGUAGES]
    assert unknown == []


def test_every_room_is_on_the_page_of_rooms_and_every_path_there_exists() -> None:
    page = (DOCS / "explanation" / "rooms.md").read_text(encoding="utf-8")
    sources = {p.parent: p for top in ("pipeline", "store", "workflows") for p in (ROOT / top).glob("*/__init__.py")}
    parents = {package.name: package.parent for package in sources}
    named = set(re.findall(r"`(softclose\w*(?:/[\w.]+)*)`", page))
    assert [path for path in named if not (parents[path.partition("/")[0]] / path).exists()] == []
    rooms = {f"{p.name}/{q.parent.name}" for p in sources for q in p.glob("*/__init__.py")}
    assert sorted(rooms - named) == []


def test_the_life_of_a_proposal_is_as_its_script_draws_it() -> None:
    script = runpy.run_path(str(DOCS / "life_of_a_proposal.py"))
    assert script["TARGET"].read_text(encoding="utf-8") == script["draw"]()


def test_every_page_is_in_a_table_of_contents() -> None:
    listed = set()
    for page in PAGES:
        for block in blocks(page):
            if block.language == "{toctree}":
                for entry in block.text.splitlines():
                    if entry and not entry.startswith(":"):
                        listed |= {p.with_suffix("") for p in page.parent.glob(f"{entry}.md")}
    missing = [str(p) for p in PAGES if p.with_suffix("") not in listed and p != DOCS / "index.md"]
    assert missing == []
