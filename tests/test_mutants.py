"""Claims about the scoring of tests: what counts as a change, both verdicts, and what the page adds up."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import mutants

MODULE = '''
"""A module."""

def larger(a: float, b: float = 3.0) -> float:
    """The larger one."""
    if a > b:
        raise ValueError(f"too large: {a + b}")
    return max(a, b)
'''

SCORED = """
import sys
sys.path[:0] = [{tests!r}]
import mutants
from pathlib import Path
mutants.ROOT, mutants.COPIED, mutants.SOURCES = Path({root!r}), ("m.py", "test_m.py"), (".",)
target = mutants.Target("m.py", ("test_m.py",), False)
with mutants.copies(1) as free:
    for o in mutants.score(target, free, 1, 40, 0, {{}}).outcomes:
        print(o.killed, o.before, "->", o.after)
"""


def test_a_change_that_the_tests_notice_is_killed_and_one_that_they_do_not_survives(tmp_path):
    (tmp_path / "m.py").write_text(MODULE)
    (tmp_path / "test_m.py").write_text("import m\ndef test(): assert m.larger(1.0, 2.0) == 2.0\n")
    script = SCORED.format(tests=str(Path(__file__).parent), root=str(tmp_path))
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=300, check=True)
    found = dict(reversed(line.split(" ", 1)) for line in done.stdout.splitlines())
    assert found["return max(a, b) -> return min(a, b)"] == "True"
    assert found["if a > b: -> if not a > b:"] == "True"
    assert found["if a > b: -> if a >= b:"] == "False"
    default = [change for change in found if change.startswith("def larger")]
    assert default
    assert {found[change] for change in default} == {"False"}
    assert not any("too large" in change for change in found)  # the wording of an error is nobody's claim


def test_the_page_counts_what_survives_without_an_excuse():
    def outcome(before, killed):
        return {"line": 1, "before": before, "after": "x", "killed": killed}

    outcomes = [outcome("a", True), outcome("b", True), outcome("c", True), outcome("d", False), outcome("e", False)]
    scores = {
        "p/m.py": {"places": 9, "outcomes": outcomes, "first": "1 of 5", "date": "2026-11-29", "commit": "0123abc"}
    }
    table = {
        "sample": 5,
        "modules": {"p/m.py": {"equivalent": [{"before": "e", "after": "x", "why": "The same."}]}, "p/n.py": {}},
    }
    page = mutants.page(table, scores)
    assert "| `m.py` | 9 | 5 | 3 | 1 | 1 | 75% | 1 of 5 | 2026-11-29 0123abc |" in page
    assert "* survives: `d` → `x`" in page
    assert "* equivalent: `e` → `x`. The same." in page
    assert "| `n.py` | | | | | | not scored yet | | |" in page
