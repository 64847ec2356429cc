"""Runs the benchmarks: `./run bench` the speeds, `... quality` what each choice gives,
`... scale` many objects, `... scenes` whole scenes, `... soak` minutes of load, `... wires` what the wires cost,
`... start` how long commands take to start."""

from __future__ import annotations

import sys

from tests.benchmarks import answer, quality, scale, scenes, soak, start, wires

if sys.argv[1:2] == ["quality"]:
    quality.main(sys.argv[2:])
elif sys.argv[1:2] == ["scale"]:
    scale.main(sys.argv[2:])
elif sys.argv[1:2] == ["scenes"]:
    scenes.main()
elif sys.argv[1:2] == ["soak"]:
    soak.main(sys.argv[2:])
elif sys.argv[1:2] == ["start"]:
    start.main()
elif sys.argv[1:2] == ["wires"]:
    wires.main(sys.argv[2:])
else:
    answer.main(sys.argv[1:])
