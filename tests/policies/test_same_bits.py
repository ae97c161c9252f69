"""Actions of networks have the same bits with any BLAS kernel and any instruction set of the processor.

Each case runs in its own process, since libraries choose their functions when they are loaded.
"""

import json
import os
import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest

PROGRAM = """
import hashlib, itertools, json
import numpy as np
import policies
from policies.network import Network

def digest(values):
    return hashlib.sha256(np.ascontiguousarray(values).tobytes()).hexdigest()

rng = np.random.default_rng(0)
found = {}
for sizes in ((302, 128, 128, 12), (62, 64, 12)):
    shapes = tuple(itertools.pairwise(sizes))
    weights = tuple(rng.normal(0.0, shape[0] ** -0.5, shape).astype(np.float32) for shape in shapes)
    network = Network(weights, tuple(rng.normal(size=size).astype(np.float32) for size in sizes[1:]))
    for rows in (1, 16, 129, 300):
        inputs = rng.normal(0.0, 2.0, (rows, sizes[0])).astype(np.float32)
        found[f"{sizes} {rows}"] = digest(network(inputs))
        found[f"{sizes} {rows} of any size"] = digest(network(inputs * np.float32(1e4)))
for name in ("residual", "robust"):
    network = policies.load(f"models/{name}").network
    found[name] = digest(network(rng.normal(size=(64, network.sizes[0])).astype(np.float32)))
found["plain"] = digest(np.matmul(inputs[:, None, :], weights[0]))
print(json.dumps(found))
"""
FEATURES = np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])
CASES = [{"OPENBLAS_CORETYPE": kernel} for kernel in ("Haswell", "Prescott")]
CASES += [{"NPY_DISABLE_CPU_FEATURES": " ".join(FEATURES)}, {"OPENBLAS_NUM_THREADS": "2"}]


@cache
def found(case: tuple[tuple[str, str], ...] = ()) -> dict[str, str]:
    """Return the digests of the program's actions with the given environment variables."""
    environment = dict(case)
    chosen = {name: value for name, value in os.environ.items() if name != "OPENBLAS_CORETYPE"} | environment
    folder = Path(__file__).parents[2]
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], cwd=folder, env=chosen, capture_output=True, text=True, check=True
    )
    return dict(json.loads(done.stdout))


@pytest.mark.parametrize("environment", CASES, ids=lambda case: "=".join(*case.items()))
def test_actions_have_the_same_bits(environment: dict[str, str]) -> None:
    there = found(tuple(environment.items()))
    assert {name: there[name] for name in there if name != "plain"}.items() < found().items()


@pytest.mark.skipif(
    "openblas" not in np.show_config(mode="dicts")["Build Dependencies"]["blas"]["name"] or "X86_V3" not in FEATURES,
    reason="kernels are chosen for OpenBLAS and an x86 processor with AVX2",
)
def test_the_kernels_round_a_plain_product_differently() -> None:
    haswell, prescott = (found((("OPENBLAS_CORETYPE", kernel),))["plain"] for kernel in ("Haswell", "Prescott"))
    assert haswell != prescott
