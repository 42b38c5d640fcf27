"""The quarter car: linear, nonlinear, many at once, with exact gradients, and what a damper is inside one.

`linear` holds the only mass-spring matrices, `nonlinear` the car with bump stops and a tyre that lifts off, `stepper`
and `integrator` its steps in time, `batch` many cars at once, `result` what a run gives; `filter_bank`
carries identified dampers along.
"""
