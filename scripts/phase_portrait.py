"""Velocity over travel of the ensemble under one waveform: who coasts in softly, who is pulled in hard.

python scripts/phase_portrait.py runs/current.zarr -o phase.png
"""

import argparse

import matplotlib.pyplot as plt

from softclose_store import open_campaign

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("store")
parser.add_argument("-o", "--output", default="phase.png")
parser.add_argument("--candidate", type=int, help="[the best]")
parser.add_argument("--switches", type=int, default=100, help="how many to draw")
options = parser.parse_args()

campaign = open_campaign(options.store)
candidate = campaign.best().candidate if options.candidate is None else options.candidate
paths = campaign.trajectories(candidate)
n = min(options.switches, len(paths.x))
x, v = paths.x[:n], 100 * paths.v[:n]
speed = 100 * campaign.responses(candidate).max_contact_speed[:n]

figure, axis = plt.subplots(figsize=(7, 6), layout="constrained")
colours = plt.get_cmap("viridis")
scale = plt.Normalize(0.0, max(float(speed[speed == speed].max(initial=1.0)), 1.0))
for i in range(n):
    colour = colours(scale(speed[i])) if speed[i] == speed[i] else "tab:red"  # red: never touched
    axis.plot(x[i] / campaign.population()["D"][i], v[i], color=colour, linewidth=0.6, alpha=0.7)
axis.axvline(1.0, color="black", linewidth=0.8)
axis.set_xlabel("x / D (1: in contact)")
axis.set_ylabel("velocity [cm/s]")
axis.set_title(f"candidate {candidate}, {n} switches")
figure.colorbar(plt.cm.ScalarMappable(scale, colours), ax=axis, label="largest contact speed V [cm/s]")
figure.savefig(options.output, dpi=150)
print(options.output)
