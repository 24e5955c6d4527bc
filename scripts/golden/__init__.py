"""Reference ("golden") data of the deadtime crate.

``python -m golden`` regenerates ``golden/<case>/*.json`` in the repository's root; ``python -m golden --check``
regenerates into a temporary folder and compares. ``golden/SCHEMA.md`` describes the files.
"""

import os

# One thread: the matrices are small, and sums keep their order on every machine. Set before numpy is loaded.
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
