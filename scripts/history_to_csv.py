"""Write the history of one or more stores as one CSV table, one row per candidate.

python scripts/history_to_csv.py runs/a.zarr runs/b.zarr > history.csv
"""

import argparse
import sys

import pandas as pd

from softclose_store import open_campaign

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("stores", nargs="+")
options = parser.parse_args()

try:
    tables = [open_campaign(path).history().assign(store=path).reset_index() for path in options.stores]
except ValueError as e:  # no store there, or a damaged one
    parser.error(str(e))
pd.concat(tables).set_index(["store", "candidate"]).to_csv(sys.stdout, lineterminator="\n")
