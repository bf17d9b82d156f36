"""Claims about the frameworks themselves: each, in an environment of its own, drives our generator to the end."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SETTINGS = [
    "optimiser.engine=cmaes",
    "campaign.budget=45",
    "explore.budget=0",
    "finish.budget=0",
    "population.n_switches=40",
]
"""A generation of nine: what a framework asks for at once."""

COMMON = f"""
import json
from softclose_workflows.api.gest import SoftcloseGenerator

SETTINGS = {SETTINGS!r}

def bowl(point):
    return 20.0 + sum((point[name] - 0.5 * (v.domain[0] + v.domain[1])) ** 2 for name, v in vocs.variables.items())

vocs = SoftcloseGenerator.vocs_of("current", SETTINGS)
generator = SoftcloseGenerator(vocs, "current", SETTINGS)

def said(g):
    told = [[o.index, o.g_cm_s] for o in g._history] + [[i, o.g_cm_s] for i, o in g._told.items()]
    print("RESULT", json.dumps(told))
"""

LIBENSEMBLE = """
import numpy as np
from libensemble import Ensemble
from libensemble.alloc_funcs.start_only_persistent import only_persistent_gens
from libensemble.specs import AllocSpecs, ExitCriteria, GenSpecs, LibeSpecs, SimSpecs

def simulate(H, persis_info, sim_specs, _):
    out = np.zeros(len(H), dtype=sim_specs["out"])
    for i, row in enumerate(H):
        out["g_cm_s"][i] = bowl({name: float(row[name]) for name in vocs.variables})
    return out, persis_info

if __name__ == "__main__":
    Ensemble(
        parse_args=False,
        libE_specs=LibeSpecs(nworkers=2, comms="threads", gen_on_manager=True, final_gen_send=True),
        gen_specs=GenSpecs(generator=generator, vocs=vocs, initial_batch_size=9, batch_size=9),
        sim_specs=SimSpecs(sim_f=simulate, vocs=vocs),
        alloc_specs=AllocSpecs(alloc_f=only_persistent_gens),
        exit_criteria=ExitCriteria(sim_max=27),
    ).run()
    said(generator)
"""

XOPT = """
from xopt import Evaluator, Xopt

def evaluate(point):
    return {"g_cm_s": bowl(point)}

X = Xopt(generator=generator, evaluator=Evaluator(function=evaluate, max_workers=9))
for _ in range(3):
    X.step()
assert len(X.data) == 27
said(X.generator)
"""

OPTIMAS = """
from optimas.evaluators import FunctionEvaluator
from optimas.explorations import Exploration
from optimas.generators import ExternalGenerator

def evaluate(inputs, outputs):
    outputs["g_cm_s"] = bowl(inputs)

if __name__ == "__main__":
    Exploration(
        generator=ExternalGenerator(ext_gen=generator, vocs=vocs),
        evaluator=FunctionEvaluator(function=evaluate),
        max_evals=27,
        sim_workers=9,
        run_async=False,
        libe_comms="local_threading",
    ).run()
    said(generator)
"""

SCRIPTS = {"libensemble": LIBENSEMBLE, "xopt": XOPT, "optimas": OPTIMAS}


def environment(name: str) -> Path:
    """The interpreter of an environment with the framework over the packages of this one; made once, in `build`."""
    folder = ROOT / "build" / "frameworks" / name
    python = folder / "bin" / "python"
    if not (folder / "ready").exists():
        subprocess.run([sys.executable, "-m", "venv", "--clear", "--without-pip", str(folder)], check=True, timeout=300)
        own = sysconfig.get_path("purelib", vars={"base": str(folder), "platbase": str(folder)})
        (Path(own) / "ours.pth").write_text(sysconfig.get_path("purelib") + "\n")
        done = subprocess.run(
            [sys.executable, "-m", "pip", "--python", str(python), "install", "--quiet", "gest-api", name],
            capture_output=True, text=True, timeout=3000, check=False,
        )  # fmt: skip
        if done.returncode:
            pytest.skip(f"{name} is not installed: {done.stderr[-300:]}")
        (folder / "ready").touch()
    return python


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("framework", SCRIPTS)
def test_a_framework_itself_drives_the_generator(framework: str, tmp_path: Path) -> None:
    """Its points come back under their own numbers, with what the framework computed, generation after generation."""
    script = tmp_path / "drive.py"
    script.write_text(COMMON + SCRIPTS[framework])
    python = os.environ.get(f"SOFTCLOSE_PYTHON_{framework.upper()}") or str(environment(framework))
    paths = os.pathsep.join(str(ROOT / part) for part in ("pipeline", "store", "workflows"))
    done = subprocess.run(
        [python, "-P", str(script)], cwd=tmp_path, capture_output=True, text=True, timeout=900, check=False,
        env=os.environ | {"PYTHONPATH": paths, "OMP_NUM_THREADS": "1"},
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    told = json.loads(done.stdout.rpartition("RESULT ")[2].splitlines()[0])
    indices = sorted(i for i, _ in told)
    assert indices == list(range(len(indices)))
    assert len(indices) >= 18, "two generations at least came back, and a third was made of them"
    assert all(g >= 20.0 for _, g in told)
    generation = {i: g for i, g in told}
    first, last = (sorted(generation[i] for i in range(k, k + 9)) for k in (0, 9 * (len(indices) // 9 - 1)))
    assert last[4] < first[4], "the second generation is better than the first: results reached the engine"
