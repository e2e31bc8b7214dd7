"""Import this first: what follows uses the modules of the installed package."""

import sys
from pathlib import Path

sys.path.insert(0, next(str(path) for path in Path("/opt/probewatch/lib").glob("python3.*/site-packages")))
