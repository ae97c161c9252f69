"""`python evaluate.py` is `python -m evaluate`; on import the package of the same name wins over this file."""

import runpy

runpy.run_module("evaluate", run_name="__main__", alter_sys=True)
