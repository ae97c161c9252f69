"""Whether robots can be watched in a browser."""

import re
import socket

from live.view.server import PAGE
from quad_env.doctor.check import Finding, ok, problem
from quad_env.doctor.subject import Subject

LOOPBACK = "127.0.0.1"


def viewer(_: Subject) -> Finding:
    """Whether the page of `python -m quad_env view` is whole, and a port can be opened to show it at."""
    if missing := sorted(name for name in _named("index.html") if not (PAGE / name).is_file()):
        seen = f"the page of the viewer lacks {', '.join(missing)}"
        return problem(seen, "the clone is not complete", f"git checkout -- {PAGE}")
    try:
        with socket.create_server((LOOPBACK, 0)):
            return ok(f"the page of the viewer is there, and ports can be opened on {LOOPBACK}")
    except OSError as error:
        seen = f"no port can be opened on {LOOPBACK} ({error.strerror})"
        return problem(seen, "a sandbox or a container without a loopback interface", "allow it: ip link set lo up")


def _named(name: str) -> set[str]:
    """A file of the page, and those that it, and they, name."""
    is_text = name.endswith((".html", ".js")) and (PAGE / name).is_file()
    text = (PAGE / name).read_text(encoding="utf-8") if is_text else ""
    others = re.findall(r'(?:src=|href=|from )"(?:\./)?([\w.]+)"', text)
    return {name}.union(*map(_named, others))
