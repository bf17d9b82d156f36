"""Claims about the kernels' code: generated files are current, the cache follows the source, plain Python agrees."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from softclose.kernel import generate_series, source, taylor

ROOT = Path(__file__).parents[2]

PROGRAM = """
import math, sys
import numpy as np
import pytest
from softclose import Pulse, Waveform, simulate
waveform = Waveform([Pulse(0, 5, 9, 118), Pulse(40, 20, math.inf, 70)])
table = np.array([[2.43, 3.68, 65.3, 3.41], [1.9, 4.0, 60.0, 3.2], [2.7, 3.7, 80.0, 3.5]])
for method in ("taylor", "rk"):
    r = simulate(table, waveform, method=method, rtol=1e-8, times_us=[10.0, 80.0, 200.0], max_impacts=4)
    for a in (r.max_contact_speed, r.first_contact_us, r.settling_us, r.n_impacts, r.closed, r.x, r.impact_speed):
        print(*[f"{v:.6f}" for v in np.ravel(a).astype(float)])
"""


def test_the_series_are_what_their_generator_writes():
    assert generate_series.TARGET.read_text(encoding="utf-8") == generate_series.render(), (
        "run: python -m softclose.kernel.generate_series"
    )
    assert generate_series.LOSSY.read_text(encoding="utf-8") == generate_series.render_lossy()
    assert generate_series.DRIVE.read_text(encoding="utf-8") == generate_series.render_drive()
    assert generate_series.MODES.read_text(encoding="utf-8") == generate_series.render_modes()
    assert generate_series.SHAPED.read_text(encoding="utf-8") == generate_series.render_shaped()
    assert generate_series.TABLE.read_text(encoding="utf-8") == generate_series.render_table()


def test_the_cached_code_is_keyed_by_the_source_of_all_kernel_files():
    # numba keys its cache by what a function closes over, not by the files of the functions that it calls.
    for film in (False, True):
        block = taylor.block(form=3, lossy=True, film=film, shaped=False, table=False)
        function = getattr(block, "py_func", block)
        closed_over = dict(zip(function.__code__.co_freevars, function.__closure__, strict=True))
        values = {name: cell.cell_contents for name, cell in closed_over.items()}
        known = {"form": 3, "lossy": True, "film": film, "shaped": False, "table": False}
        assert values == {"source": source.fingerprint()} | known


def test_the_series_of_the_motion_match_finite_differences():
    # An outside check of the recurrences: x'' of the polynomial is Eq. 1's right-hand side along it.
    from softclose.kernel.series import constant, drive, evaluate, flight_driven

    x0, v0, gap, c, k, omega = 0.7, 0.1, 3.7, 2.2e-5, 0.019, 0.5
    u = drive(constant(50.0), 40.0 * np.cos(0.3), 40.0 * np.sin(0.3), omega)
    series = flight_driven(x0, v0, u, gap, c, k)
    d = 1e-4
    for h in (0.1, 0.4, 0.8):
        x, _ = evaluate(series, h)
        acceleration = (evaluate(series, h + d)[1] - evaluate(series, h - d)[1]) / (2 * d)
        volts = 50.0 + 40.0 * np.cos(omega * h + 0.3)
        np.testing.assert_allclose(acceleration, c * (volts / (gap - x)) ** 2 - k * x, rtol=1e-8)


@pytest.mark.parametrize(("order", "terms"), [(14, 10), (9, 5), (16, 12)])
def test_the_generator_s_constants_set_the_degree_and_the_number_of_terms(order: int, terms: int) -> None:
    # Without the compiler: the text alone. What an order leaves out must shrink as its first dropped term.
    text = generate_series.render(order, terms)
    made: dict[str, Any] = {}
    exec(re.sub(r"@njit\(.*\)", "", text), made)
    assert (made["ORDER"], made["TERMS"]) == (order, terms)

    x0, v0, gap, c, k, omega = 0.7, 0.1, 3.7, 2.2e-5, 0.019, 0.5
    u = made["drive"](made["constant"](50.0), 40.0 * np.cos(0.3), 40.0 * np.sin(0.3), omega)
    series = made["flight_driven"](x0, v0, u, gap, c, k)
    assert (len(series), len(u)) == (order + 1, order - 1)
    d = 1e-4
    for h in (0.1, 0.4):
        x, v = made["evaluate"](series, h)
        acceleration = (made["evaluate"](series, h + d)[1] - made["evaluate"](series, h - d)[1]) / (2 * d)
        volts = 50.0 + 40.0 * np.cos(omega * h + 0.3)
        np.testing.assert_allclose(acceleration, c * (volts / (gap - x)) ** 2 - k * x, rtol=1e-8)
        drop, speed = made["descent"](series, h)
        np.testing.assert_allclose([(x0 - x) / h, v], [drop, speed], rtol=1e-12)
        rows = np.empty((2, 1, 1))
        made["sample"](series, 3.0, np.array([3.0 + h]), 0, 1, 0, rows[0], rows[1])
        np.testing.assert_allclose(rows[:, 0, 0], [x, v], rtol=1e-12)
        # In single precision, in whole blocks where the row has room, else one by one.
        instants = 3.0 + h * np.linspace(0.0, 1.0, 2 * made["LANES"] + 3)
        exact = np.array([made["evaluate"](series, t - 3.0) for t in instants]).T
        for first, stop in ((0, 5), (0, made["LANES"] + 1), (made["LANES"], len(instants))):
            x32, v32 = np.full((2, 1, len(instants)), np.nan, dtype=np.float32)
            made["sample_single"](series, 3.0, instants, first, stop, 0, x32, v32)
            np.testing.assert_allclose(x32[0, first:stop], exact[0, first:stop], rtol=5e-7)
            np.testing.assert_allclose(v32[0, first:stop], exact[1, first:stop], rtol=2e-6)
            assert np.isnan(x32[0, :first]).all()
    still = made["flight_constant"](x0, v0, 50.0, gap, c, k)
    np.testing.assert_allclose(still, made["flight_driven"](x0, v0, made["constant"](50.0), gap, c, k), rtol=1e-12)

    bounce = made["flight_time"](2.4, gap, c * 90.0**2, k)
    assert len(bounce) == terms
    w = 0.02
    back = made["flight_constant"](2.4, -w, 90.0, gap, c, k)
    t = made["bounce_duration"](bounce, w)
    np.testing.assert_allclose(made["evaluate"](back, t)[0], 2.4, atol=1e-9)


def test_plain_python_gives_the_same_answers_as_compiled_code():
    answers = []
    for disable in ("0", "1"):
        env = {**os.environ, "NUMBA_DISABLE_JIT": disable}
        env["PYTHONPATH"] = os.pathsep.join([str(ROOT / "pipeline"), env.get("PYTHONPATH", "")])
        run = subprocess.run(
            [sys.executable, "-W", "error", "-c", PROGRAM], env=env, capture_output=True, text=True, check=True
        )
        answers.append(run.stdout)
    assert answers[0] == answers[1]
    assert answers[0].count("\n") == 14


BITS = """
import hashlib, math
import numpy as np
import pytest
from softclose import Pulse, Waveform, load_population, simulate
switches = load_population("current").sample(200, seed=5)
digest = hashlib.sha256()
rng = np.random.default_rng(0)
for _ in range(10):
    first = Pulse(0, rng.uniform(4, 20), rng.uniform(0, 30), rng.uniform(20, 100))
    second = Pulse(rng.uniform(40, 90), rng.uniform(4, 60), math.inf, rng.uniform(20, 100))
    r = simulate(switches, Waveform([first, second]), max_volts=300)
    for values in (r.max_contact_speed, r.settling_us, r.final_x, r.final_v):
        digest.update(values.tobytes())
print(digest.hexdigest())
"""


@pytest.mark.long
@pytest.mark.slow
def test_the_process_that_compiles_computes_the_same_bits_as_those_that_load_the_cache(tmp_path: Path):
    # On a fresh install each worker compiles or loads, as it happens: the store may not depend on which.
    env = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path), "PYTHONPATH": str(ROOT / "pipeline")}
    runs = [
        subprocess.run([sys.executable, "-c", BITS], env=env, capture_output=True, text=True, timeout=200, check=True)
        for _ in range(2)
    ]
    assert any(tmp_path.rglob("*.nbc"))
    assert runs[0].stdout == runs[1].stdout
