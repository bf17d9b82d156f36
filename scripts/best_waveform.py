"""Draw the best waveform of a store and what the ensemble does under it.

python scripts/best_waveform.py runs/current.zarr -o best.png
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np

from softclose_store import open_campaign

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("store")
parser.add_argument("-o", "--output", default="best.png")
parser.add_argument("--switches", type=int, default=200, help="how many to draw")
options = parser.parse_args()


def voltage(rows, t):
    """Eqs. 12-13: raised-cosine rises, flat tops, mirrored falls."""
    u = np.zeros_like(t)
    for start, rise, peak, volts in rows:
        up = np.clip((t - start) / max(rise, 1e-9), 0, 1)
        down = np.clip((t - start - rise - peak) / max(rise, 1e-9), 0, 1)
        u += volts * (np.cos(np.pi * down) - np.cos(np.pi * up)) / 2
    return u


try:
    campaign = open_campaign(options.store)
except ValueError as e:  # no store there, or a damaged one
    parser.error(str(e))
if campaign.best() is None:
    parser.error(f"{options.store} has no usable candidate yet")
best = campaign.best()
paths = campaign.trajectories(best.candidate)
t, x = paths.times_us, paths.x[: options.switches]
fine = np.linspace(0.0, t[-1], 20_001)  # the drive has peaks and dips between two samples of the motion
distance = x - campaign.population()["D"][: len(x), None]  # 0: in contact

figure, axes = plt.subplots(3, 1, figsize=(8, 8), sharex=True, layout="constrained")
axes[0].plot(fine, voltage(best.waveform, fine), color="black")
axes[0].set_ylabel("drive [V]")
axes[1].plot(t, distance.T, color="tab:blue", alpha=0.15, linewidth=0.6)
axes[1].axhline(0.0, color="tab:red", linewidth=0.8)
axes[1].set_ylabel("x − D [µm]")
axes[2].plot(t, 100 * paths.v[: options.switches].T, color="tab:blue", alpha=0.15, linewidth=0.6)
axes[2].set_ylabel("velocity [cm/s]")
axes[2].set_xlabel("time [µs]")
axes[0].set_title(
    f"candidate {best.candidate}: v_u {best.v_u_cm_s:.1f} cm/s, {100 * best.p_nc:.1f} % of the switches left open"
)
figure.savefig(options.output, dpi=150)
print(options.output)
