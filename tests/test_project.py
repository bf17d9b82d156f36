"""Claims about the project's own files: one version, a workflow that fits it, advice that can be followed today."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import softclose

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
WORKFLOW = (ROOT / ".github" / "workflows" / "ci.yml").read_text("utf-8")


def test_the_version_is_written_in_one_place() -> None:
    assert "version" in PROJECT["project"]["dynamic"]
    assert "version" not in PROJECT["project"]
    source = (ROOT / PROJECT["tool"]["hatch"]["version"]["path"]).read_text("utf-8")
    assert re.findall(r'^__version__ = "(.*)"$', source, re.M) == [softclose.__version__]
    assert re.search(rf"^version: {re.escape(softclose.__version__)}$", (ROOT / "CITATION.cff").read_text(), re.M)


def test_a_release_s_tag_is_compared_with_the_version() -> None:
    (pattern,) = re.findall(r"sed -n 's/(.*?)/\\1/p' (\S+)\)", WORKFLOW)
    expression, path = pattern
    python = expression.replace(r"\(", "(").replace(r"\)", ")")
    assert re.findall(python, (ROOT / path).read_text("utf-8"), re.M) == [softclose.__version__]


def test_the_workflow_s_matrix_begins_where_the_package_does_and_its_targets_exist() -> None:
    (pythons,) = re.findall(r"python: \[(.*)\]", WORKFLOW)
    versions = re.findall(r'"([\d.]+)"', pythons)
    assert PROJECT["project"]["requires-python"] == f">={versions[0]}"
    assert [int(v.split(".")[1]) for v in versions] == [*range(11, 11 + len(versions))]
    makefile = (ROOT / "Makefile").read_text("utf-8")
    targets = re.findall(r"run: make (\S+)", WORKFLOW)
    assert {"test", "wheel", "lint", "docs"} <= set(targets)
    assert all(re.search(rf"^{target}:", makefile, re.M) for target in targets)


def test_the_pages_name_the_pythons_that_were_run_and_the_package_claims_no_others() -> None:
    (table,) = re.findall(r"## Where it runs\n(.*?)\n## ", (ROOT / "docs/releasing.md").read_text("utf-8"), re.S)
    run = sorted({v for line in table.splitlines() if "not tried" not in line for v in re.findall(r"3\.1\d", line)})
    classified = [c for c in PROJECT["project"]["classifiers"] if c.startswith("Programming Language :: Python :: 3.")]
    assert [c.rpartition(" ")[2] for c in classified] == run
    assert not any("MacOS" in c or "Windows" in c for c in PROJECT["project"]["classifiers"])
    for page in ("README.md", "CONTRIBUTING.md"):
        text = (ROOT / page).read_text("utf-8")
        assert all(said in text for said in ("Python 3.11 on Linux", "3.12", "3.14", "releasing.md#where-it-runs")), (
            page
        )


def test_no_advice_names_a_package_that_is_not_published() -> None:
    """`pip install softclose[…]` finds nothing yet: the extra's own packages are named."""
    texts = [p for folder in ("pipeline", "store", "workflows", "docs/how-to") for p in (ROOT / folder).rglob("*")]
    named = [str(p) for p in texts if p.suffix in (".py", ".md") and "softclose[" in p.read_text("utf-8")]
    assert named == []


def test_what_an_advised_package_is_called_is_in_the_extras() -> None:
    extras = {
        re.split(r"[<>=\[]", r)[0].lower() for rs in PROJECT["project"]["optional-dependencies"].values() for r in rs
    }
    for path in (ROOT / "docs" / "how-to").glob("*.md"):
        for advised in re.findall(r"pip install ([\w -]+?)[`(\n]", path.read_text("utf-8")):
            assert set(advised.lower().split()) <= extras, (path.name, advised)
