"""Rank the candidates of a store under another objective, from what is stored: nothing is simulated.

    python scripts/rescore.py runs/current.zarr --level 0.99 --c1 50

`softclose rescore` does this with intervals; here is the arithmetic, to be changed as you like.
"""

import argparse
import math

import numpy as np
import pandas as pd

from softclose_store import open_campaign

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("store")
parser.add_argument("--level", type=float, default=0.9, help="quantile of V that is v_u")
parser.add_argument("--c1", type=float, default=25.0, help="cm/s per unit probability of not closing")
parser.add_argument("-n", type=int, default=5, help="rows to print")
options = parser.parse_args()

try:
    campaign = open_campaign(options.store)
except ValueError as e:  # no store there, or a damaged one
    parser.error(str(e))
objective = campaign.config["objective"]
rows = []
for i in range(campaign.committed):
    responses = campaign.responses(i)
    v = np.sort(100 * responses.max_contact_speed[~np.isnan(responses.max_contact_speed)])
    enough = v.size >= objective["min_contact"] * responses.closed.size
    v_u = v[math.ceil(options.level * v.size - 1e-9) - 1] if enough else objective["undefined_v_u_cm_s"]
    p_nc = 1.0 - responses.closed.mean()
    rows.append({"candidate": i, "g_cm_s": v_u + options.c1 * p_nc, "v_u_cm_s": v_u, "p_nc": p_nc})

table = pd.DataFrame(rows).set_index("candidate")
table["rank_before"] = campaign.history()["g_cm_s"].rank().astype("Int64")
print(table.sort_values("g_cm_s").head(options.n).round(4).to_string())
