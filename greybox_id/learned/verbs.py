"""Learned dynamics: networks of how a vehicle answers its commands, in models of motion in which they act.

A network is trained on recordings (`train_actuator_net`), injected into a model of motion (`injected`), and then drives
in the environment of `docs/racing.md` or along recordings (`errors_ahead`).
"""

from .injection import injected
from .net import ActuatorNet, load_actuator_net
from .open_loop import errors_ahead
from .training import train_actuator_net

__all__ = ["ActuatorNet", "errors_ahead", "injected", "load_actuator_net", "train_actuator_net"]
