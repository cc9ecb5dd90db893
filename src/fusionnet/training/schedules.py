"""Learning rates over the steps of a run: our one-cycle, and the thesis's three.

- `one-cycle`: a linear rise, then half a cosine to a hundredth of the peak
- `constant`: the peak from the first step to the last
- `steps`: a tenth of it after each milestone (RetinaNet, thesis 4.1.2)
- `inverse-root`: a linear rise, then the inverse root of the step (Transformer, equation 4.1)
- `plateau`: a tenth of it when a loss no longer falls (FusionNet, thesis chapter 7)
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from fusionnet.errors import InputError

Kind = Literal["one-cycle", "constant", "steps", "inverse-root", "plateau"]


@dataclass(frozen=True, kw_only=True)
class ScheduleConfig:
    """Which schedule, and what it needs to know.

    Attributes:
        kind: one-cycle, constant, steps, inverse-root or plateau.
        warm_up: Share of a one-cycle's steps that rise linearly to the peak.
        warm_up_steps: Steps of the inverse root's rise (equation 4.1). Its learning rate
            is d_model ** -0.5.
        milestones: Steps at which `steps` lowers the rate (thesis 4.1.2).
        factor: What `steps` and `plateau` multiply the rate with.
        check_every: Steps between the checks of `plateau`.
        patience: Checks in a row without a lower loss after which `plateau` lowers the rate.
        monitor: Name of the loss that `plateau` watches; "loss" is the weighted sum.
    """

    kind: Kind = "one-cycle"
    warm_up: float = 0.05
    warm_up_steps: int = 4000
    milestones: tuple[int, ...] = (60_000, 80_000)
    factor: float = 0.1
    check_every: int = 1000
    patience: int = 2
    monitor: str = "loss"

    def __post_init__(self) -> None:
        """Refuse values that make no schedule."""
        whole = min(self.warm_up_steps, self.check_every, self.patience, *self.milestones)
        if not 0 <= self.warm_up < 1 or not 0 < self.factor <= 1 or whole < 1:
            raise InputError(
                "0 <= warm_up < 1, 0 < factor <= 1, and at least 1 for warm_up_steps, "
                f"check_every, patience and every milestone; got {self}"
            )


class Schedule:
    """The learning rate of every step; only `plateau` looks at the losses.

    Args:
        config: Which schedule.
        peak: Its greatest learning rate (for `inverse-root` the factor d_model ** -0.5).
        steps: Steps of the whole run.
    """

    def __init__(self, config: ScheduleConfig, *, peak: float, steps: int) -> None:
        self.config = config
        self.peak = peak
        self.steps = steps
        self._reductions = 0.0
        self._best = math.inf
        self._bad = 0.0
        self._sum = 0.0

    def rate(self, step: int) -> float:
        """Learning rate of a step, counted from 0."""
        config = self.config
        if config.kind == "one-cycle":
            return self.peak * self._cycle(step)
        if config.kind == "steps":
            return self.peak * config.factor ** sum(step >= m for m in config.milestones)
        if config.kind == "inverse-root":
            return self.peak * min((step + 1) ** -0.5, (step + 1) * config.warm_up_steps**-1.5)
        if config.kind == "plateau":
            return self.peak * config.factor**self._reductions
        return self.peak

    def _cycle(self, step: int) -> float:
        rise = max(1, int(self.config.warm_up * self.steps))
        if step < rise:
            return (step + 1) / rise
        share = (step - rise) / max(1, self.steps - rise)
        return 0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * share))

    def observe(self, step: int, losses: Mapping[str, float]) -> None:
        """Tell the losses of a step, which `plateau` averages between its checks.

        Raises:
            InputError: If the loss that `plateau` watches is not among them.
        """
        config = self.config
        if config.kind != "plateau":
            return
        if config.monitor not in losses:
            known = ", ".join(losses)
            raise InputError(f"plateau watches a loss {config.monitor!r}; there are: {known}.")
        self._sum += losses[config.monitor]
        if (step + 1) % config.check_every:
            return
        mean, self._sum = self._sum / config.check_every, 0.0
        self._bad = 0.0 if mean < self._best else self._bad + 1
        self._best = min(self._best, mean)
        if self._bad >= config.patience:
            self._reductions, self._bad = self._reductions + 1, 0.0

    def state(self) -> dict[str, float]:
        """What a resumed run needs to know, as JSON values."""
        best = {} if math.isinf(self._best) else {"best": self._best}
        return {"reductions": self._reductions, "bad": self._bad, "sum": self._sum, **best}

    def restore(self, state: Mapping[str, float]) -> None:
        """The inverse of `state`."""
        self._reductions = float(state["reductions"])
        self._bad, self._sum = float(state["bad"]), float(state["sum"])
        self._best = float(state.get("best", math.inf))
