"""Command `python evaluate.py`, which is equal to `python -m evaluate`.

The statement `import evaluate` imports the package `evaluate` instead of this file.
"""

import runpy

runpy.run_module("evaluate", run_name="__main__", alter_sys=True)
