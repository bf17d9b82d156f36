"""Makes the README's picture and table from the certified stores of `make run`: one cannot contradict the other.

python docs/readme.py runs

It reads runs/current.zarr and runs/current-three.zarr, which `softclose certify` has judged, and writes three things
that a test compares: the figures (docs/_static/readme.json), the table in README.md between its two marks, and the
picture (docs/_static/softclose.png), which carries the digest of the figures.
"""

from __future__ import annotations

import argparse
import hashlib
import json
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
FIGURES = ROOT / "docs" / "_static" / "readme.json"
PICTURE = ROOT / "docs" / "_static" / "softclose.png"
README = ROOT / "README.md"
BEGIN, END = "<!-- figures: made by docs/readme.py -->", "<!-- end of the figures -->"
STAMP = "Softclose-Figures"
"""Key of the picture's text that says which figures it shows."""

PUBLISHED = {"unshaped": 40.7, "deterministic": 42.6, "current": 19.7, "current-three": 18.8}
NAMES = {
    "unshaped": "100 V step",
    "deterministic": "tuned for the mean switch",
    "current": "two pulses, all six parameters",
    "current-three": "three pulses, all ten parameters",
}


def digest(figures: dict[str, Any]) -> str:
    """Of the figures: what the picture carries."""
    return hashlib.sha256(json.dumps(figures, sort_keys=True).encode()).hexdigest()


def table(figures: dict[str, Any]) -> str:
    """The README's table."""
    from softclose_workflows.tell.tables import share, with_interval

    lines = [
        f"On {figures['n_switches']:,} new simulated switches that the search never saw:",
        "",
        "| drive | published v_u (cm/s) | v_u here (cm/s), 95 % interval | left open, 95 % interval |",
        "| --- | --- | --- | --- |",
    ]
    for row in figures["rows"]:
        speed, left_open = (
            with_interval(row["v_u_cm_s"], *row["v_u_interval"]),
            share(row["p_nc"], *row["p_nc_interval"]),
        )
        lines.append(f"| {NAMES[row['name']]} | {PUBLISHED[row['name']]} | {speed} | {left_open} |")
    return "\n".join(lines)


def between_marks(text: str) -> str:
    """What a README has between the two marks."""
    return text.partition(BEGIN)[2].partition(END)[0].strip()


def renewed(text: str, made: str) -> str:
    """A README with `made` between its two marks, and nothing else changed."""
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise SystemExit(f"README.md lacks the marks {BEGIN} and {END}")
    return f"{before}{begin}\n{made}\n{end}{after}"


def gathered(folder: Path) -> dict[str, Any]:
    """The figures of both stores' certificates."""
    from softclose_workflows.analyses.certify import read_certification

    rows, n = [], set()
    for name in ("current", "current-three"):
        found = read_certification(str(folder / f"{name}.zarr"))
        if found is None:
            raise SystemExit(f"{folder / name}.zarr is not certified: run `softclose certify {folder / name}.zarr`")
        n.add(found.n_switches)
        designs = [(name, found.best)]
        if name == "current":
            designs = [*((r.name, r) for r in found.references), *designs]
        for called, design in designs:
            a = design.assessment
            rows.append(
                {
                    "name": called,
                    "v_u_cm_s": a.v_u_cm_s,
                    "v_u_interval": list(a.v_u_interval),
                    "p_nc": a.p_nc,
                    "p_nc_interval": list(a.p_nc_intervals.wilson),
                    "waveform": [[v if v < 1e300 else None for v in row] for row in design.waveform.rows().tolist()],
                }
            )
    if len(n) != 1:
        raise SystemExit(f"the two stores are certified on {sorted(n)} switches: certify both on as many")
    return {"n_switches": n.pop(), "rows": rows}


def draw(folder: Path, figures: dict[str, Any]) -> None:
    """The plain step beside the best three pulses, on the switches of the certificate."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt
    import numpy as np

    from softclose.evaluate import respond
    from softclose.settings import CampaignConfig
    from softclose_store import open_campaign
    from softclose_workflows.analyses.certify import fresh_switches, read_certification

    ink, contact = "#222222", "#888888"
    store = str(folder / "current-three.zarr")
    config = CampaignConfig.from_dict(open_campaign(store).config)
    found = read_certification(store)
    assert found is not None
    step = next(r for r in found.references if r.name == "unshaped")
    lot = fresh_switches(config, 150, seed=found.seed)
    t = np.linspace(0.0, config.model.horizon_us, 1001)
    fine = np.linspace(0.0, config.model.horizon_us, 10_001)
    plt.rcParams |= {"font.size": 10, "axes.spines.top": False, "axes.spines.right": False, "axes.edgecolor": ink}
    figure, axes = plt.subplots(3, 2, figsize=(9, 7.2), sharex="row", sharey="row", layout="constrained")
    designs = [("100 V step", step, "#b5651d"), ("designed for the whole lot", found.best, "#1f6f8b")]
    for column, (title, design, colour) in zip(axes.T, designs, strict=True):
        a, waveform = design.assessment, design.waveform
        shown = respond(config, lot, waveform, for_everybody=design is step, times_us=t)
        column[0].plot(np.insert(fine, 0, 0.0), np.insert(waveform.voltage(fine), 0, 0.0), color=ink, linewidth=1.5)
        column[0].set_title(title, color=colour, fontweight="bold", fontsize=13)
        column[1].plot(t, (lot["D"][:, None] - shown.x).T, color=colour, alpha=0.15, linewidth=0.6)
        column[1].axhline(0.0, color=contact, linewidth=1.0)
        column[1].set_xlabel("time [µs]")
        speeds = 100.0 * np.asarray(design.response.max_contact_speed)
        column[2].hist(speeds[np.isfinite(speeds)], bins=np.linspace(0.0, 60.0, 121), color=colour)
        column[2].axvline(a.v_u_cm_s, color=ink, linewidth=1.0)
        at_left = a.v_u_cm_s > 30.0  # beside the histogram, not across the line
        column[2].text(
            0.02 if at_left else 0.98,
            0.95,
            f"nine in ten contacts below {a.v_u_cm_s:.1f} cm/s\nmean {a.mean_cm_s:.1f} cm/s\n"
            f"left open at {config.model.horizon_us:g} µs: {100.0 * a.p_nc:.1f} %",
            transform=column[2].transAxes,
            ha="left" if at_left else "right",
            va="top",
        )
        column[2].set_xlabel("hardest impact of each switch [cm/s]")
        column[2].set_yticks([])
    axes[0, 0].set_ylabel("drive [V]")
    axes[1, 0].set_ylabel("distance to\nthe contact [µm]")
    axes[2, 0].set_ylabel("switches")
    figure.savefig(PICTURE, dpi=110, metadata={STAMP: digest(figures), "Software": None})


def main() -> None:
    """Figures, then the table, then the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="where current.zarr and current-three.zarr are")
    folder = parser.parse_args().folder
    figures = gathered(folder)
    FIGURES.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
    text = README.read_text("utf-8")
    README.write_text(renewed(text, table(figures)), encoding="utf-8")
    draw(folder, figures)
    print(table(figures))


if __name__ == "__main__":
    main()
