"""``python -m bench`` is ``detailbench``."""

import sys

from .cli import main

sys.exit(main())
