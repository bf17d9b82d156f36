"""Rare failures of one waveform by every method: probability, interval, switches simulated, time. Prints a table.

python benchmarks/tails.py --limits 19.7 22 --switches 10000000
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

from softclose import Waveform
from softclose.settings import load_config
from softclose.uncertainty.tails import METHODS, tail
from softclose_workflows.run.crew import open_crew
from softclose_workflows.run.executors import Placement

RESULTS = Path(__file__).parents[1] / "docs" / "results" / "table.json"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--limits", type=float, nargs="*", default=[19.7, 21.5, 23.0])
    parser.add_argument("--switches", type=int, default=10_000_000, help="of brute force")
    parser.add_argument("--threads", type=int, default=2)
    options = parser.parse_args()
    cases = json.loads(RESULTS.read_text("utf-8"))["cases"]
    rows = next(c["waveform"] for c in cases if c["title"] == "current design, 3 pulses" and c["how"] == "softclose")
    config, waveform = load_config("current"), Waveform.from_rows(rows)
    print("| failure | method | probability | 95 % interval | switches | s |\n| --- | --- | ---: | --- | ---: | ---: |")
    for event, limit in [*(("fast", x) for x in options.limits), ("open", 1.0)]:
        words = f"V > {limit:g} cm/s" if event == "fast" else "stays open"
        for method in METHODS:
            begin = time.perf_counter()
            asked: Any = {"limit_cm_s": limit, "methods": [method], "n_switches": options.switches}
            with open_crew(Placement(), threads=options.threads) as crew:
                (t,) = tail(config, waveform, event, **asked, mapper=crew)
            spent = time.perf_counter() - begin
            known = t.interval[0] == t.interval[0]
            interval = f"{t.interval[0]:.3g} – {t.interval[1]:.3g}" if known else t.note
            print(
                f"| {words} | {method} | {t.probability:.3g} | {interval} | {t.n_switches:,} | {spent:.1f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
