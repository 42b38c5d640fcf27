"""`lpvid inspect`: what is wrong with the data, before any model."""

from __future__ import annotations

from lpvid.cli import options
from lpvid.cli.running import Results, command, conclude, working


@command
def inspect(data: options.Data, input: options.Inputs = None, output: options.Outputs = None,
            schedule: options.Schedule = None, role: options.Role = None, flip: options.Flip = None,
            sample_rate: options.SampleRate = None, chunk: options.Chunk = None,
            out: options.Out = None, json: options.Json = False) -> None:
    """State what is wrong with measured data and how to mend it; writes audit.json and report.html.

    Exits with 0 on anything that parses: what it finds are findings, not errors.
    """
    from lpvid.cli.data import read_records, split_names

    results = Results(out, "audit.json", "report.html")
    with working("reading") as report_progress:
        if chunk is None:
            records = read_records(data, roles=role, flip=flip, sample_rate=sample_rate)
            from lpvid.auditing import audit

            report_progress("auditing")
            found = audit(records, scheduling=split_names(schedule) or None, inputs=split_names(input),
                          outputs=split_names(output), sample_rate=sample_rate)
        else:
            from lpvid.auditing.streamed import audit_stream
            from lpvid.cli.streamed import beginning, parts

            chunks = parts(data, chunk, roles=role, flip=flip, sample_rate=sample_rate)
            found = audit_stream(
                chunks,
                scheduling=split_names(schedule) or None,
                inputs=split_names(input),
                outputs=split_names(output),
                report_progress=report_progress,
            )
            records = [beginning(chunks)]
        if results.kept:
            from lpvid.report.inspection import inspection_page

            report_progress("drawing")
            named = (*split_names(input), *split_names(output), *split_names(schedule))
            results.json("audit.json", found.to_dict())
            results.report(inspection_page(found, records, tuple(dict.fromkeys(named))))
    conclude(results, found.to_dict(), str(found), json)
