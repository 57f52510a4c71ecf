"""``python -m sepv``, without the current folder first on the path,
where its ``queue.py`` would be run.
"""

import os
import sys

if not sys.flags.safe_path and sys.path and sys.path[0] in ("", os.getcwd()):
    del sys.path[0]

from sepv.commands import main

main()
