"""Same as `python -m train`."""

from train.__main__ import main

raise SystemExit(main())
