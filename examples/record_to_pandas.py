"""A record, of a run or of a drive, into pandas: when did the filter act, and how near was it?

pip install pandas

cohelm robot lab-guard --fast --for 30 --record drive.mcap
python examples/record_to_pandas.py drive.mcap
"""

import math
import sys

import pandas as pd

import cohelm


def main(path: str) -> pd.DataFrame:
    """The table, with a column that names the verdict."""
    record = cohelm.read_record(path)
    table = pd.DataFrame(record.table).set_index("t")
    # -1: nothing was decided, the robot stood; or a law by others did, and nobody knows how
    table["verdict"] = table["verdict"].map(
        lambda number: cohelm.Verdict(number).name if number >= 0 else "NONE"
    )
    # a run knows the clearance itself, and a drive what its sensors see; inf: nothing near
    gap = table["clearance" if record.kind == "run" else "clearance_seen"]
    near = gap.where(gap < math.inf)
    print(near.groupby(table["verdict"]).describe()[["count", "min", "mean"]])
    for when, what in record.events[:10]:
        print(f"{when:8.2f} s  {what}")
    return table


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(sys.argv[1])
