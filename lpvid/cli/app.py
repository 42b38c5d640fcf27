"""The `lpvid` application: its commands and what they share."""

from __future__ import annotations

from lpvid.cli.compare import compare
from lpvid.cli.diagnose import diagnose
from lpvid.cli.export import export
from lpvid.cli.fleet import fleet
from lpvid.cli.identify import identify
from lpvid.cli.inspect import inspect
from lpvid.cli.running import add, new_app
from lpvid.cli.simulate import simulate
from lpvid.cli.stability import stability
from lpvid.cli.synthesize import synthesize, verify
from lpvid.cli.validate import validate

app = new_app("lpvid", "Identify LPV models from measured data, state how good and how stable they are, and what "
                       "a simulation gets wrong.")
_SIGNALS = "--input velocity --output force --schedule current"
EXAMPLES = {
    inspect: (("what a record can be used for", "lpvid inspect run*.csv --out inspected"),),
    identify: (
        ("an LPV model of a damper, its last third kept out of the fit",
         f"lpvid identify run*.csv {_SIGNALS} --hold-out 1/3 --out model"),
        ("let the structure be chosen", f"lpvid identify run*.csv {_SIGNALS} --auto --out model"),
        ("a coil that lags, a force that saturates",
         f"lpvid identify run*.csv {_SIGNALS} --shape tanh --schedule-lag --out model"),
        ("the same from a file", "lpvid identify run*.csv --config identify.toml"),
    ),
    simulate: (("free run on a new record, with the residual", "lpvid simulate model/model.json new.csv --out run"),),
    validate: (("judge a model on records that it was not fitted to",
                "lpvid validate model/model.json new*.csv --out validated"),),
    compare: (("several models on the same records",
               "lpvid compare a/model.json b/model.json new*.csv --out compared"),),
    stability: (
        ("for which currents, and how fast may they move", "lpvid stability model/model.json --out stability"),
        ("over a range of your own", "lpvid stability model/model.json --range current=0:2 --rate current=20"),
    ),
    diagnose: (
        ("what a simulation by the fitted law gets wrong, and why",
         "lpvid diagnose run*.csv --baseline guo --held-out new.csv --out diagnosis"),
        ("of a model from lpvid identify", "lpvid diagnose run*.csv --baseline model/model.json --out diagnosis"),
    ),
    synthesize: (
        ("a controller for a plant and a design in TOML",
         "lpvid synthesize plant.toml --design design.toml --out controller"),
        ("files to start from", "lpvid synthesize --template"),
    ),
    verify: (("check a stored certificate anew", "lpvid verify stability/certificate.json model/model.json"),),
    export: (
        ("C99 for an embedded target", "lpvid export model/model.json --to c --precision float --out generated"),
        ("an FMU with its sources", "lpvid export model/model.json --to fmu2 --out fmu"),
    ),
    fleet: (
        ("one model of many specimens, and the specimens that differ from it",
         f"lpvid fleet 'data/**/*.parquet' --do audit,identify {_SIGNALS} --out fleet"),
        ("with the causes, on a running cluster",
         f"lpvid fleet 'data/**/*.csv' --do audit,identify,diagnose {_SIGNALS} --scheduler tcp://10.0.0.1:8786 "
         "--out fleet"),
    ),
}
"""Commands in the order of the help, each with (comment, command line) examples."""

for _command, _examples in EXAMPLES.items():
    add(app, _command, _examples)
