"""Velocity over travel of the ensemble under one waveform: who coasts in softly, who is pulled in hard.

python scripts/phase_portrait.py runs/current.zarr -o phase.png
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np

from softclose_store import open_campaign

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("store")
parser.add_argument("-o", "--output", default="phase.png")
parser.add_argument("--candidate", type=int, help="[the best]")
parser.add_argument("--switches", type=int, default=100, help="how many to draw")
options = parser.parse_args()

try:
    campaign = open_campaign(options.store)
except ValueError as e:  # no store there, or a damaged one
    parser.error(str(e))
if campaign.best() is None:
    parser.error(f"{options.store} has no usable candidate yet")
candidate = campaign.best().candidate if options.candidate is None else options.candidate
paths = campaign.trajectories(candidate)
n = min(options.switches, len(paths.x))
responses = campaign.responses(candidate)
speed = 100 * responses.max_contact_speed[:n]
bounce = campaign.config["model"]["restitution"]


def smooth(i, steps=8):
    """Travel [µm] and velocity [µm/µs] of switch i, finely: cubic between two samples, and a jump at each impact."""
    hit = np.isfinite(responses.impact_time_us[i])
    at, v_in = responses.impact_time_us[i][hit], responses.impact_speed[i][hit]
    order = np.argsort(np.concatenate([paths.times_us, at]), kind="stable")
    t = np.concatenate([paths.times_us, at])[order]
    x = np.concatenate([paths.x[i], np.full(at.size, campaign.population()["D"][i])])[order]
    before = np.concatenate([paths.v[i], v_in])[order]  # velocity on arriving at each instant
    after = np.concatenate([paths.v[i], -bounce * v_in])[order]  # and on leaving it
    h, s = np.diff(t)[:, None], np.linspace(0.0, 1.0, steps)
    x0, x1, v0, v1 = x[:-1, None], x[1:, None], h * after[:-1, None], h * before[1:, None]
    c, d = 3 * (x1 - x0) - 2 * v0 - v1, 2 * (x0 - x1) + v0 + v1
    v = (v0 + 2 * c * s + 3 * d * s**2) / np.where(h > 0, h, np.inf)
    return (x0 + v0 * s + c * s**2 + d * s**3).ravel(), v.ravel()


figure, axis = plt.subplots(figsize=(7, 6), layout="constrained")
colours = plt.get_cmap("viridis")
scale = plt.Normalize(0.0, max(float(speed[speed == speed].max(initial=1.0)), 1.0))
for i in range(n):
    colour = colours(scale(speed[i])) if speed[i] == speed[i] else "tab:red"  # red: never touched
    x, v = smooth(i)
    axis.plot(x / campaign.population()["D"][i], 100 * v, color=colour, linewidth=0.6, alpha=0.7)
axis.axvline(1.0, color="black", linewidth=0.8)
axis.set_xlabel("x / D (1: in contact)")
axis.set_ylabel("velocity [cm/s]")
axis.set_title(f"candidate {candidate}, {n} switches")
figure.colorbar(plt.cm.ScalarMappable(scale, colours), ax=axis, label="largest contact speed V [cm/s]")
figure.savefig(options.output, dpi=150)
print(options.output)
