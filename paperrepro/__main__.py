"""``python -m paperrepro``."""

import sys

from paperrepro.cli import main

sys.exit(main())
