"""Explanation of MuJoCo's error messages about a model file: adds the cause and a remedy."""

_MEANINGS = {
    "mjMINVAL": "a body that moves has no mass or no inertia: give it an <inertial>, or geoms with mass",
    "A + B >= C": "no rigid body has this inertia, a moment is larger than the other two together: correct it",
    "positive eigenvalues": "no rigid body has this inertia, a moment is not above 0: correct it",
    "opening file": "a file that the model names is not there or cannot be read: put it there, or correct the name",
    "unknown transmission target": "an actuator names a joint that the model does not have: correct one of the names",
    "missing transmission target": "an actuator names no joint: give it joint=",
    "repeated name": "two parts of a kind have the same name: rename one",
    "unrecognized": "MJCF has no such element or attribute here: remove or correct it",
    "unknown default class": "the class has no <default> of that name: add it, or correct the name",
    "not found": "a name stands for nothing in the model: correct it",
    "required attribute missing": "an attribute is missing: add it",
    "enough data": "an attribute has too few numbers: complete it",
    "too much data": "an attribute has too many numbers: shorten it",
    "bad format": "an attribute is no number: correct it",
    "invalid keyword": "an attribute has a value that MJCF does not know: correct it",
    "XML parse error": "the file is no well-formed XML: correct it",
    "XML_ERROR": "the file is no well-formed XML: correct it",
    "axis too small": "a joint's axis has no direction: correct it",
    "zero quaternion": "a rotation is four zeros: correct it",
    "size": "a size is missing or not above 0: correct it",
}
"""Text that occurs in an error message of MuJoCo -> cause of the error, and remedy.

The first text that occurs in the message is used.
"""


def explain_message(message: str) -> str:
    """Return an error message of MuJoCo as one line, preceded by its cause and remedy if they are known."""
    line = " ".join(message.split())
    meaning = next((meaning for part, meaning in _MEANINGS.items() if part in line), None)
    return line if meaning is None else f"{meaning} ({line})"
