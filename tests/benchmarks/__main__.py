"""Runs the benchmarks: `./run bench` the speeds, `./run bench quality` what each choice does to the quality."""

from __future__ import annotations

import sys

from tests.benchmarks import answer, quality

if sys.argv[1:2] == ["quality"]:
    quality.main(sys.argv[2:])
else:
    answer.main()
