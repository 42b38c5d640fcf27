"""A second generator of damper records, for judging only: other laws, other sizes, other hidden causes.

It shares no code with `quartercar.rig`, `quartercar.effects` or `quartercar.dampers` and is imported by no package.
"""
