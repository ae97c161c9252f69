"""Controllers of the SimpleQuad: batched, from observations to joint targets, in NumPy alone.

policy = policies.make("trot")
policy.reset(num_envs=n)
action = policy.act(observation)  # (n, k) -> (n, 12) rad
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path

from policies.article.printed import Document
from policies.article.repaired import DocumentRepaired
from policies.base import GaitedPolicy, Policy, PolicyError
from policies.behaviour import Behaviour
from policies.bundle import load
from policies.gaits.policy import Gaits
from policies.residual import ResidualPolicy
from policies.safety import Safe, SafetyLimits
from policies.stand import Stand
from policies.trot.feedback import TrotFeedback
from policies.trot.open_loop import Trot, TrotParameters
from quad_env.actuation.models import Actuator

MODELS = Path(__file__).resolve().parents[1] / "models"
"""The trained policies that ship with the project."""


def _shipped_residual() -> Policy:
    if not MODELS.joinpath("residual").is_dir():
        raise PolicyError(f"no trained residual in {MODELS / 'residual'}; make one with `python -m train`")
    return load(MODELS / "residual")


_MAKERS: dict[str, Callable[[], Policy]] = {
    "behaviour": Behaviour,
    "bound": partial(Gaits, "bound", name="bound"),
    "document": Document,
    "document_repaired": DocumentRepaired,
    "gaits": Gaits,
    "pace": partial(Gaits, "pace", name="pace"),
    "pronk": partial(Gaits, "pronk", name="pronk"),
    "residual": _shipped_residual,
    "stand": Stand,
    "trot": Trot,
    "trot_feedback": TrotFeedback,
    "walk": partial(Gaits, "walk", name="walk"),
}


SAFE = "safe:"
"""Before the name of any policy: that policy within the safety layer."""


def names() -> tuple[str, ...]:
    """The names that `make` knows, sorted."""
    return tuple(sorted(_MAKERS))


def make(name: str, *, actuator: str | Actuator = "ideal") -> Policy:
    """A fresh policy by name, for `safe:NAME` within the safety layer, whose limits are those of the actuator.

    Raises PolicyError for a name that does not exist or a model that is not there.
    """
    if name.startswith(SAFE):
        return Safe(make(name.removeprefix(SAFE)), SafetyLimits.of(actuator))
    if name not in _MAKERS:
        raise PolicyError(f"unknown policy {name!r}; there are {', '.join(names())}")
    return _MAKERS[name]()


def resolve(name_or_path: str | Path, *, actuator: str | Actuator = "ideal") -> Policy:
    """A fresh policy by name, see `make`, else from the bundle in the folder of that path. Raises PolicyError."""
    if isinstance(name_or_path, str) and name_or_path.removeprefix(SAFE) in _MAKERS:
        return make(name_or_path, actuator=actuator)
    if Path(name_or_path).is_dir():
        return load(name_or_path)
    raise PolicyError(
        f"no policy {str(name_or_path)!r}: name one of {', '.join(names())}, or the folder of a trained policy"
    )


__all__ = [
    "Behaviour",
    "Document",
    "DocumentRepaired",
    "GaitedPolicy",
    "Gaits",
    "Policy",
    "PolicyError",
    "ResidualPolicy",
    "Safe",
    "Stand",
    "Trot",
    "TrotFeedback",
    "TrotParameters",
    "load",
    "make",
    "names",
    "resolve",
]
