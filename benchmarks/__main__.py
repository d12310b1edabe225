"""``python -m benchmarks``: the same as ``activeloc bench``, options and all."""

from __future__ import annotations

import sys

from activeloc.cli import main

if __name__ == "__main__":
    sys.exit(main(["bench", *sys.argv[1:]]))
