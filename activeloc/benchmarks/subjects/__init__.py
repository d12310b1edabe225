"""A module for each subject, with ``measure(settings)``: its rows and curves."""
