"""The modules of the seven steps, in their order."""

from __future__ import annotations

from . import step_check, step_drop, step_fit, step_model, step_see, step_take, step_why

MODULES = (step_drop, step_see, step_check, step_model, step_fit, step_why, step_take)
