"""``python -m activeloc.cli``."""

import sys

from activeloc.cli import main

if __name__ == "__main__":
    sys.exit(main())
