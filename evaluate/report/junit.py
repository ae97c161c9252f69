"""`junit.xml`: a test case for each gate on each scenario, as CI systems read them."""

from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

from evaluate.analysis.gate_verdicts import Verdict, by_gate
from quad_env.files.writing import write_atomically


def write(verdicts: Sequence[Verdict], path: Path) -> None:
    """Write junit.xml."""
    write_atomically(path, render(verdicts))


def render(verdicts: Sequence[Verdict]) -> bytes:
    """The file: a suite a gate, a case a scenario."""
    root = ElementTree.Element("testsuites", _counts("simple-quad", verdicts))
    for gate, mine in by_gate(verdicts).items():
        suite = ElementTree.SubElement(root, "testsuite", _counts(gate, mine))
        for verdict in mine:
            case = ElementTree.SubElement(suite, "testcase", {"classname": gate, "name": verdict.scenario, "time": "0"})
            kind = "system-out" if verdict.passed else "failure"
            attributes = {} if verdict.passed else {"message": verdict.reason, "type": "gate"}
            ElementTree.SubElement(case, kind, attributes).text = verdict.reason
    ElementTree.indent(root)
    xml: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return xml + b"\n"


def _counts(name: str, verdicts: Sequence[Verdict]) -> dict[str, str]:
    failures = sum(not verdict.passed for verdict in verdicts)
    return {"name": name, "tests": str(len(verdicts)), "failures": str(failures), "errors": "0"}
