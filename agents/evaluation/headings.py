"""What the scores are called in tables, and how many digits they have."""

HEADINGS: dict[str, tuple[str, str]] = {
    "right": ("right", ".2f"),
    "likeliest": ("likeliest\nis true", ".2f"),
    "return": ("return", ".2f"),
    "wrong": ("wrong\nand sure", ".2f"),
    "wrong_of_declared": ("wrong of\ndeclared", ".2f"),
    "steps": ("steps", ".0f"),
    "entropy_auc": ("area", ".2f"),
    "error_m": ("error\n[m]", ".2f"),
    "noticed": ("noticed", ".2f"),
    "recovered": ("recovered", ".2f"),
    "notice_steps": ("steps to\nnotice", ".1f"),
    "recover_steps": ("steps to\nrecover", ".1f"),
    "false_alarm": ("false\nalarms", ".3f"),
    "expected_gain": ("expected\n[nat]", ".3f"),
    "realised_gain": ("realised\n[nat]", ".3f"),
    "earned": ("realised /\nexpected", ".2f"),
}
"""Score -> heading, of two lines where it is long, and the format of a value."""
