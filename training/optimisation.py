"""One step of a training: loss, gradients, clipping, new weights."""

import math
from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from training.detectors.contract import checked_losses, guarded
from training.detectors.detector import Detector
from training.device import half_type
from training.settings import TrainingSettings

Batch = tuple[list[Tensor], list[Tensor], list[Tensor]]
"""Points, boxes and labels by frame, as `Detector.loss` takes them."""


def one_cycle(settings: TrainingSettings, steps: int, step: int) -> tuple[float, float]:
    """Return learning rate and first Adam coefficient of step 0, 1, …, steps - 1.

    The rate goes up and down, momentum down and up, along cosines, as of fastai and OpenPCDet
    (`adam_onecycle`): from lr / div_factor to lr during the first `pct_start` of the steps, then to
    lr / div_factor / 10,000."""
    low, moms = settings.lr / settings.div_factor, settings.moms
    top = int(settings.pct_start * steps)
    if step < top:
        part = step / top
        return _cosine(low, settings.lr, part), _cosine(moms[0], moms[1], part)
    part = (step - top) / (steps - top)
    return _cosine(settings.lr, low / 1e4, part), _cosine(moms[1], moms[0], part)


def _cosine(start: float, end: float, part: float) -> float:
    return end + (start - end) / 2 * (math.cos(math.pi * part) + 1)


class Optimisation:
    """An optimiser with its schedule of `steps`, and 16-bit floats, see `half_type`.

    The small gradients of float16 need a scaled loss."""

    def __init__(self, model: Detector, settings: TrainingSettings, steps: int) -> None:
        self._model = model
        self._settings = settings
        self._all_steps = steps
        self._optimizer = _optimizer(model, settings)
        self._dtype = half_type(model.device, settings.mixed_precision)
        self._scaler = torch.amp.GradScaler(model.device.type, enabled=self._dtype is torch.float16)
        self.steps = 0
        self.lr = 0.0

    def step(self, batch: Batch) -> dict[str, Tensor]:
        """Train on one batch. Returns the losses.

        Raises ArithmeticError if the loss or its gradient is not a finite number; the weights stay.
        """
        self.lr, momentum = one_cycle(self._settings, self._all_steps, self.steps)
        for group in self._optimizer.param_groups:
            group["lr"] = self.lr
            if "betas" in group:
                group["betas"] = (momentum, group["betas"][1])
        with torch.autocast(self._model.device.type, self._dtype, enabled=self._dtype is not None):
            with guarded(self._model):
                returned = self._model.loss(*batch)
            losses = checked_losses(self._model, returned)
        self._optimizer.zero_grad()
        self._scaler.scale(losses["loss"]).backward()
        self._scaler.unscale_(self._optimizer)
        most = self._settings.grad_norm_clip
        norm = torch.nn.utils.clip_grad_norm_(self._model.parameters(), most)
        # The only wait for a GPU in a step.
        numbers = [value.detach().double().reshape(()) for value in (losses["loss"], norm)]
        loss, total_norm = torch.stack(numbers).tolist()
        if not math.isfinite(loss):
            raise ArithmeticError(f"the loss is {loss}")
        # A scaler finds its scale by gradients that overflow, and leaves out their steps.
        if not self._scaler.is_enabled() and not math.isfinite(total_norm):
            raise ArithmeticError(f"the norm of the gradient is {total_norm}")
        self._scaler.step(self._optimizer)
        self._scaler.update()
        self._model.global_step += 1
        self.steps += 1
        return {name: value.detach() for name, value in losses.items()}

    def state_dict(self) -> dict[str, Any]:
        """State on which the next steps depend, besides the model."""
        return {
            "steps": self.steps,
            "optimizer": self._optimizer.state_dict(),
            "scaler": self._scaler.state_dict(),
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Go on where another one, of the same model and settings, was."""
        self.steps = state["steps"]
        self._optimizer.load_state_dict(state["optimizer"])
        self._scaler.load_state_dict(state["scaler"])


def _optimizer(model: Detector, settings: TrainingSettings) -> torch.optim.Optimizer:
    weights, lr, decay = model.parameters(), settings.lr, settings.weight_decay
    if settings.optimizer == "sgd":
        return torch.optim.SGD(weights, lr, settings.momentum, weight_decay=decay)
    # AdamW's decay is fastai's "true weight decay"; 0.99 is OpenPCDet's second coefficient.
    return torch.optim.AdamW(
        weights, lr, betas=(settings.moms[0], 0.99), weight_decay=decay, fused=True
    )
