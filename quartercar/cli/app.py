"""The `quartercar` application: its commands and what they share."""

from __future__ import annotations

from lpvid.cli.running import add, new_app
from quartercar.cli.characterise import characterise
from quartercar.cli.demo import demo
from quartercar.cli.design import design
from quartercar.cli.export import export
from quartercar.cli.fit import fit
from quartercar.cli.ride import ride
from quartercar.cli.rig import rig

app = new_app("quartercar", "Dampers and quarter cars: a virtual test rig, damper models fitted and compared, "
                            "controllers and rides.")

EXAMPLES = {
    rig: (
        ("a plan to start from: eight tests of a virtual damper", "quartercar rig --template > plan.toml"),
        ("a plan of your own", "quartercar rig plan.toml --out records"),
    ),
    characterise: (
        ("forces at standard speeds, friction, hysteresis, switching, from raw records",
         "quartercar characterise run*.csv --out page"),
        ("against nominal forces, with a tolerance", "quartercar characterise run*.csv --nominal nominal.csv "
         "--tolerance 10%+20N --out page"),
    ),
    fit: (
        ("every damper law, validated on records kept out of the fit",
         "quartercar fit run*.csv --held-out new.csv --out fit"),
        ("two laws only", "quartercar fit run*.csv --models guo,kwok --out fit"),
    ),
    design: (
        ("an LPV H-infinity controller for a car with this damper",
         "quartercar design --damper model/model.json --out design"),
        ("a configuration to start from", "quartercar design --template"),
    ),
    ride: (
        ("control laws on two roads, ten seeds",
         "quartercar ride --road iso-c@20,bump@8 --controller passive,skyhook,sh-add --seeds 10 --out ride"),
        ("with the best that any current could do", "quartercar ride --road iso-c@20 --bound --out ride"),
    ),
    export: (("a control law as C99", "quartercar export --controller skyhook --to c --out generated"),),
    demo: (("the whole chain on virtual data, in a minute", "quartercar demo --out demo"),),
}
"""Commands in the order of the help, each with (comment, command line) examples."""

for _command, _examples in EXAMPLES.items():
    add(app, _command, _examples)
