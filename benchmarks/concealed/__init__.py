"""The proof on concealed effects: cases with a key that only the scorer opens. See README.md."""

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # before numpy is imported: many processes, one thread each
