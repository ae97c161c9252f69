"""`python train.py` is `python -m train`; on import the package of the same name wins over this file."""

import runpy

runpy.run_module("train", run_name="__main__", alter_sys=True)
