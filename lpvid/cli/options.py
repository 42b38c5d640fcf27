"""Options that several commands share, named as in the documentation."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Data = Annotated[list[str], typer.Argument(metavar="DATA", help="Files, patterns or folders of measurements: "
                                           "csv, tsv, parquet, mat, mf4, tdms.", show_default=False)]
ModelFile = Annotated[Path, typer.Argument(metavar="MODEL", help="A model.json.", show_default=False)]
Inputs = Annotated[list[str] | None, typer.Option("--input", metavar="NAME", help="Input channel or role; repeat, or "
                                                  "separate with commas.")]
Outputs = Annotated[list[str] | None, typer.Option("--output", metavar="NAME", help="Output channel or role.")]
Schedule = Annotated[list[str] | None, typer.Option("--schedule", metavar="NAME", help="Scheduling variable.")]
Role = Annotated[list[str] | None, typer.Option("--role", metavar="ROLE=CHANNEL", help="Let a role stand for a "
                                                "channel of another name, e.g. force=F_cell or time=Zeit; with a unit "
                                                "where the file states none: 'force=F_cell [kN]'. A model "
                                                "file remembers those of its training data.")]
Flip = Annotated[list[str] | None, typer.Option("--flip", metavar="CHANNEL[@FILES]", help="Turn the sign of a channel, "
                                              "in every file or in those whose name matches, e.g. force@run7*.")]
SampleRate = Annotated[float | None, typer.Option("--sample-rate", metavar="HZ", help="Resample to this rate, "
                                                  "anti-aliased; or the rate of files without a time column.")]
SampleRateOrRaw = Annotated[str | None, typer.Option("--sample-rate", metavar="HZ|raw", help="Resample to this rate, "
                                                     "anti-aliased; or the rate of files without a time column. Left "
                                                     "out: data above 1024 Hz are decimated to about 500 Hz or four "
                                                     "times their bandwidth; raw "
                                                     "keeps them.")]
ModelsRate = Annotated[str | None, typer.Option("--sample-rate", metavar="HZ|raw", help="Rate of files without a "
                                                "time column. A model runs at its own rate: data of another are "
                                                "resampled to it, and a note states so; raw, or another rate, "
                                                "refuses them.")]
Beside = Annotated[list[str] | None, typer.Option("--beside", metavar="MODEL", help="Another model on the same "
                                                  "records, in the report's tables and figures; repeat for several.")]
Out = Annotated[Path | None, typer.Option("--out", metavar="DIR", help="Folder for the results and report.html.",
                                          show_default=False)]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON on standard output, and nothing else.")]
Chunk = Annotated[int | None, typer.Option("--chunk", min=2, metavar="ROWS", help="Read so many samples at a time "
                                           "(Parquet, MDF 4, CSV): for data larger than memory, e.g. 500000.")]
