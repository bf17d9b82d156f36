"""Draws the picture of the README: the plain step and the best waveform of a store, on the same new switches.

python docs/picture.py runs/current-three.zarr -o docs/_static/softclose.png
"""

from __future__ import annotations

import argparse

import matplotlib.pyplot as plt
import numpy as np

from softclose import Waveform, assess, simulate
from softclose.baselines import unshaped
from softclose.settings import CampaignConfig
from softclose_store import open_campaign

INK, STEP, SOFT, CONTACT = "#222222", "#b5651d", "#1f6f8b", "#888888"
FRESH_STREAM = 1
"""Random stream of new switches, as `softclose certify` uses it: no seed makes them the training ensemble again."""

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("store")
parser.add_argument("-o", "--output", default="docs/_static/softclose.png")
parser.add_argument("--switches", type=int, default=20_000)
options = parser.parse_args()

campaign = open_campaign(options.store)
config = CampaignConfig.from_dict(campaign.config)
best = campaign.best()
assert best is not None
population = config.build_population()
switches = population.sample(options.switches, seed=config.campaign.seed, stream=FRESH_STREAM)
t = np.linspace(0.0, 250.0, 1001)

plt.rcParams |= {"font.size": 10, "axes.spines.top": False, "axes.spines.right": False, "axes.edgecolor": INK}
figure, axes = plt.subplots(3, 2, figsize=(9, 7.2), sharex="row", sharey="row", layout="constrained")
designs = [("100 V step", unshaped(), STEP), ("designed for the whole lot", Waveform.from_rows(best.waveform), SOFT)]
for column, (title, waveform, colour) in zip(axes.T, designs, strict=True):
    response = simulate(switches, waveform, max_volts=200.0)
    result = assess(response)
    shown = simulate(switches[:150], waveform, max_volts=200.0, times_us=t)
    assert shown.x is not None

    fine = np.linspace(0.0, 250.0, 10_001)
    column[0].plot(np.insert(fine, 0, 0.0), np.insert(waveform.voltage(fine), 0, 0.0), color=INK, linewidth=1.5)
    column[0].set_title(title, color=colour, fontweight="bold", fontsize=13)

    column[1].plot(t, (switches[:150, 0, None] - shown.x).T, color=colour, alpha=0.15, linewidth=0.6)
    column[1].axhline(0.0, color=CONTACT, linewidth=1.0)
    column[1].set_xlabel("time [µs]")

    v = 100.0 * response.max_contact_speed[~np.isnan(response.max_contact_speed)]
    column[2].hist(v, bins=np.linspace(0.0, 60.0, 121), color=colour)
    column[2].axvline(result.v_u_cm_s, color=INK, linewidth=1.0)
    at_left = result.v_u_cm_s > 30.0  # beside the histogram, not across the line
    column[2].text(
        0.02 if at_left else 0.98,
        0.95,
        f"nine in ten contacts below {result.v_u_cm_s:.1f} cm/s\nmean {result.mean_cm_s:.1f} cm/s\n"
        f"not closed at 250 µs: {result.p_nc:.1%}",
        transform=column[2].transAxes,
        ha="left" if at_left else "right",
        va="top",
    )
    column[2].set_xlabel("hardest impact of each switch [cm/s]")
    column[2].set_yticks([])
    print(
        f"{title}: v_u {result.v_u_cm_s:.2f}, mean {result.mean_cm_s:.2f}, p_nc {result.p_nc:.4f} on {options.switches}"
    )
axes[0, 0].set_ylabel("drive [V]")
axes[1, 0].set_ylabel("distance to\nthe contact [µm]")
axes[2, 0].set_ylabel("switches")
figure.savefig(options.output, dpi=110)
