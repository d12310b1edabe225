"""Recorded runs: what a real robot's laser and wheels said."""

from activeloc.logs.carmen import read_log
from activeloc.logs.recording import Recording, controls_between

__all__ = ["Recording", "controls_between", "read_log"]
