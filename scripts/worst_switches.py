"""List the switches that hit hardest under the best waveform, and how unusual each is.

python scripts/worst_switches.py runs/current.zarr -n 10
"""

import argparse

import pandas as pd

from softclose_store import open_campaign

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("store")
parser.add_argument("-n", type=int, default=10)
parser.add_argument("--candidate", type=int, help="[the best]")
options = parser.parse_args()

try:
    campaign = open_campaign(options.store)
except ValueError as e:  # no store there, or a damaged one
    parser.error(str(e))
if campaign.best() is None:
    parser.error(f"{options.store} has no usable candidate yet")
candidate = campaign.best().candidate if options.candidate is None else options.candidate
responses = campaign.responses(candidate)
n = len(responses.closed)

table = pd.DataFrame({name: values[:n] for name, values in campaign.population().items()})
spread = table.std()
varying = spread.index[spread > 0]  # where no drive is scaled, its scales are 1 for all
scores = (table[varying] - table[varying].mean()) / spread[varying]  # in standard deviations of the ensemble
table["V_cm_s"] = 100 * responses.max_contact_speed
table["first_contact_us"] = responses.first_contact_us
table["n_impacts"] = responses.n_impacts
table["closed"] = responses.closed
worst = table.sort_values("V_cm_s", ascending=False).head(options.n)

print(f"candidate {candidate}: the {options.n} hardest impacts of {n} switches")
print(worst.round(3).to_string())
print("\nthe same switches, in standard deviations from the ensemble's mean")
print(scores.loc[worst.index].round(1).to_string())
