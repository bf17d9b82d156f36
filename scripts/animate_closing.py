"""Animate the ensemble closing under the best waveform: travel of every switch, histogram beside it, as a GIF.

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

campaign = open_campaign(options.store)
best = campaign.best()
paths = campaign.trajectories(best.candidate)
distance = campaign.population()["D"][: len(paths.x), None] - paths.x[...]  # µm left to the contact
shown = np.unique(np.linspace(0, np.searchsorted(paths.times_us, options.until), options.frames).astype(int))
shown = shown[shown < paths.times_us.size]

figure, (left, right) = plt.subplots(1, 2, figsize=(8, 4), sharey=True, width_ratios=(3, 1), layout="constrained")
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
    left.set_title(f"candidate {best.candidate} at {paths.times_us[k]:.0f} µs")


FuncAnimation(figure, draw, frames=list(shown)).save(options.output, writer=PillowWriter(fps=15), dpi=80)
print(options.output)
