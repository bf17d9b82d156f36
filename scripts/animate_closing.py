"""Animate the ensemble closing under the best waveform: the drive, the travel of every switch, a histogram, as a GIF.

python scripts/animate_closing.py runs/current.zarr -o closing.gif
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter

from softclose_store import open_campaign

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("store")
parser.add_argument("-o", "--output", default="closing.gif")
parser.add_argument("--frames", type=int, default=100)
parser.add_argument("--until", type=float, default=120.0, help="last instant drawn [µs]")
options = parser.parse_args()

try:
    campaign = open_campaign(options.store)
except ValueError as e:  # no store there, or a damaged one
    parser.error(str(e))
if campaign.best() is None:
    parser.error(f"{options.store} has no usable candidate yet")
best = campaign.best()
paths = campaign.trajectories(best.candidate)
distance = campaign.population()["D"][: len(paths.x), None] - paths.x[...]  # µm left to the contact
shown = np.unique(np.linspace(0, np.searchsorted(paths.times_us, options.until), options.frames).astype(int))
shown = shown[shown < paths.times_us.size]


def voltage(rows, t):
    """Eqs. 12-13: raised-cosine rises, flat tops, mirrored falls."""
    u = np.zeros_like(t)
    for start, rise, peak, volts in rows:
        up = np.clip((t - start) / max(rise, 1e-9), 0, 1)
        down = np.clip((t - start - rise - peak) / max(rise, 1e-9), 0, 1)
        u += volts * (np.cos(np.pi * down) - np.cos(np.pi * up)) / 2
    return u


figure = plt.figure(figsize=(8, 5.5), layout="constrained")
grid = figure.add_gridspec(2, 2, width_ratios=(3, 1), height_ratios=(1, 2.4))
drive, left = figure.add_subplot(grid[0, :]), figure.add_subplot(grid[1, 0])
right = figure.add_subplot(grid[1, 1], sharey=left)
fine = np.linspace(0.0, min(options.until, paths.times_us[-1]), 4001)
drive.plot(fine, voltage(best.waveform, fine), color="black")
(now,) = drive.plot([0.0], [0.0], "o", color="tab:red")
drive.set_xlabel("time [µs]")
drive.set_ylabel("drive [V]")
order = np.argsort(campaign.population()["G"][: len(distance)])
dots = left.scatter(np.arange(len(order)), distance[order, 0], s=4, color="tab:blue")
left.axhline(0.0, color="tab:red", linewidth=0.8)
left.set_xlabel("switch, from the narrowest gap to the widest")
left.set_ylabel("distance to the contact [µm]")
left.set_ylim(-0.1, float(distance.max()) + 0.1)
right.set_xlabel("switches")
bins = np.linspace(-0.1, float(distance.max()) + 0.1, 40)


def draw(k: int) -> None:
    """One frame."""
    dots.set_offsets(np.column_stack([np.arange(len(order)), distance[order, k]]))
    right.clear()
    right.hist(distance[:, k], bins=bins, orientation="horizontal", color="tab:blue")
    right.set_xlim(0, len(order))
    now.set_data([paths.times_us[k]], voltage(best.waveform, paths.times_us[k : k + 1]))
    drive.set_title(f"candidate {best.candidate} at {paths.times_us[k]:.0f} µs")


FuncAnimation(figure, draw, frames=list(shown)).save(options.output, writer=PillowWriter(fps=15), dpi=80)
print(options.output)
