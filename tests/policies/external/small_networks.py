"""Small networks in the format of other projects' exporters, equal networks in NumPy, and their specifications."""

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from policies.external.spec import PolicySpec, SpecTerm

HIDDEN = 16
JOINTS = tuple(f"{leg}_{link}_joint" for link in ("thigh", "calf", "hip") for leg in ("RL", "FR", "RR", "FL"))
"""Joint names of SimpleQuad in the vocabulary of another project, by kind."""
OBSERVED = tuple(f"{leg}_{link}_joint" for leg in ("FR", "FL", "RR", "RL") for link in ("hip", "thigh", "calf"))
MIXED = (
    SpecTerm("angular_velocity", scale=(0.25,), clip=(-1.0, 1.0), history=3),
    SpecTerm("projected_gravity", history=3),
    SpecTerm("command", scale=(2.0, 2.0, 0.25), history=3),
    SpecTerm("joint_position", history=3),
    SpecTerm("joint_velocity", scale=(0.05,), history=3),
    SpecTerm("previous_action", history=3),
)


def make_spec(network: Path, terms: tuple[SpecTerm, ...] = MIXED, **fields: Any) -> PolicySpec:
    """Return a specification with permuted joints and numbers that all differ."""
    numbers = 1.0 + np.arange(12) / 10
    given = {
        "control_rate": 50.0,
        "joints": JOINTS,
        "default_position": tuple((np.repeat([0.5, -1.0, 0.0], 4) + numbers / 100).tolist()),
        "action_scale": tuple((0.05 * numbers).tolist()),
        "stiffness": tuple((200.0 * numbers).tolist()),
        "damping": tuple((5.0 * numbers).tolist()),
        "observed_joints": OBSERVED,
    }
    return PolicySpec(network=network.absolute(), terms=terms, **given | fields)


@dataclass
class SmallNetwork:
    """Weights of a network with `width` inputs and 12 outputs, with a memory if `lstm`."""

    width: int
    lstm: bool = False

    def __post_init__(self) -> None:
        random = np.random.default_rng(3)
        self.first = random.normal(0.0, self.width**-0.5, (self.width, HIDDEN)).astype(np.float32)
        self.gates = random.normal(0.0, 0.5, (4, 2 * HIDDEN, HIDDEN)).astype(np.float32)  # in, out, forget, cell
        self.last = random.normal(0.0, HIDDEN**-0.5, (HIDDEN, 12)).astype(np.float32)

    def make_act(self) -> Callable[[np.ndarray], np.ndarray]:
        """Return a function from one observation, (k,), to one action, (12,), with an empty memory."""
        state = {"hidden": np.zeros(HIDDEN), "cell": np.zeros(HIDDEN)}

        def act(seen: np.ndarray) -> np.ndarray:
            inner = np.tanh(seen @ self.first)
            if self.lstm:
                both = np.concatenate((inner, state["hidden"]))
                new, out, kept = (1.0 / (1.0 + np.exp(-both @ gate)) for gate in self.gates[:3])
                state["cell"] = kept * state["cell"] + new * np.tanh(both @ self.gates[3])
                inner = state["hidden"] = out * np.tanh(state["cell"])
            return inner @ self.last

        return act

    def onnx(self, file: Path, batch: int | str = "n") -> Path:
        """Write the network as ONNX; an LSTM has h_in, c_in -> h_out, c_out, as in rsl_rl's exporter."""
        from onnx import TensorProto, helper, numpy_helper

        def value(name: str, *shape: int | str) -> Any:
            return helper.make_tensor_value_info(name, TensorProto.FLOAT, shape)

        tensors = {"first": self.first, "last": self.last}
        nodes = [("MatMul", ["obs", "first"], ["wide"]), ("Tanh", ["wide"], ["inner"])]
        inputs, outputs, end = [value("obs", batch, self.width)], [value("actions", batch, 12)], "inner"
        if self.lstm:
            w, r = (
                self.gates[:, part].transpose(0, 2, 1).reshape(1, -1, HIDDEN) for part in np.arange(32).reshape(2, 16)
            )
            tensors |= {"w": w, "r": r, "none": np.zeros((1, 8 * HIDDEN), np.float32), "axis": np.array([0])}
            nodes += [
                ("Unsqueeze", ["inner", "axis"], ["in_time"]),
                ("LSTM", ["in_time", "w", "r", "none", "", "h_in", "c_in"], ["", "h_out", "c_out"]),
                ("Squeeze", ["h_out", "axis"], ["memory"]),
            ]
            inputs += [value(name, 1, 1, HIDDEN) for name in ("h_in", "c_in")]
            outputs += [value(name, 1, 1, HIDDEN) for name in ("h_out", "c_out")]
            end = "memory"
        made = [
            helper.make_node(kind, given, found, **({"hidden_size": HIDDEN} if kind == "LSTM" else {}))
            for kind, given, found in [*nodes, ("MatMul", [end, "last"], ["actions"])]
        ]
        weights = [numpy_helper.from_array(tensor, name) for name, tensor in tensors.items()]
        graph = helper.make_graph(made, "policy", inputs, outputs, weights)
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
        file.write_bytes(model.SerializeToString())
        return file

    def torchscript(self, file: Path) -> Path:
        """Write the network as TorchScript; an LSTM keeps its memory in buffers, as in rsl_rl's exporter."""
        import torch

        from tests.policies.external import torch_modules

        module = torch_modules.Recurrent(self.width, HIDDEN) if self.lstm else torch_modules.Plain(self.width, HIDDEN)
        state = {"first.weight": self.first.T, "last.weight": self.last.T}
        if self.lstm:
            new, out, kept, cell = self.gates.transpose(0, 2, 1)
            in_torchs_order = np.concatenate((new, kept, cell, out))
            state |= {"rnn.weight_ih_l0": in_torchs_order[:, :HIDDEN], "rnn.weight_hh_l0": in_torchs_order[:, HIDDEN:]}
        given = {name: torch.tensor(np.ascontiguousarray(weights)) for name, weights in state.items()}
        module.load_state_dict(given, strict=False)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            torch.jit.script(module).save(str(file))
        return file
