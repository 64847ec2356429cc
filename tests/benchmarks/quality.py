"""How well responses tell real scans apart, choice by choice: models that differ in one choice, of several seeds.

Trained on simulated objects alone; the labels judge. One choice at a time is changed back, and each arm is judged over
all seeds, so that what is kept is kept for a figure and not for one lucky draw.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence

import numpy as np
from joblib import parallel_config

from tests.benchmarks.quality_arms import ARMS, DEFAULT, PAPER, TUNING, WHOLE, arm_of
from tests.benchmarks.quality_runs import Figures, judge_arm, judge_levels, judge_robustness
from worker.evaluation import bootstrap
from worker.evaluation.report import Robustness

MAPPED = (DEFAULT, WHOLE, PAPER)  # maps take most of the time
WIDTH = 50  # characters of an arm's name


def main(arguments: list[str]) -> None:
    """Prints what is asked for."""
    parser = argparse.ArgumentParser(prog="./run bench quality", description=__doc__)
    parser.add_argument("--objects", type=int, default=250, help="simulated objects a model (250)")
    parser.add_argument("--seeds", default="1-5", help="training seeds, first-last (1-5)")
    which = parser.add_mutually_exclusive_group()
    which.add_argument(
        "--arms",
        nargs="*",
        default=list(ARMS),
        metavar="ARM",
        help="beside the default: names, parameters as in 'stimuli.sigma=0.1', or 'ARM + ARM' (all that have names)",
    )
    which.add_argument("--tune-whole", action="store_true", help=f"{WHOLE}, by settings that the default was tuned by")
    which.add_argument("--levels", action="store_true", help="motif level by motif level, and no arms")
    which.add_argument("--robustness", action="store_true", help="disturbed clouds, and no arms")
    asked = parser.parse_args(arguments)
    first, _, last = asked.seeds.partition("-")
    seeds = range(int(first), int(last or first) + 1)
    if not seeds:
        parser.error(f"--seeds is first-last, such as 1-5; it was {asked.seeds}")
    with parallel_config(backend="loky", n_jobs=2):
        _run(asked, seeds)


def _run(asked: argparse.Namespace, seeds: range) -> None:
    print(
        f"{asked.objects} simulated objects, seeds {asked.seeds}: mean (standard deviation over the seeds)", flush=True
    )
    if asked.robustness:
        _print_curves(judge_robustness(arm_of(DEFAULT), seeds, asked.objects))
        return
    tuned = [f"{WHOLE} + {setting}" for setting in TUNING]
    _print_arms([WHOLE, *tuned] if asked.tune_whole else asked.arms, seeds, asked.objects, asked.levels)


def _print_arms(names: Sequence[str], seeds: range, objects: int, levels: bool) -> None:
    print(f"{'':{WIDTH}}{'scans: knn':>15}{'svm':>15}{'within':>15}{'assigned':>15}", end="")
    print(f"{'rendered: knn':>15}{'svm':>15}{'within':>15}{'assigned':>15}{'occluded: knn':>15}{'svm':>15}")
    default = judge_arm(arm_of(DEFAULT), seeds, objects, maps=not levels)
    _print_figures(DEFAULT, default)
    if levels:
        of_seeds = judge_levels(arm_of(DEFAULT), seeds, objects)
        for name in of_seeds[0]:
            if all(name in figures for figures in of_seeds):  # the highest levels are not reached by every seed
                _print_figures(name, [figures[name] for figures in of_seeds], default)
        return
    for name in names:
        if name != DEFAULT:
            _print_figures(name, judge_arm(arm_of(name), seeds, objects, maps=name in MAPPED), default)


def _print_figures(name: str, figures: list[Figures], default: list[Figures] | None = None) -> None:
    print(f"{name:{WIDTH}}" + "".join(f"{mean:8.3f}({spread:.3f})" for mean, spread in _columns(figures)), flush=True)
    for line in _differences(default, figures) if default else ():
        print(f"    default is ahead by: {line}", flush=True)


def _print_curves(of_seeds: list[Robustness]) -> None:
    in_use = [each.in_use for each in of_seeds]
    print(
        f"concepts in use: {np.mean(in_use):.1f} ({min(in_use)} to {max(in_use)}); clouds that keep their best concept:"
    )
    for place, curve in enumerate(of_seeds[0].curves):
        print(f"  {curve.name}: {curve.description}")
        for at, strength in enumerate(curve.strengths):
            kept = [each.curves[place].strengths[at].kept for each in of_seeds]
            print(f"    {strength.strength:5g} {curve.unit:12} {np.mean(kept):.3f} ({np.std(kept):.3f})")


def _columns(figures: list[Figures]) -> Iterable[tuple[float, float]]:
    """Mean and standard deviation over the seeds of each figure."""
    rows = []
    for each in figures:
        row: list[float] = []
        for name, recalled in each.recalled.items():
            labels = recalled.by_label().values()
            row += [float(np.mean([label[kind] for label in labels])) for kind in ("knn", "svm")]
            row += each.regions.get(name, ())
        rows.append(row)
    return zip(np.mean(rows, axis=0).tolist(), np.std(rows, axis=0).tolist(), strict=True)


def _differences(first: list[Figures], second: list[Figures]) -> Iterable[str]:
    """How far the first arm is ahead, over all seeds, with intervals over groups."""
    for name, recalled in first[0].recalled.items():
        for kind, rows in (("knn", "nearest"), ("svm", "machines")):
            one, other = (np.vstack([getattr(each.recalled[name], rows) for each in arm]) for arm in (first, second))
            value, low, high = bootstrap.difference(recalled.labels, recalled.groups, one, other)
            yield f"{name} {kind} {value:+.3f} [{low:+.3f}, {high:+.3f}]"
