"""Wrappers in C that make an FMU of an exported step: templates, filled in by `lpvid.export.fmu`."""
