"""A metric that the campaign never computed, from the stored impacts: the energy that each contact takes up.

    python scripts/bounce_energy.py runs/current.zarr

An impact at speed v with restitution η leaves ½ M v² (1 − η²) in the contact. The wear of a contact may follow the sum
over the bounces rather than the hardest of them: do the two agree on the best candidate?
"""

import argparse

import numpy as np
import pandas as pd

from softclose_store import open_campaign

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("store")
parser.add_argument("-n", type=int, default=5, help="rows to print")
parser.add_argument("--most-open", type=float, default=0.1, help="largest share left open that is ranked")
options = parser.parse_args()

try:
    campaign = open_campaign(options.store)
except ValueError as e:  # no store there, or a damaged one
    parser.error(str(e))
restitution = campaign.config["model"]["restitution"]
mass = campaign.population()["M"]  # µg; with v in µm/µs = m/s, M v² is in nJ
rows = []
for i in range(campaign.committed):
    responses = campaign.responses(i)
    speed = responses.impact_speed[...]  # (n_switches, max_impacts), NaN beyond the last
    energy = np.nansum(0.5 * mass[: len(speed), None] * speed**2 * (1 - restitution**2), axis=1)
    closed = responses.closed
    rows.append(
        {
            "candidate": i,
            "energy_90_nJ": np.quantile(energy[closed], 0.9) if closed.any() else np.nan,
            "impacts_mean": responses.n_impacts.mean(),
            "p_nc": np.mean(~closed),
        }
    )

table = pd.DataFrame(rows).set_index("candidate").join(campaign.history()[["g_cm_s", "v_u_cm_s"]])
table["rank_by_g"] = table["g_cm_s"].rank().astype("Int64")
print("90 % quantile of the energy left in the contact, over the switches that close")
table = table[table["p_nc"] <= options.most_open]  # what leaves the lot open spares its contacts, and is no result
if table.empty:
    parser.error(f"every candidate leaves more than {options.most_open:g} open: raise --most-open")
print(table.sort_values("energy_90_nJ").head(options.n).round(4).to_string())
