"""Table of the file formats in the fuzz test, with the functions that write and read a mutated file.

A mutated file is a valid file with random changes.
"""

from policies.base import PolicyError
from quad_env.robots.simple_quad import SIMPLE_QUAD
from research.fuzzing import readers, samples, writers
from research.fuzzing.readers import Read
from research.fuzzing.writers import Write, settings_writer, xml_writer

FORMATS: dict[str, tuple[Write, Read]] = {
    "legged-gym-yaml": (settings_writer(samples.LEGGED_GYM, "settings.yaml"), readers.read_spec),
    "legged-gym-json": (settings_writer(samples.LEGGED_GYM, "settings.json"), readers.read_spec),
    "isaac-lab": (settings_writer(samples.ISAAC_LAB, "params/env.yaml"), readers.read_spec),
    "unitree": (settings_writer(samples.UNITREE, "params/deploy.yaml"), readers.read_spec),
    "rl-sar": (writers.write_rl_sar, readers.read_spec),
    "mjlab": (writers.write_mjlab, readers.read_spec),
    "toml": (settings_writer(samples.TOML, "policy.toml"), readers.read_spec),
    "bundle": (writers.write_bundle, readers.read_bundle),
    "onnx": (writers.write_onnx, readers.read_onnx),
    "sb3": (writers.write_sb3, readers.read_sb3),
    "mjcf": (xml_writer(SIMPLE_QUAD.mjcf, "robot.xml"), readers.read_robot),
    "urdf": (xml_writer(SIMPLE_QUAD.mjcf.with_suffix(".urdf"), "robot.urdf"), readers.read_robot),
    "terrain": (writers.write_terrain, readers.read_terrain),
}
"""Name of a file format -> (function that writes a mutated file, function that reads the file).

A mutated file is a valid file with random changes. The second function also checks that the content is plausible.
"""
OWN_ERRORS = (PolicyError, ValueError, OSError)
"""Exceptions that a function of this project may raise if it reads a faulty file.

The fuzz test reports any other exception as a fault of the function. `ModelError`, the error about faulty files of
robots, is included, because it is a subclass of ValueError.
"""
