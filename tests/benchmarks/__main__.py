"""Runs the benchmarks: `./run bench` the speeds, `... quality` what each choice gives,
`... learning` how long it takes, `... scale` many objects, `... scenes` whole scenes, `... soak` minutes of load."""

from __future__ import annotations

import sys

from tests.benchmarks import answer, learning, quality, scale, scenes, soak

if sys.argv[1:2] == ["quality"]:
    quality.main(sys.argv[2:])
elif sys.argv[1:2] == ["learning"]:
    learning.main(sys.argv[2:])
elif sys.argv[1:2] == ["scale"]:
    scale.main(sys.argv[2:])
elif sys.argv[1:2] == ["scenes"]:
    scenes.main()
elif sys.argv[1:2] == ["soak"]:
    soak.main(sys.argv[2:])
else:
    answer.main()
