"""Runs the benchmarks: `./run bench` the speeds, `... quality` what each choice gives, `... learning` how long that
takes, `... scale` many objects, `... scenes` whole scenes, `... soak` minutes of load, `... wires` what the wires cost,
`... start` how long commands take to start."""

from __future__ import annotations

import sys
from importlib import import_module

NAMES = ("quality", "learning", "scale", "scenes", "soak", "wires", "start")

chosen = sys.argv[1] if sys.argv[1:2] and sys.argv[1] in NAMES else "answer"
import_module(f"tests.benchmarks.{chosen}").main(sys.argv[1 if chosen == "answer" else 2 :])
