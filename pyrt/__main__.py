"""`python -m pyrt`."""

import sys

from pyrt.cli import start

if __name__ == "__main__":
    sys.exit(start())
