"""The engines that run a net, and the selection of one."""

from netlib.engine.choice import NAMES, available_cpus, for_each, get, has_fast, prepare

__all__ = ["NAMES", "available_cpus", "for_each", "get", "has_fast", "prepare"]
