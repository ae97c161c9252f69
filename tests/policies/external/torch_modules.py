"""Modules of torch in the form of other projects' exporters."""

import torch


class Plain(torch.nn.Module):
    """Module without memory."""

    def __init__(self, width: int, hidden: int) -> None:
        super().__init__()
        self.first = torch.nn.Linear(width, hidden, bias=False)
        self.last = torch.nn.Linear(hidden, 12, bias=False)

    def forward(self, seen: torch.Tensor) -> torch.Tensor:
        return self.last(torch.tanh(self.first(seen)))


class Recurrent(torch.nn.Module):
    """Module with a memory in buffers, as in rsl_rl's exporter."""

    def __init__(self, width: int, hidden: int) -> None:
        super().__init__()
        self.first = torch.nn.Linear(width, hidden, bias=False)
        self.rnn = torch.nn.LSTM(hidden, hidden, bias=False)
        self.last = torch.nn.Linear(hidden, 12, bias=False)
        self.register_buffer("hidden_state", torch.zeros(1, 1, hidden))
        self.register_buffer("cell_state", torch.zeros(1, 1, hidden))

    def forward(self, seen: torch.Tensor) -> torch.Tensor:
        inner = torch.tanh(self.first(seen)).unsqueeze(0)
        out, (hidden, cell) = self.rnn(inner, (self.hidden_state, self.cell_state))
        self.hidden_state[:] = hidden
        self.cell_state[:] = cell
        return self.last(out.squeeze(0))

    @torch.jit.export
    def reset(self) -> None:
        self.hidden_state[:] = 0.0
        self.cell_state[:] = 0.0


class Counting(torch.nn.Module):
    """Module that counts its calls in an attribute."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.last = torch.nn.Linear(width, 12, bias=False)
        torch.nn.init.ones_(self.last.weight)
        self.calls = 0

    def forward(self, seen: torch.Tensor) -> torch.Tensor:
        self.calls += 1
        return self.last(seen) + self.calls
