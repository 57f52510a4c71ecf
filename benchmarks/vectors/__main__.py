"""``python -m benchmarks.vectors``: make the files under reference/vectors, or check them."""

import sys

from benchmarks.vectors.generate import main

sys.exit(main())
