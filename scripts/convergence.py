"""Best g so far against the number of candidates, for several stores in one figure.

python scripts/convergence.py runs/a.zarr runs/b.zarr -o convergence.png
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np

from softclose_store import open_campaign

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("stores", nargs="+")
parser.add_argument("-o", "--output", default="convergence.png")
options = parser.parse_args()

figure, axis = plt.subplots(figsize=(8, 5), layout="constrained")
for path in options.stores:
    try:
        campaign = open_campaign(path)
    except ValueError as e:  # no store there, or a damaged one
        parser.error(str(e))
    history = campaign.history()
    # Values from ensembles of different sizes do not compare: one line for each size.
    for n_switches, part in history.groupby("n_switches"):
        label = f"{campaign.config['campaign']['name']}, seed {campaign.config['campaign']['seed']}, N = {n_switches}"
        (line,) = axis.step(part.index + 1, part["g_cm_s"].cummin(), where="post", label=label)
        axis.plot(part.index + 1, part["g_cm_s"], ".", color=line.get_color(), alpha=0.4)
        print(f"{path}: N = {n_switches}, {len(part)} candidates, best g {np.nanmin(part['g_cm_s']):.2f} cm/s")
axis.set_xlabel("candidates")
axis.set_ylabel("g [cm/s]")
axis.legend()
figure.savefig(options.output, dpi=150)
