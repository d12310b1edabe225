"""What activeloc raises when it is given something it cannot use.

Every message says what was wrong, where, what was given and what is allowed. All of them are
``ValueError``; the command line turns them into one line on standard error and exit code 2.
"""


class ActiveLocError(ValueError):
    """The root of the package's errors."""


class MapError(ActiveLocError):
    """A map, or the file it was to be read from, cannot be used."""


class ConfigError(ActiveLocError):
    """A setting has an unknown name, a wrong type or a value outside its range."""


class ActionError(ActiveLocError):
    """An action is not in the action space, or comes at the wrong time."""


class ScanError(ActiveLocError):
    """A scan has the wrong shape or a reading that no sensor of this kind can give."""


class LogError(ActiveLocError):
    """A recorded run, or the file it was to be read from, cannot be used."""


class CheckpointError(ActiveLocError):
    """A checkpoint or a policy's file is not whole, not ours, or does not go with the run."""
