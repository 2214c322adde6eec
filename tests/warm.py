"""Compiles what most tests need, with an empty cache more than a minute of two cores; with `more`,
the other half of it, which make runs beside it. A cache that has it all already is left alone.
"""

import hashlib
import sys
from pathlib import Path

from cohelm.core import jit

if __name__ == "__main__":
    half = "more" if "more" in sys.argv else "first"
    what = hashlib.sha256(Path(__file__).with_name("warming.py").read_bytes()).hexdigest()[:16]
    cache = jit._cache_folder("")  # of exactly this tree; empty: nothing can be kept
    done = Path(cache, f"{half}-{what}")
    if not (cache and done.exists()):
        from tests import warming

        getattr(warming, half)()
        if cache:
            done.touch()
