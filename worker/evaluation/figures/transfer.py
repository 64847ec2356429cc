"""The transfer experiment: what one instance a label is enough for."""

from __future__ import annotations

from worker.evaluation.figures.bars import Bar, bar_picture
from worker.evaluation.figures.figure import Figure, Panel, Table
from worker.evaluation.report import Transfer


def transfer_figure(transfer: Transfer) -> Figure:
    """The recall of labelled motif prototypes, and that of rivals by the same instances."""
    bars = [Bar("motif prototypes", transfer.recall.mean, transfer.recall.low, transfer.recall.high, own=True)]
    bars += [Bar(f"nearest: {name}", rival.mean, rival.low, rival.high) for name, rival in transfer.rivals.items()]
    rows = [
        (label, f"{spread.mean:.3f}", f"{spread.low:.3f} to {spread.high:.3f}")
        for label, spread in transfer.by_label.items()
    ]
    return Figure(
        key="transfer",
        title="Transfer: one example of each label",
        caption="The model was shown a single cloud of each label and asked for the label of all others; the bars are "
        f"the mean share that it got right over {transfer.draws} random choices of the examples, 1 being best, and the "
        "thin lines span 95 of 100 choices.",
        panels=(Panel(bar_picture("transfer", bars)),),
        tables=(Table(("label", "share right", "in 95 of 100 choices"), tuple(rows), "Label by label"),),
        paper="Sec. Shape Knowledge Transfer from Mental Simulation to Real-World Data",
        columns=1,
    )
