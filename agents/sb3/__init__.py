"""Learning with Stable-Baselines3: the only place that imports torch.

=================== ================================================================================
module              what it is
=================== ================================================================================
vec_env             Our vector environment as SB3's.
features            What a network makes of an observation.
hyperparameters     One table: what each algorithm uses in each environment.
configuration       What a run is, as plain data.
algorithms          From a configuration to an SB3 model.
checkpoint          Folders that are whole or not there, read without unpickling.
resuming            Where a run stands at the boundary between two updates.
imitation           Behaviour cloning of a planner, with DAgger.
training            The loop, with its callbacks and signals.
export              A policy as ONNX.
=================== ================================================================================

This package imports nothing by itself, so that looking a name up costs nothing.
"""
