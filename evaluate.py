"""`python evaluate.py` is `python -m evaluate`; on import the package of the same name wins over this file."""

from evaluate.__main__ import main

raise SystemExit(main())
