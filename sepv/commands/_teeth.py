"""``sepv teeth``: the faults that each law finds."""

from __future__ import annotations

import click
from rich.text import Text

from sepv.commands import _shared as cli


@click.command(short_help="Which planted faults each law finds.")
@click.argument("names", nargs=-1, metavar="[SABOTEUR]...")
@click.option(
    "--law", "laws", multiple=True, metavar="NAME,…", help="Only these laws; may be repeated.", callback=cli.listed
)  # fmt: skip
@click.option("--seeds", type=cli.COUNT, help="How many seeds. [default: 10; bare 1]")
@click.option("--matrix", is_flag=True, help="Every saboteur by every law: an hour or more.")
@click.option("--first", is_flag=True, help="Stop each saboteur at the first law that kills it.")
@click.option(
    "--corpus", is_flag=True, help="Count once more with known witnesses, which `verify` asks first."
)
@click.option("--workers", type=cli.COUNT, default=2, help="Processes.")
@click.option("--json", "json_file", type=cli.OUT, help="Write every single finding to this file.")
@click.option("-q", "--quiet", is_flag=True, help="Only the last line.")
@cli.friendly
def teeth(
    names: cli.Names, laws: cli.Names, seeds: int | None, matrix: bool, first: bool, corpus: bool, workers: int,
    json_file: str | None, quiet: bool,
) -> None:  # fmt: skip
    """List the planted faults that each law finds, with the number of inputs that it takes to the
    first violation.

    A saboteur is a scheme with one planted fault. Exit code 0 if a law finds every saboteur with
    every seed, else 1.

    \b
    sepv teeth                  each saboteur, one seed, to its first law
    sepv teeth b-at-y0 --seeds 3        one saboteur by every law
    sepv teeth --matrix                 the whole matrix, an hour or more
    """
    from sepv.console import console, print_sentence, showing
    from sepv.faults import detection as fault_detection
    from sepv.law import Effort

    bare = not (names or laws or matrix)
    seeds = seeds or (1 if bare else 10)
    with showing(quiet) as shown:

        def counted(known: bool) -> list[fault_detection.Detection]:
            found: list[fault_detection.Detection] = fault_detection.run(
                names or None,
                range(seeds),
                lambda done, total, _: shown.update(f"{done} of {total}", done / total),
                laws=laws or None, first=first or bare or known, effort=Effort(corpus=known), workers=workers,
            )  # fmt: skip
            return found

        detections, with_known = counted(False), counted(True) if corpus else None
    cli.save_json(json_file, "teeth", {"detections": [b.to_json() for b in detections]})
    if quiet:
        print_sentence(console(), fault_detection.summary(detections))
    else:
        fault_detection.show(detections, console())
    if with_known is not None:
        print_sentence(
            console(), Text("with known witnesses: ").append_text(fault_detection.summary(with_known))
        )
    raise SystemExit(1 if fault_detection.survivors(detections) else 0)
