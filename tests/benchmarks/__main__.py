"""Runs all benchmarks, one after the other."""

from __future__ import annotations

from tests.benchmarks import answer

answer.main()
